// The change of a plate's light from picture to picture: `effects/exposure.py`.
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

#include "module.h"

namespace nlens {
namespace {

// Logarithmic light, NaN where a channel lies outside `known` (darkest, brightest).
void take_stops(Array<const float, 3> light, std::tuple<float, float> known, Array<float, 3> stops) {
    const auto [darkest, brightest] = known;
    const int count = light.shape[0] * light.shape[1];
    for (int i = 0; i < count; ++i) {
        const float* from = light.data + 3 * i;
        float* to = stops.data + 3 * i;
        bool usable = true;  // false for NaN, too
        for (int k = 0; k < 3; ++k) usable &= darkest <= from[k] && from[k] <= brightest;
        for (int k = 0; k < 3; ++k)
            to[k] = usable ? std::log2(from[k]) : std::numeric_limits<float>::quiet_NaN();
    }
}

// The value of rank n / 2, from 0; changes the order.
float median_of(std::vector<float>& values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

bool take_change(Array<const float, 3> before, Array<const float, 3> now, double least_share,
                 double most_spread, Array<double, 1> change) {
    const int places = before.shape[0] * before.shape[1];
    std::vector<float> ratios[3];
    for (int i = 0; i < places; ++i) {
        const float *then = before.data + 3 * i, *here = now.data + 3 * i;
        if (std::isnan(then[0]) || std::isnan(here[0])) continue;
        for (int k = 0; k < 3; ++k) ratios[k].push_back(here[k] - then[k]);
    }
    if (ratios[0].empty() || static_cast<double>(ratios[0].size()) < least_share * places) return false;
    for (int k = 0; k < 3; ++k) {
        const float middle = median_of(ratios[k]);
        for (float& ratio : ratios[k]) ratio = std::fabs(ratio - middle);
        if (!(median_of(ratios[k]) < most_spread)) return false;
        change(k) = middle;
    }
    return true;
}

}  // namespace

void bind_exposure(nanobind::module_& module) {
    module.def("take_stops", &take_stops, Unlocked());
    module.def("take_change", &take_change, Unlocked());
}

}  // namespace nlens

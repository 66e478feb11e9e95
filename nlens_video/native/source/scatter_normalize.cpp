// Columns that the blurred object reaches, and sums by their weight: `kernels/scatter/normalize.py`.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "module.h"
#include "scatter.h"
#include "vectors.h"

namespace nlens {
namespace {

// Share of a row's largest sum below which a sum is rounding error of the running sum.
constexpr float kRemainder = 1e-6f;
// Weight below which it is rounding error itself, and the quotient meaningless.
constexpr float kWeightFloor = 1e-4f;

// Width of a pixel by its height; how many radii a disc reaches; how many pixels its light goes further.
struct Shape {
    double aspect, outer;
    int spread;
    static constexpr auto fields = std::tuple{&Shape::aspect, &Shape::outer, &Shape::spread};
};

// Widens `low` and `high`, the columns that each row reaches, by what discs of rows of pixels cover: from
// first and last covered column, -1 for none, and the largest radius of each.
void reach_columns(Array<const std::int32_t, 1> first, Array<const std::int32_t, 1> last,
                   Array<const float, 1> radius, Shape shape, Array<double, 1> low, Array<double, 1> high) {
    const int height = first.shape[0];
    for (int source = 0; source < height; ++source) {
        if (last(source) < 0) continue;
        const double across = radius(source) * shape.outer + 1.0;
        const int rows = static_cast<int>(std::ceil(across * shape.aspect)) + shape.spread;
        for (int y = std::max(0, source - rows); y < std::min(height, source + rows + 1); ++y) {
            const double down =
                std::max(0.0, std::abs(y - source) - 0.5 - shape.spread) / (across * shape.aspect);
            const double half = across * std::sqrt(std::max(0.0, 1.0 - down * down)) + 2.0 + shape.spread;
            low(y) = std::min(low(y), first(source) - half);
            high(y) = std::max(high(y), last(source) + half);
        }
    }
}

// First and last column of each row of the layer that are reached.
struct Reached {
    Array<const double, 1> first, last;
    static constexpr auto fields = std::tuple{&Reached::first, &Reached::last};
};

Float4 size(Float4 v) {
    return v < 0.0f ? -v : v;
}

// The largest sizes of colours and alpha in a row of sums (width, 5).
Float4 largest(const float* sums, int width) {
    Float4 most{};
    for (int x = 0; x < width; ++x) {
        const Float4 one = size(load<Float4>(sums + 5 * x));
        most = one > most ? one : most;
    }
    return most;
}

// Divides rows of sums (h, w, 5) by their weight into `out` (h, w, 4); 0 where the object does not reach.
// `origin` is where in the layer `sums` start.
void normalise_sums(Array<const float, 3> sums, Reached reached, Place origin, Strided<float, 3> out,
                    Band band) {
    const int width = sums.shape[1];
    for (int y = band.begin; y < band.end; ++y) {
        const float* of_row = sums.at(y);
        float* to = out.at(y);
        std::fill_n(to, 4 * width, 0.0f);
        const double low = reached.first(y + origin.row), high = reached.last(y + origin.row);
        if (low > high) continue;
        const auto column = [&](double place) {
            return static_cast<int>(std::clamp(place - origin.column, 0.0, static_cast<double>(width)));
        };
        const int begin = column(std::ceil(low)), end = column(std::floor(high) + 1.0);
        const Float4 floors = kRemainder * largest(of_row, width);
        for (int x = begin; x < end; ++x) {
            const float* sum = of_row + 5 * x;
            if (!(sum[4] >= kWeightFloor)) continue;
            const Float4 light = load<Float4>(sum);
            const bool covered = light[3] > floors[3];
            const auto large = size(light) > floors;
            const auto kept = covered ? large | (light > 0.0f) : large;
            Float4 made = kept ? light / sum[4] : Float4{};
            made[3] = covered ? std::min(1.0f, made[3]) : 0.0f;
            store(to + 4 * x, made);
        }
    }
}

}  // namespace

void bind_scatter_normalize(nanobind::module_& module) {
    module.def("reach_columns", &reach_columns, Unlocked());
    module.def("normalise_sums", &normalise_sums, Unlocked());
}

}  // namespace nlens

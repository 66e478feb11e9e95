// Edges where one surface of the object occludes another: `kernels/coc_discontinuities.py`.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "module.h"

namespace nlens {
namespace {

constexpr float kStraight = 0.955f, kDiagonal = 1.369f;  // chamfer distances: off by 4.5 % at most

// What counts as a step, see the constants of the Python module [px].
struct Step {
    double least, full, spare, beside;
    static constexpr auto fields = std::tuple{&Step::least, &Step::full, &Step::spare, &Step::beside};

    // How far a step reaches between two CoCs that are `step` apart.
    double reach(double step, float here, float there) const {
        const double share = std::min(1.0, (step - least) / (full - least));
        return share * (0.5 * static_cast<double>(std::max(std::fabs(here), std::fabs(there))) + spare);
    }
};

// How far what is at a pixel reaches, and the CoC half-way.
struct Marks {
    Array<float, 2> reach, split;
    static constexpr auto fields = std::tuple{&Marks::reach, &Marks::split};
};

// Marks both sides of every step; of several steps at one pixel the largest counts. `away` is the
// distance to the nearest hidden pixel, 0 where unknown.
bool find_steps(Array<const float, 2> coc, Array<const float, 2> alpha, Array<const float, 2> away,
                const Step& kind, const Marks& marks) {
    const int height = coc.shape[0], width = coc.shape[1];
    std::vector<float> largest(static_cast<std::size_t>(height) * width);
    bool found = false;
    const auto compare = [&](int one, int other) {
        const float here = coc.data[one], there = coc.data[other], step = std::fabs(here - there);
        if (step < kind.least) return;
        found = true;
        const double beside = away.data[here > there ? one : other] / kind.beside;
        const double radius = kind.reach(step, here, there) * std::min(std::max(2.0 - beside, 0.0), 1.0);
        if (radius <= 0.0) return;
        for (const int at : {one, other}) {
            marks.reach.data[at] = std::max(marks.reach.data[at], static_cast<float>(radius));
            if (step > largest[at]) {
                largest[at] = step;
                marks.split.data[at] = 0.5f * (here + there);
            }
        }
    };
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            const int at = y * width + x;
            if (alpha.data[at] <= 0.0f) continue;
            if (x + 1 < width && alpha.data[at + 1] > 0.0f) compare(at, at + 1);
            if (y + 1 < height && alpha.data[at + width] > 0.0f) compare(at, at + width);
        }
    }
    return found;
}

// Marks likewise where the object ends before nothing and hides something. `nearest` is the CoC of
// the nearest hidden pixel, and the distance to it.
bool find_rims(Array<const float, 2> coc, Array<const float, 2> alpha,
               std::tuple<Array<const float, 2>, Array<const float, 2>> nearest, const Step& kind,
               const Marks& marks) {
    const auto& [hidden_coc, away] = nearest;
    const int height = coc.shape[0], width = coc.shape[1];
    bool found = false;
    for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
            const int at = y * width + x;
            const float* here_alpha = alpha.data + at;
            if (*here_alpha <= 0.0f) continue;
            const bool rim = (x > 0 && here_alpha[-1] <= 0.0f) || (x + 1 < width && here_alpha[1] <= 0.0f) ||
                             (y > 0 && here_alpha[-width] <= 0.0f) ||
                             (y + 1 < height && here_alpha[width] <= 0.0f);
            const float here = coc.data[at], there = hidden_coc.data[at];
            if (!rim || here - there < kind.least) continue;
            double radius = kind.reach(here - there, here, there);
            radius = std::min(radius, 2.0 * (radius - away.data[at]));  // fades in with the distance
            if (radius > marks.reach.data[at]) {
                found = true;
                marks.reach.data[at] = static_cast<float>(radius);
                marks.split.data[at] = 0.5f * (here + there);
            }
        }
    }
    return found;
}

// Lets the reach of a row fall off from the row before it and, in the direction `step`, along it.
void sweep_row(float* row, const float* before, int width, int step) {
    if (before != nullptr) {
        for (int x = 0; x < width; ++x) {
            float best = std::max(row[x], before[x] - kStraight);
            if (x > 0) best = std::max(best, before[x - 1] - kDiagonal);
            if (x + 1 < width) best = std::max(best, before[x + 1] - kDiagonal);
            row[x] = best;
        }
    }
    const int first = step > 0 ? 0 : width - 1;
    for (int k = 1, x = first + step; k < width; ++k, x += step)
        row[x] = std::max(row[x], row[x - step] - kStraight);
}

// Lets every reach fall off by 1 a pixel (two chamfer sweeps).
void chamfer(Array<float, 2> reach) {
    const int height = reach.shape[0], width = reach.shape[1];
    for (int y = 0; y < height; ++y) sweep_row(reach.at(y), y > 0 ? reach.at(y - 1) : nullptr, width, 1);
    for (int y = height - 1; y >= 0; --y)
        sweep_row(reach.at(y), y + 1 < height ? reach.at(y + 1) : nullptr, width, -1);
}

// Gives every pixel the known value of its label.
void carry_labels(Array<const float, 2> values, Array<const bool, 2> known,
                  Array<const std::int32_t, 2> labels, Array<float, 2> out) {
    const std::size_t size = static_cast<std::size_t>(known.shape[0]) * known.shape[1];
    std::vector<float> of_label(size + 1);
    for (std::size_t i = 0; i < size; ++i) {
        if (known.data[i]) of_label[labels.data[i]] = values.data[i];
    }
    for (std::size_t i = 0; i < size; ++i) out.data[i] = of_label[labels.data[i]];
}

}  // namespace

void bind_coc_discontinuities(nanobind::module_& module) {
    module.def("find_steps", &find_steps, Unlocked());
    module.def("find_rims", &find_rims, Unlocked());
    module.def("chamfer", &chamfer, Unlocked());
    module.def("carry_labels", &carry_labels, Unlocked());
}

}  // namespace nlens

// A plane through a round lens: `kernels/scatter/plane_blur.py`.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

#include "module.h"

namespace nlens {
namespace {

constexpr float kUnit = 65536.0f;  // steps of a value of 1: sums of integers are exact

// Running sums of the values of each row, and the values, in steps: (3, h, pad + w + pad), where
// `sums` at a column is the total of all before it.
void sum_plane_rows(Array<const float, 3> values, int pad, Array<std::int32_t, 3> sums,
                    Array<float, 3> steps) {
    const int height = values.shape[0], width = values.shape[1], wide = width + 2 * pad;
    for (int c = 0; c < 3; ++c) {
        for (int y = 0; y < height; ++y) {
            const float* from = values.at(y) + c;
            std::int32_t *sum = sums.at(c, y), total = 0;
            float* step = steps.at(c, y);
            std::fill_n(sum, pad, 0);
            std::fill_n(step, wide, 0.0f);
            for (int x = 0; x < width; ++x) {
                const auto whole = static_cast<std::int32_t>(from[3 * x] * kUnit + 0.5f);
                sum[pad + x] = total;
                step[pad + x] = static_cast<float>(whole);
                total += whole;
            }
            std::fill_n(sum + pad + width, pad, total);
        }
    }
}

// Area of a half of the unit disc from its middle to a chord at `t`, |t| <= 1.
double half_segment(double t) {
    return 0.5 * (t * std::sqrt(std::max(1.0 - t * t, 0.0)) + std::asin(t));
}

// A run of columns that a disc covers in a row, from the pixel of its middle [px].
struct Run {
    int dy, first, end;
    float first_share, end_share;
};

// The runs of an ellipse: each row of pixels by its mean chord.
void find_runs(double rx, double ry, std::vector<Run>& runs) {
    runs.clear();
    const int reach = std::max(0, static_cast<int>(std::ceil(ry - 0.5)));
    for (int dy = -reach; dy <= reach; ++dy) {
        const double low = std::max((dy - 0.5) / ry, -1.0), high = std::min((dy + 0.5) / ry, 1.0);
        const double half = rx * ry * (half_segment(high) - half_segment(low));
        const double first = std::floor(0.5 - half), end = std::floor(0.5 + half);
        runs.push_back({dy, static_cast<int>(first), static_cast<int>(end),
                        static_cast<float>(0.5 - half - first), static_cast<float>(0.5 + half - end)});
    }
}

// Adds the runs' light of a channel to `count` pixels.
void add_run(const Run& run, const std::int32_t* sum, const float* step, int count, float* total) {
    const std::int32_t *first = sum + run.first, *end = sum + run.end;
    const float *at_first = step + run.first, *at_end = step + run.end;
    for (int x = 0; x < count; ++x)
        total[x] += static_cast<float>(end[x] - first[x]) +
                    (run.end_share * at_end[x] - run.first_share * at_first[x]);
}

// Blurs the rows [first, last) of `out` (h, w, 4), whose first pixel is the values' `corner`, row and
// column.
//
// `radii` (h, blocks) are the discs' half axes in columns, of `block` columns each.
void blur_plane_rows(Array<const std::int32_t, 3> sums, Array<const float, 3> steps, int pad,
                     Array<const double, 2> radii, int block, double pixel_aspect,
                     std::tuple<int, int> corner, Array<float, 3> out, std::tuple<int, int> rows) {
    const int height = sums.shape[1], width = out.shape[1];
    const auto [top, left] = corner;
    std::vector<Run> runs;
    std::vector<float> totals(3 * static_cast<std::size_t>(block));
    double known = -1.0;
    for (int y = std::get<0>(rows); y < std::get<1>(rows); ++y) {
        for (int begin = 0, number = 0; begin < width; begin += block, ++number) {
            const int count = std::min(block, width - begin);
            const double rx = radii(y, number), ry = rx * pixel_aspect;
            if (rx != known) find_runs(rx, ry, runs);
            known = rx;
            std::fill(totals.begin(), totals.end(), 0.0f);
            for (const Run& run : runs) {
                const int row = y + top + run.dy;
                if (row < 0 || row >= height) continue;
                const int column = pad + left + begin;
                for (int c = 0; c < 3; ++c)
                    add_run(run, sums.at(c, row) + column, steps.at(c, row) + column, count,
                            &totals[static_cast<std::size_t>(c) * block]);
            }
            const auto share = static_cast<float>(1.0 / (std::numbers::pi * rx * ry * kUnit));
            const float *red = totals.data(), *green = red + block, *blue = green + block;
            float* to = out.at(y, begin);
            for (int x = 0; x < count; ++x, to += 4) {
                to[0] = red[x] * share, to[1] = green[x] * share, to[2] = blue[x] * share;
                to[3] = (to[0] + to[1] + to[2]) * (1.0f / 3.0f);
            }
        }
    }
}

}  // namespace

void bind_plane_blur(nanobind::module_& module) {
    module.def("sum_plane_rows", &sum_plane_rows, Unlocked());
    module.def("blur_plane_rows", &blur_plane_rows, Unlocked());
}

}  // namespace nlens

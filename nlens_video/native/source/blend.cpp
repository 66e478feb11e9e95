// Samples to scene-linear light: `video/pixels/blend.py`.
#include <algorithm>
#include <cstdint>
#include <vector>

#include "light_codes.h"
#include "module.h"

namespace nlens {
namespace {

constexpr int kSide = 3;  // samples across and down of a mean; with 2, pans are measured half as precisely

// `display` is a table from light to codes, or empty.
template <class Sample>
void linear(Planes<const Sample> planes, std::tuple<Axis, Axis> axes, Pair corner, Matrix rgb_from_codes,
            Array<const float, 1> to_linear, Matrix to_bt709, Array<const float, 1> display,
            Array<float, 3> out) {
    const auto& [first, second, third] = planes;
    const auto& [across, down] = axes;
    const int width = out.shape[1];
    const bool coded = display.shape[0] > 0, same_primaries = is_identity(to_bt709);
    std::vector<int> columns(width);
    for (int j = 0; j < width; ++j) columns[j] = across.of(std::get<1>(corner) + j);
    std::vector<float> scratch(3 * static_cast<std::size_t>(width));
    float* const rows[3] = {scratch.data(), scratch.data() + width, scratch.data() + 2 * width};
    for (int i = 0; i < out.shape[0]; ++i) {
        const int y = std::get<0>(corner) + i, row = down.of(y);
        for (int j = 0; j < width; ++j) {
            rows[0][j] = static_cast<float>(first(y, std::get<1>(corner) + j));
            rows[1][j] = static_cast<float>(second(row, columns[j]));
            rows[2][j] = static_cast<float>(third(row, columns[j]));
        }
        apply_rows(rgb_from_codes, rows, width);
        for (float* values : rows) look_up_row(to_linear, values, width);
        if (!same_primaries) apply_rows(to_bt709, rows, width);
        float* to = out.at(i);
        for (int k = 0; k < 3; ++k) {
            if (coded) {
                for (int j = 0; j < width; ++j) rows[k][j] = std::min(std::max(rows[k][j], 0.0f), 1.0f);
                look_up_row(display, rows[k], width);
            }
            for (int j = 0; j < width; ++j) to[3 * j + k] = rows[k][j];
        }
    }
}

// The sample nearest to the middle of each of `count` cells over `length` samples.
std::vector<int> middles(int count, int length) {
    std::vector<int> places(count);
    for (int i = 0; i < count; ++i) places[i] = static_cast<int>((2LL * i + 1) * length / (2LL * count));
    return places;
}

// The mean of the nine samples of each of `count` cells of a row of cells.
template <class Sample>
void take_means(Plane<const Sample> plane, const int* rows, const int* columns, float* means, int count) {
    std::fill_n(means, count, 0.0f);
    for (int p = 0; p < kSide; ++p) {
        const Sample* row = plane.at(rows[p]);
        for (int q = 0; q < kSide; ++q) {
            for (int j = 0; j < count; ++j)
                means[j] += static_cast<float>(row[columns[kSide * j + q] * plane.strides[1]]);
        }
    }
    for (int j = 0; j < count; ++j) means[j] /= static_cast<float>(kSide * kSide);
}

template <class Sample>
void downsample(Planes<const Sample> planes, Matrix rgb_from_codes, Array<const float, 1> to_linear,
                Matrix to_bt709, Array<float, 3> out) {
    const auto& [first, second, third] = planes;
    const int count = out.shape[1], height = kSide * out.shape[0], width = kSide * count;
    const auto rows = middles(height, first.shape[0]), columns = middles(width, first.shape[1]);
    const auto coarse_rows = middles(height, second.shape[0]),
               coarse_columns = middles(width, second.shape[1]);
    std::vector<float> scratch(3 * static_cast<std::size_t>(count));
    float* const light[3] = {scratch.data(), scratch.data() + count, scratch.data() + 2 * count};
    for (int i = 0; i < out.shape[0]; ++i) {
        const int p = kSide * i;
        take_means(first, &rows[p], columns.data(), light[0], count);
        take_means(second, &coarse_rows[p], coarse_columns.data(), light[1], count);
        take_means(third, &coarse_rows[p], coarse_columns.data(), light[2], count);
        apply_rows(rgb_from_codes, light, count);
        for (float* row : light) look_up_row(to_linear, row, count);
        apply_rows(to_bt709, light, count);
        float* to = out.at(i);
        for (int k = 0; k < 3; ++k) {
            for (int j = 0; j < count; ++j) to[3 * j + k] = light[k][j];
        }
    }
}

template <class Sample>
void bind_samples(nanobind::module_& module) {
    module.def("linear", &linear<Sample>, Unlocked());
    module.def("downsample", &downsample<Sample>, Unlocked());
}

}  // namespace

void bind_blend(nanobind::module_& module) {
    module.attr("STEPS_BITS") = kStepBits;
    module.attr("FIRST_OCTAVE") = kFirstOctave;
    bind_samples<std::uint8_t>(module);
    bind_samples<std::uint16_t>(module);
    bind_samples<float>(module);
}

}  // namespace nlens

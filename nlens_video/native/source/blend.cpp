// Samples to scene-linear light: `video/pixels/blend.py`.
#include <algorithm>
#include <cstdint>
#include <vector>

#include "light_codes.h"
#include "module.h"

namespace nlens {
namespace {

constexpr int kSide = 3;  // samples across and down of a mean; with 2, pans are measured half as precisely

// Pixels of three components from a row of each.
void interleave(float* const* rows, float* __restrict pixels, int count) {
    const float *a = rows[0], *b = rows[1], *c = rows[2];
    for (int j = 0; j < count; ++j) pixels[3 * j] = a[j], pixels[3 * j + 1] = b[j], pixels[3 * j + 2] = c[j];
}

// Rows of some columns, from `left` on, of all three components of samples.
template <class Sample>
class RowReader {
public:
    RowReader(Planes<const Sample> planes, const std::tuple<Axis, Axis>& axes, int left, int width)
        : planes_(planes), down_(std::get<1>(axes)), left_(left), width_(width), columns_(width) {
        const Axis& across = std::get<0>(axes);
        coarse_left_ = across.of(left);
        for (int j = 0; j < width; ++j) columns_[j] = across.of(left + j) - coarse_left_;
        coarse_.resize(width > 0 ? columns_.back() + 1 : 0);
    }

    void load(int y, float* const* rows) {
        const auto& [first, second, third] = planes_;
        load_samples(first, y, left_, rows[0], width_);
        load_coarse(second, down_.of(y), rows[1]);
        load_coarse(third, down_.of(y), rows[2]);
    }

private:
    void load_coarse(Plane<const Sample> plane, int row, float* __restrict values) {
        load_samples(plane, row, coarse_left_, coarse_.data(), static_cast<int>(coarse_.size()));
        for (int j = 0; j < width_; ++j) values[j] = coarse_[columns_[j]];
    }

    Planes<const Sample> planes_;
    Axis down_;
    int left_, width_, coarse_left_;
    std::vector<int> columns_;
    std::vector<float> coarse_;
};

// Room for a row of three components.
struct Components {
    std::vector<float> values;
    float* const rows[3];

    explicit Components(int width)
        : values(3 * static_cast<std::size_t>(width)),
          rows{values.data(), values.data() + width, values.data() + 2 * width} {}
    Components(const Components&) = delete;  // its rows are its own values
};

// `display` is a table from light to codes, or empty.
template <class Sample>
void linear(Planes<const Sample> planes, std::tuple<Axis, Axis> axes, Pair corner, Matrix rgb_from_codes,
            Array<const float, 1> to_linear, Matrix to_bt709, Array<const float, 1> display,
            Array<float, 3> out) {
    const int width = out.shape[1];
    const auto [top, left] = corner;
    const bool coded = display.shape[0] > 0, same_primaries = is_identity(to_bt709);
    RowReader<Sample> reader(planes, axes, left, width);
    const Components room(width);
    for (int i = 0; i < out.shape[0]; ++i) {
        reader.load(top + i, room.rows);
        apply_rows(rgb_from_codes, room.rows, width);
        for (float* values : room.rows) look_up_row(to_linear, values, width);
        if (!same_primaries) apply_rows(to_bt709, room.rows, width);
        if (coded) {
            for (float* values : room.rows) {
                for (int j = 0; j < width; ++j) values[j] = std::min(std::max(values[j], 0.0f), 1.0f);
                look_up_row(display, values, width);
            }
        }
        interleave(room.rows, out.at(i), width);
    }
}

// The green light (N, side, side) of squares whose first columns and rows are given (N, 2).
template <class Sample>
void green_patches(Planes<const Sample> planes, std::tuple<Axis, Axis> axes,
                   Array<const std::int32_t, 2> corners, Matrix rgb_from_codes,
                   Array<const float, 1> to_linear, Matrix to_bt709, Array<float, 3> out) {
    const int side = out.shape[2];
    const bool same_primaries = is_identity(to_bt709);
    const Components room(side);
    for (int n = 0; n < out.shape[0]; ++n) {
        RowReader<Sample> reader(planes, axes, corners(n, 0), side);
        for (int i = 0; i < out.shape[1]; ++i) {
            float* green = out.at(n, i);
            reader.load(corners(n, 1) + i, room.rows);
            if (same_primaries) {
                combine_rows(rgb_from_codes, 1, room.rows, green, side);
                look_up_row(to_linear, green, side);
            } else {
                apply_rows(rgb_from_codes, room.rows, side);
                for (float* values : room.rows) look_up_row(to_linear, values, side);
                combine_rows(to_bt709, 1, room.rows, green, side);
            }
        }
    }
}

// The sample nearest to the middle of each of `count` cells over `length` samples.
std::vector<int> middles(int count, int length) {
    std::vector<int> places(count);
    for (int i = 0; i < count; ++i) places[i] = static_cast<int>((2LL * i + 1) * length / (2LL * count));
    return places;
}

// Takes the mean of the nine samples of each cell of a row of cells.
template <class Sample>
class CellMeans {
public:
    // `rows`, `columns`: of cells.
    CellMeans(Plane<const Sample> plane, int rows, int columns)
        : plane_(plane),
          rows_(middles(kSide * rows, plane.shape[0])),
          columns_(middles(kSide * columns, plane.shape[1])),
          row_(plane.shape[1]),
          sum_(plane.shape[1]) {}

    void take(int row, float* __restrict means, int count) {
        const int width = plane_.shape[1];
        const int *from = rows_.data() + kSide * row, *columns = columns_.data();
        load_samples(plane_, from[0], 0, sum_.data(), width);
        for (int p = 1; p < kSide; ++p) {
            load_samples(plane_, from[p], 0, row_.data(), width);
            for (int x = 0; x < width; ++x) sum_[x] += row_[x];
        }
        for (int j = 0; j < count; ++j) {
            float sum = 0.0f;
            for (int q = 0; q < kSide; ++q) sum += sum_[columns[kSide * j + q]];
            means[j] = sum / static_cast<float>(kSide * kSide);
        }
    }

private:
    Plane<const Sample> plane_;
    std::vector<int> rows_, columns_;
    std::vector<float> row_, sum_;
};

template <class Sample>
void downsample(Planes<const Sample> planes, Matrix rgb_from_codes, Array<const float, 1> to_linear,
                Matrix to_bt709, Array<float, 3> out) {
    const auto& [first, second, third] = planes;
    const int count = out.shape[1];
    CellMeans<Sample> cells[] = {
        {first, out.shape[0], count}, {second, out.shape[0], count}, {third, out.shape[0], count}};
    std::vector<float> scratch(3 * static_cast<std::size_t>(count));
    float* const light[3] = {scratch.data(), scratch.data() + count, scratch.data() + 2 * count};
    for (int i = 0; i < out.shape[0]; ++i) {
        for (int k = 0; k < 3; ++k) cells[k].take(i, light[k], count);
        apply_rows(rgb_from_codes, light, count);
        for (float* row : light) look_up_row(to_linear, row, count);
        apply_rows(to_bt709, light, count);
        interleave(light, out.at(i), count);
    }
}

template <class Sample>
void bind_samples(nanobind::module_& module) {
    module.def("linear", &linear<Sample>, Unlocked());
    module.def("green_patches", &green_patches<Sample>, Unlocked());
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

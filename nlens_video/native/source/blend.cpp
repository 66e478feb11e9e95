// Samples to scene-linear light, and a layer over them in light: `video/pixels/blend.py`.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
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

template <class Sample>
float mean(Plane<const Sample> plane, const int* rows, const int* columns) {
    float total = 0.0f;
    for (int p = 0; p < kSide; ++p) {
        for (int q = 0; q < kSide; ++q) total += static_cast<float>(plane(rows[p], columns[q]));
    }
    return total / static_cast<float>(kSide * kSide);
}

template <class Sample>
void downsample(Planes<const Sample> planes, Matrix rgb_from_codes, Array<const float, 1> to_linear,
                Matrix to_bt709, Array<float, 3> out) {
    const auto& [first, second, third] = planes;
    const int height = kSide * out.shape[0], width = kSide * out.shape[1];
    const auto rows = middles(height, first.shape[0]), columns = middles(width, first.shape[1]);
    const auto coarse_rows = middles(height, second.shape[0]),
               coarse_columns = middles(width, second.shape[1]);
    for (int i = 0; i < out.shape[0]; ++i) {
        float* to = out.at(i);
        const int p = kSide * i;
        for (int j = 0; j < out.shape[1]; ++j, to += 3) {
            const int q = kSide * j;
            const Rgb codes{mean(first, &rows[p], &columns[q]),
                            mean(second, &coarse_rows[p], &coarse_columns[q]),
                            mean(third, &coarse_rows[p], &coarse_columns[q])};
            const Rgb light = apply(to_bt709, look_up(to_linear, apply_affine(rgb_from_codes, codes)));
            to[0] = light.r, to[1] = light.g, to[2] = light.b;
        }
    }
}

// What the kernel of `composite_over` needs to know of the samples' coding.
struct Tables {
    Array<const float, 1> to_linear, to_coded;
    Matrix rgb_from_codes, codes_from_rgb, from_bt709, to_bt709;
    static constexpr auto fields =
        std::tuple{&Tables::to_linear,      &Tables::to_coded,   &Tables::rgb_from_codes,
                   &Tables::codes_from_rgb, &Tables::from_bt709, &Tables::to_bt709};
};

struct Flags {
    bool associated, of_plate;
    static constexpr auto fields = std::tuple{&Flags::associated, &Flags::of_plate};
};

template <class Sample>
void put(Plane<Sample> plane, int y, int x, float value, float peak) {
    if (peak > 0.0f) value = std::floor(std::min(std::max(value, 0.0f), peak) + 0.5f);
    plane(y, x) = static_cast<Sample>(value);
}

bool is_empty(const float* v) {
    return v[3] == 0.0f && v[0] == 0.0f && v[1] == 0.0f && v[2] == 0.0f;
}

// Whether the layer is not empty at any of a coarse sample's pixels.
bool touches(Array<const float, 3> rgba, int top, int rows, int left, int columns) {
    for (int y = std::max(top, 0); y < std::min(top + rows, rgba.shape[0]); ++y) {
        for (int x = std::max(left, 0); x < std::min(left + columns, rgba.shape[1]); ++x) {
            if (!is_empty(rgba.at(y, x))) return true;
        }
    }
    return false;
}

// The multiples of `step` from `low` to before `high`, of the first `count`.
Pair lanes(int low, int high, int step, int count) {
    const auto first_from = [step](int x) { return x > 0 ? (x + step - 1) / step : 0; };
    return {first_from(low), std::min(first_from(high), count)};
}

constexpr int kBlock = 64;  // coarse samples of a row that are composited at once
using Lane = float[kBlock];

// Pixels of the layer over those of the plate, of the same tap of the coarse samples of a block.
struct Pixels {
    Lane own[3], alpha;  // the layer
    Lane luma;           // the first component of the plate, then what it becomes
    Lane plate[3];       // codes, then coded red, green and blue
    Lane plate_alpha, behind[3];
    bool drawn[kBlock];  // where the layer is not empty
    int count;

    void clear() {
        for (Lane* lane : {&own[0], &own[1], &own[2], &alpha, &luma, &plate_alpha})
            std::fill_n(*lane, count, 0.0f);
        std::fill_n(drawn, count, false);
    }
};

// Replaces the layer's colours by the change of the plate's coded red, green and blue.
void find_changes(const Tables& tables, Flags flags, float peak, Pixels& pixels) {
    const int count = pixels.count;
    Lane free, gain;
    for (int k = 0; k < count; ++k) free[k] = 1.0f - pixels.alpha[k], gain[k] = 1.0f;
    if (!flags.associated) {
        for (int k = 0; k < count; ++k) {
            free[k] *= pixels.plate_alpha[k];
            const float covered = pixels.alpha[k] + free[k];
            gain[k] = covered > 0.0f ? 1.0f / covered : 1.0f;
        }
    }
    float* const plate[3] = {pixels.plate[0], pixels.plate[1], pixels.plate[2]};
    float* const own[3] = {pixels.own[0], pixels.own[1], pixels.own[2]};
    apply_rows(tables.rgb_from_codes, plate, count);
    for (int c = 0; c < 3; ++c) {
        std::copy_n(plate[c], count, pixels.behind[c]);
        look_up_row(tables.to_linear, pixels.behind[c], count);
    }
    if (flags.of_plate) {
        Lane light[3];
        float* const rows[3] = {light[0], light[1], light[2]};
        for (int c = 0; c < 3; ++c) std::copy_n(pixels.behind[c], count, light[c]);
        apply_rows(tables.to_bt709, rows, count);
        for (int c = 0; c < 3; ++c) {
            for (int k = 0; k < count; ++k) own[c][k] *= light[c][k];
        }
    }
    apply_rows(tables.from_bt709, own, count);
    for (int c = 0; c < 3; ++c) {
        float *made = own[c], *was = plate[c], *behind = pixels.behind[c];
        for (int k = 0; k < count; ++k) made[k] = (made[k] + free[k] * behind[k]) * gain[k];
        look_up_row(tables.to_coded, made, count);
        if (peak > 0.0f) {
            for (int k = 0; k < count; ++k)
                made[k] = std::min(std::max(made[k], std::min(was[k], 0.0f)), std::max(was[k], 1.0f));
        }
        for (int k = 0; k < count; ++k) made[k] -= was[k];
    }
}

// `before` holds the first component and alpha (height, width) of the box as they were.
template <class Sample>
void composite_over(Planes<Sample> planes, Plane<Sample> alpha, Flags flags,
                    std::tuple<Array<const Sample, 2>, Array<const Sample, 2>> before,
                    std::tuple<Axis, Axis> axes, Pair corner, Array<const float, 3> rgba,
                    const Tables& tables, float peak) {
    const auto& [first, second, third] = planes;
    const auto& [luma_before, alpha_before] = before;
    const auto& [across, down] = axes;
    const auto [y0, x0] = corner;
    const int height = first.shape[0], width = first.shape[1];
    const int y1 = y0 + rgba.shape[0], x1 = x0 + rgba.shape[1];
    const bool has_alpha = alpha.shape[0] > 0;
    const float full = peak > 0.0f ? peak : 1.0f;
    float m[3][3];
    for (int i = 0; i < 3; ++i) std::copy_n(tables.codes_from_rgb.at(i), 3, m[i]);
    const int columns = across.of(x1 - 1) + 1;
    Pixels pixels{};

    const auto of_change = [&m](int component, Rgb v) {
        return m[component][0] * v.r + m[component][1] * v.g + m[component][2] * v.b;
    };
    for (int row = down.of(y0); row <= down.of(y1 - 1); ++row) {
        const int top = row * down.step - down.phase;
        for (int begin = across.of(x0); begin < columns; begin += kBlock) {
            const int count = pixels.count = std::min(kBlock, columns - begin);
            bool touched[kBlock], any = false;
            for (int k = 0; k < count; ++k)
                any |= touched[k] = touches(rgba, top - y0, down.step,
                                            (begin + k) * across.step - across.phase - x0, across.step);
            if (!any) continue;
            Lane total{}, change_b{}, change_c{}, chroma_b, chroma_c;
            for (int k = 0; k < count; ++k) {
                chroma_b[k] = static_cast<float>(second(row, begin + k));
                chroma_c[k] = static_cast<float>(third(row, begin + k));
            }
            for (int p = 0; p < down.weights.shape[0]; ++p) {
                const int y = top + down.first + p;
                if (y < 0 || y >= height) continue;
                const bool in_rows = y0 <= y && y < y1, own_row = top <= y && y < top + down.step;
                for (int q = 0; q < across.weights.shape[0]; ++q) {
                    const float weight = down.weights(p) * across.weights(q);
                    const int tap = across.first + q, start = begin * across.step - across.phase + tap;
                    const auto [in_first, in_end] = lanes(-start, width - start, across.step, count);
                    for (int k = in_first; k < in_end; ++k) total[k] += weight;
                    const auto [k0, k1] = lanes(x0 - start, x1 - start, across.step, count);
                    if (!in_rows || k0 >= k1) continue;
                    pixels.clear();
                    const float* const layer = rgba.at(y - y0);
                    bool drawn = false;
                    for (int k = k0; k < k1; ++k) {
                        const int x = start + k * across.step - x0;
                        const float* v = layer + 4 * x;
                        const bool here = touched[k] && !is_empty(v);
                        pixels.drawn[k] = here, drawn |= here;
                        for (int c = 0; c < 3; ++c) pixels.own[c][k] = v[c];
                        pixels.alpha[k] = v[3];
                        pixels.luma[k] = static_cast<float>(luma_before(y - y0, x));
                        pixels.plate_alpha[k] =
                            has_alpha ? static_cast<float>(alpha_before(y - y0, x)) / full : 1.0f;
                    }
                    if (!drawn) continue;
                    std::copy_n(pixels.luma, count, pixels.plate[0]);
                    std::copy_n(chroma_b, count, pixels.plate[1]);
                    std::copy_n(chroma_c, count, pixels.plate[2]);
                    find_changes(tables, flags, peak, pixels);
                    for (int k = k0; k < k1; ++k) {
                        const Rgb change{pixels.own[0][k], pixels.own[1][k], pixels.own[2][k]};
                        const float with_b = change_b[k] + weight * of_change(1, change);
                        const float with_c = change_c[k] + weight * of_change(2, change);
                        change_b[k] = pixels.drawn[k] ? with_b : change_b[k];
                        change_c[k] = pixels.drawn[k] ? with_c : change_c[k];
                        pixels.luma[k] += of_change(0, change);
                    }
                    if (!own_row || tap < 0 || tap >= across.step) continue;
                    for (int k = k0; k < k1; ++k) {
                        if (!pixels.drawn[k]) continue;
                        const int x = start + k * across.step;
                        put(first, y, x, pixels.luma[k], peak);
                        if (has_alpha) {
                            const float bare = (1.0f - pixels.alpha[k]) * (1.0f - pixels.plate_alpha[k]);
                            put(alpha, y, x, (1.0f - bare) * full, peak);
                        }
                    }
                }
            }
            for (int k = 0; k < count; ++k) {
                if (!touched[k]) continue;
                put(second, row, begin + k, chroma_b[k] + change_b[k] / total[k], peak);
                put(third, row, begin + k, chroma_c[k] + change_c[k] / total[k], peak);
            }
        }
    }
}

template <class Sample>
void bind_samples(nanobind::module_& module) {
    module.def("linear", &linear<Sample>, Unlocked());
    module.def("downsample", &downsample<Sample>, Unlocked());
    module.def("composite_over", &composite_over<Sample>, Unlocked());
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

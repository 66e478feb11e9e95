// Samples to scene-linear light, and a layer over them in light: `video/pixels/blend.py`.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <vector>

#include "module.h"

namespace nlens {
namespace {

// Tables over octaves of light, each in `2^kStepBits` steps, see `samples.py`.
constexpr int kStepBits = 7, kFirstOctave = -40, kShift = 23 - kStepBits;
constexpr int kFirstPiece = (127 + kFirstOctave) << kStepBits;
constexpr std::int32_t kMask = (1 << kShift) - 1;
constexpr float kSmallest = 0x1p-40f, kFraction = 1.0f / (1 << kShift);
constexpr int kSide = 3;  // samples across and down of a mean; with 2, pans are measured half as precisely

// What a table gives at a value of any sign: the float's exponent and mantissa are the position.
float look_up(Array<const float, 1> table, float value) {
    const float size = std::fabs(value);
    float found;
    if (size < kSmallest) {
        found = table(0) + (table(1) - table(0)) * (size / kSmallest);
    } else {
        const auto bits = std::bit_cast<std::int32_t>(size);
        const int piece = std::min((bits >> kShift) - kFirstPiece + 1, table.shape[0] - 2);
        const float low = table(piece);
        found = low + (table(piece + 1) - low) * (static_cast<float>(bits & kMask) * kFraction);
    }
    return value >= 0.0f ? found : -found;
}

struct Rgb {
    float r, g, b;
};

Rgb look_up(Array<const float, 1> table, Rgb v) {
    return {look_up(table, v.r), look_up(table, v.g), look_up(table, v.b)};
}

using Matrix = Array<const float, 2>;  // (3, 3), or (3, 4) with an offset

float dot(Matrix matrix, int row, Rgb v) {
    return matrix(row, 0) * v.r + matrix(row, 1) * v.g + matrix(row, 2) * v.b;
}

Rgb apply(Matrix matrix, Rgb v) {
    return {dot(matrix, 0, v), dot(matrix, 1, v), dot(matrix, 2, v)};
}

Rgb apply_affine(Matrix matrix, Rgb v) {
    const Rgb turned = apply(matrix, v);
    return {turned.r + matrix(0, 3), turned.g + matrix(1, 3), turned.b + matrix(2, 3)};
}

template <class Sample>
using Plane = Strided<Sample, 2>;
template <class Sample>
using Planes = std::tuple<Plane<Sample>, Plane<Sample>, Plane<Sample>>;
using Pair = std::tuple<int, int>;

// How the chroma planes lie to the luma plane, see `samples.Axis`.
struct Axis {
    int step, phase, first;
    Array<const float, 1> weights;
    static constexpr auto fields = std::tuple{&Axis::step, &Axis::phase, &Axis::first, &Axis::weights};

    int of(int luma) const { return (luma + phase) / step; }  // not negative
};

// Replaces the values of a row by what a table gives, as `look_up`; without branches, so that several
// are looked up at once.
void look_up_row(Array<const float, 1> table, float* __restrict row, int count) {
    const float* __restrict entries = table.data;
    const int last = table.shape[0] - 2;
    const float first = entries[0], slope = entries[1] - entries[0];
    for (int x = 0; x < count; ++x) {
        const float value = row[x], size = std::fabs(value);
        const auto bits = std::bit_cast<std::int32_t>(size);
        const int piece = std::min(std::max((bits >> kShift) - kFirstPiece + 1, 0), last);
        const float low = entries[piece], next = entries[piece + 1];
        const float between = low + (next - low) * (static_cast<float>(bits & kMask) * kFraction);
        const float found = size < kSmallest ? first + slope * (size / kSmallest) : between;
        row[x] = value >= 0.0f ? found : -found;
    }
}

// Three rows of numbers, replaced by a matrix's products with them, and its offsets if it has any.
void apply_rows(Matrix matrix, float* const* rows, int count) {
    float* __restrict a = rows[0], * __restrict b = rows[1], * __restrict c = rows[2];
    const bool affine = matrix.shape[1] == 4;
    float m[3][4];
    for (int k = 0; k < 3; ++k) {
        for (int j = 0; j < 4; ++j) m[k][j] = j < 3 || affine ? matrix(k, j) : 0.0f;
    }
    for (int x = 0; x < count; ++x) {
        const float u = a[x], v = b[x], w = c[x];
        const float r = m[0][0] * u + m[0][1] * v + m[0][2] * w;
        const float g = m[1][0] * u + m[1][1] * v + m[1][2] * w;
        const float l = m[2][0] * u + m[2][1] * v + m[2][2] * w;
        a[x] = affine ? r + m[0][3] : r;
        b[x] = affine ? g + m[1][3] : g;
        c[x] = affine ? l + m[2][3] : l;
    }
}

bool is_identity(Matrix matrix) {
    for (int k = 0; k < 3; ++k) {
        for (int j = 0; j < 3; ++j) {
            if (matrix(k, j) != (k == j ? 1.0f : 0.0f)) return false;
        }
    }
    return true;
}

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

// The pixel `v` over the plate's codes: their change as coded red, green and blue.
Rgb change_of(const Tables& tables, Flags flags, float peak, const float* v, Rgb codes, float plate_alpha) {
    float free = 1.0f - v[3], gain = 1.0f;
    if (!flags.associated) {
        free *= plate_alpha;
        const float covered = v[3] + free;
        gain = covered > 0.0f ? 1.0f / covered : 1.0f;
    }
    const Rgb plate = apply_affine(tables.rgb_from_codes, codes);
    Rgb behind{}, own{v[0], v[1], v[2]};
    if (free != 0.0f || flags.of_plate) behind = look_up(tables.to_linear, plate);
    if (flags.of_plate) {
        const Rgb light = apply(tables.to_bt709, behind);
        own = {own.r * light.r, own.g * light.g, own.b * light.b};
    }
    const Rgb over = apply(tables.from_bt709, own);
    const auto coded = [&](float light, float back, float was) {
        float made = look_up(tables.to_coded, (light + free * back) * gain);
        if (peak > 0.0f) made = std::min(std::max(made, std::min(was, 0.0f)), std::max(was, 1.0f));
        return made - was;
    };
    return {coded(over.r, behind.r, plate.r), coded(over.g, behind.g, plate.g),
            coded(over.b, behind.b, plate.b)};
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
    for (int row = down.of(y0); row <= down.of(y1 - 1); ++row) {
        const int top = row * down.step - down.phase;
        for (int column = across.of(x0); column <= across.of(x1 - 1); ++column) {
            const int left = column * across.step - across.phase;
            bool touched = false;
            for (int y = std::max(top, y0); y < std::min(top + down.step, y1); ++y) {
                for (int x = std::max(left, x0); x < std::min(left + across.step, x1); ++x) {
                    touched |= !is_empty(rgba.at(y - y0, x - x0));
                }
            }
            if (!touched) continue;
            const float b = static_cast<float>(second(row, column)),
                        c = static_cast<float>(third(row, column));
            float total = 0.0f, change_b = 0.0f, change_c = 0.0f;
            for (int p = 0; p < down.weights.shape[0]; ++p) {
                const int y = top + down.first + p;
                if (y < 0 || y >= height) continue;
                for (int q = 0; q < across.weights.shape[0]; ++q) {
                    const int x = left + across.first + q;
                    if (x < 0 || x >= width) continue;
                    const float weight = down.weights(p) * across.weights(q);
                    total += weight;
                    if (y < y0 || y >= y1 || x < x0 || x >= x1) continue;
                    const float* v = rgba.at(y - y0, x - x0);
                    if (is_empty(v)) continue;
                    const float a = static_cast<float>(luma_before(y - y0, x - x0));
                    const float plate_alpha =
                        has_alpha ? static_cast<float>(alpha_before(y - y0, x - x0)) / full : 1.0f;
                    const Rgb change = change_of(tables, flags, peak, v, {a, b, c}, plate_alpha);
                    change_b += weight * dot(tables.codes_from_rgb, 1, change);
                    change_c += weight * dot(tables.codes_from_rgb, 2, change);
                    if (y < top || y >= top + down.step || x < left || x >= left + across.step) continue;
                    put(first, y, x, a + dot(tables.codes_from_rgb, 0, change), peak);
                    if (has_alpha) {
                        const float bare = (1.0f - v[3]) * (1.0f - plate_alpha);
                        put(alpha, y, x, (1.0f - bare) * full, peak);
                    }
                }
            }
            put(second, row, column, b + change_b / total, peak);
            put(third, row, column, c + change_c / total, peak);
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

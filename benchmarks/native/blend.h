// A layer over the samples of a frame, in light: `video/pixels/blend.py`.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>

namespace nlens {
namespace {

// Tables over octaves of light, each in `2^kStepBits` steps.
constexpr int kStepBits = 7, kFirstOctave = -40, kShift = 23 - kStepBits;
constexpr int kFirstPiece = (127 + kFirstOctave) << kStepBits;
constexpr std::int32_t kMask = (1 << kShift) - 1;
constexpr float kSmallest = 0x1p-40f, kFraction = 1.0f / (1 << kShift);

struct Table {
    const float* values;
    int count;

    // At a value of any sign: the float's exponent and mantissa are the position.
    float operator()(float value) const {
        const float size = std::fabs(value);
        float found;
        if (size < kSmallest) {
            found = values[0] + (values[1] - values[0]) * (size / kSmallest);
        } else {
            const auto bits = std::bit_cast<std::int32_t>(size);
            const int piece = std::min((bits >> kShift) - kFirstPiece + 1, count - 2);
            const float low = values[piece];
            found = low + (values[piece + 1] - low) * (static_cast<float>(bits & kMask) * kFraction);
        }
        return value >= 0.0f ? found : -found;
    }
};

struct Rgb {
    float r, g, b;
};

// Rows of three numbers, or of three and an offset.
struct Matrix {
    const float* values;
    int columns;

    float dot(int row, Rgb v) const {
        const float* m = values + row * columns;
        return m[0] * v.r + m[1] * v.g + m[2] * v.b;
    }
    Rgb apply(Rgb v) const { return {dot(0, v), dot(1, v), dot(2, v)}; }
    Rgb apply_affine(Rgb v) const {
        return {dot(0, v) + values[3], dot(1, v) + values[columns + 3], dot(2, v) + values[2 * columns + 3]};
    }
};

inline Rgb each(const Table& table, Rgb v) { return {table(v.r), table(v.g), table(v.b)}; }

template <class Sample>
struct Plane2 {
    Sample* values;
    std::ptrdiff_t row, column;  // numbers from one to the next
    int height, width;

    Sample& at(int y, int x) const { return values[y * row + x * column]; }
};

// How the chroma planes lie to the luma plane, see `samples.Axis`.
struct Axis {
    int step, phase, first;
    const float* weights;
    int count;

    int of(int luma) const { return (luma + phase) / step; }  // not negative
};

struct Coding {
    Table to_linear, to_coded;
    Matrix rgb_from_codes, codes_from_rgb, from_bt709, to_bt709;
    float peak;
};

template <class Sample>
inline void put(const Plane2<Sample>& plane, int y, int x, float value, float peak) {
    if (peak > 0.0f) value = std::floor(std::min(std::max(value, 0.0f), peak) + 0.5f);
    plane.at(y, x) = static_cast<Sample>(value);
}

struct Rgba {
    float r, g, b, a;

    bool empty() const { return a == 0.0f && r == 0.0f && g == 0.0f && b == 0.0f; }
};

template <class Sample>
struct Frame {
    Plane2<Sample> first, second, third, alpha;  // alpha of height 0: none
    bool associated, of_plate;
};

struct Target {
    int y0, x0, height, width;
    const Rgba* rgba;
};

// The pixel over the plate's codes: their change as coded red, green and blue.
template <class Sample>
inline Rgb change_of(const Frame<Sample>& frame, const Coding& coding, Rgba v, Rgb codes, float plate_alpha) {
    float free = 1.0f - v.a, gain = 1.0f;
    if (!frame.associated) {
        free *= plate_alpha;
        const float covered = v.a + free;
        gain = covered > 0.0f ? 1.0f / covered : 1.0f;
    }
    const Rgb plate = coding.rgb_from_codes.apply_affine(codes);
    Rgb behind{}, own{v.r, v.g, v.b};
    if (free != 0.0f || frame.of_plate) behind = each(coding.to_linear, plate);
    if (frame.of_plate) {
        const Rgb light = coding.to_bt709.apply(behind);
        own = {own.r * light.r, own.g * light.g, own.b * light.b};
    }
    const Rgb over = coding.from_bt709.apply(own);
    const auto coded = [&](float light, float back, float was) {
        float made = coding.to_coded((light + free * back) * gain);
        if (coding.peak > 0.0f) made = std::min(std::max(made, std::min(was, 0.0f)), std::max(was, 1.0f));
        return made - was;
    };
    return {coded(over.r, behind.r, plate.r), coded(over.g, behind.g, plate.g), coded(over.b, behind.b, plate.b)};
}

// `luma` and `alpha` (height, width) hold what the planes held before, in the target's box.
template <class Sample>
inline void composite_over(const Frame<Sample>& frame, const Sample* luma, const Sample* alpha,
                           const Axis& across, const Axis& down, const Target& box, const Coding& coding) {
    const int height = frame.first.height, width = frame.first.width;
    const int y1 = box.y0 + box.height, x1 = box.x0 + box.width;
    const bool has_alpha = frame.alpha.height > 0;
    const float full = coding.peak > 0.0f ? coding.peak : 1.0f;
    for (int row = down.of(box.y0); row <= down.of(y1 - 1); ++row) {
        const int top = row * down.step - down.phase;
        for (int column = across.of(box.x0); column <= across.of(x1 - 1); ++column) {
            const int left = column * across.step - across.phase;
            bool touched = false;
            for (int y = std::max(top, box.y0); y < std::min(top + down.step, y1); ++y) {
                for (int x = std::max(left, box.x0); x < std::min(left + across.step, x1); ++x) {
                    touched |= !box.rgba[(y - box.y0) * box.width + x - box.x0].empty();
                }
            }
            if (!touched) continue;
            const float b = static_cast<float>(frame.second.at(row, column));
            const float c = static_cast<float>(frame.third.at(row, column));
            float total = 0.0f, change_b = 0.0f, change_c = 0.0f;
            for (int p = 0; p < down.count; ++p) {
                const int y = top + down.first + p;
                if (y < 0 || y >= height) continue;
                for (int q = 0; q < across.count; ++q) {
                    const int x = left + across.first + q;
                    if (x < 0 || x >= width) continue;
                    const float weight = down.weights[p] * across.weights[q];
                    total += weight;
                    if (y < box.y0 || y >= y1 || x < box.x0 || x >= x1) continue;
                    const std::ptrdiff_t at = (y - box.y0) * box.width + x - box.x0;
                    const Rgba v = box.rgba[at];
                    if (v.empty()) continue;
                    const float a = static_cast<float>(luma[at]);
                    const float plate_alpha = has_alpha ? static_cast<float>(alpha[at]) / full : 1.0f;
                    const Rgb change = change_of(frame, coding, v, {a, b, c}, plate_alpha);
                    change_b += weight * coding.codes_from_rgb.dot(1, change);
                    change_c += weight * coding.codes_from_rgb.dot(2, change);
                    if (y < top || y >= top + down.step || x < left || x >= left + across.step) continue;
                    put(frame.first, y, x, a + coding.codes_from_rgb.dot(0, change), coding.peak);
                    if (has_alpha) {
                        const float bare = (1.0f - v.a) * (1.0f - plate_alpha);
                        put(frame.alpha, y, x, (1.0f - bare) * full, coding.peak);
                    }
                }
            }
            put(frame.second, row, column, b + change_b / total, coding.peak);
            put(frame.third, row, column, c + change_c / total, coding.peak);
        }
    }
}

}  // namespace
}  // namespace nlens

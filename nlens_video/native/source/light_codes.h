// Codes and light: tables of transfer functions, matrices, and how planes lie to each other.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <tuple>
#include <type_traits>

#include "arrays.h"

namespace nlens {

// Tables over octaves of light, each in `2^kStepBits` steps, see `samples.py`.
constexpr int kStepBits = 7, kFirstOctave = -40, kShift = 23 - kStepBits;
constexpr int kFirstPiece = (127 + kFirstOctave) << kStepBits;
constexpr std::int32_t kMask = (1 << kShift) - 1;
constexpr float kSmallest = 0x1p-40f, kFraction = 1.0f / (1 << kShift);

using Matrix = Array<const float, 2>;  // (3, 3), or (3, 4) with an offset

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

// A sample as a number. In pictures of renderers some are not finite: what is infinite is taken for
// white, what is no number for black.
template <class Sample>
inline float number(Sample sample) {
    const float value = static_cast<float>(sample);
    if constexpr (std::is_floating_point_v<Sample>) {
        constexpr float infinite = std::numeric_limits<float>::infinity();
        return std::fabs(value) < infinite ? value : value > 0.0f ? 1.0f : 0.0f;
    }
    return value;
}

// The samples of a row from a column on, as numbers.
template <class Sample>
void load_samples(Plane<const Sample> plane, int y, int x, float* __restrict values, int count) {
    const Sample* samples = plane.at(y, x);
    const std::ptrdiff_t step = plane.strides[1];
    if (step == 1) {
        for (int j = 0; j < count; ++j) values[j] = number(samples[j]);
    } else {
        for (int j = 0; j < count; ++j) values[j] = number(samples[j * step]);
    }
}

// Replaces the values of a row, of any sign, by what a table gives: a float's exponent and mantissa
// are its position. Without branches, so that several are looked up at once; two neighbouring entries
// are read together, which takes half as many reads.
inline void look_up_row(Array<const float, 1> table, float* __restrict row, int count) {
    static_assert(std::endian::native == std::endian::little);
    const float* __restrict entries = table.data;
    const int last = table.shape[0] - 2;
    const float first = entries[0], slope = entries[1] - entries[0];
    for (int x = 0; x < count; ++x) {
        const float value = row[x], size = std::fabs(value);
        const auto bits = std::bit_cast<std::int32_t>(size);
        const int piece = std::min(std::max((bits >> kShift) - kFirstPiece + 1, 0), last);
        std::uint64_t both;
        std::memcpy(&both, entries + piece, sizeof(both));
        const float low = std::bit_cast<float>(static_cast<std::uint32_t>(both));
        const float next = std::bit_cast<float>(static_cast<std::uint32_t>(both >> 32));
        const float between = low + (next - low) * (static_cast<float>(bits & kMask) * kFraction);
        const float found = size < kSmallest ? first + slope * (size / kSmallest) : between;
        row[x] = value >= 0.0f ? found : -found;
    }
}

// Three rows of numbers, replaced by a matrix's products with them, and its offsets if it has any.
inline void apply_rows(Matrix matrix, float* const* rows, int count) {
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

// One row of a matrix's products with three rows of numbers, as of `apply_rows`.
inline void combine_rows(Matrix matrix, int number, float* const* rows, float* __restrict made, int count) {
    const float* __restrict a = rows[0], * __restrict b = rows[1], * __restrict c = rows[2];
    const float* m = matrix.at(number);
    const bool affine = matrix.shape[1] == 4;
    const float u = m[0], v = m[1], w = m[2], offset = affine ? m[3] : 0.0f;
    for (int x = 0; x < count; ++x) {
        const float sum = u * a[x] + v * b[x] + w * c[x];
        made[x] = affine ? sum + offset : sum;
    }
}

inline bool is_identity(Matrix matrix) {
    for (int k = 0; k < 3; ++k) {
        for (int j = 0; j < 3; ++j) {
            if (matrix(k, j) != (k == j ? 1.0f : 0.0f)) return false;
        }
    }
    return true;
}

}  // namespace nlens

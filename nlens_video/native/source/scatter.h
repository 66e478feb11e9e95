// What the kernels of the scatter share: the numbers of a level's pixels, and arguments of theirs.
#pragma once

#include <algorithm>
#include <bit>
#include <cstdint>
#include <tuple>

#include "arrays.h"

namespace nlens {

// Numbers of each pixel of a level, as `levels.RADIUS` and on.
enum Number { kRadius, kAxis, kSpan, kStamp, kAlong, kDown, kStampRadius, kBarrelX, kBarrelY };

struct Band {
    int begin, end;  // rows
    static constexpr auto fields = std::tuple{&Band::begin, &Band::end};
};

struct Place {
    int row, column;
    static constexpr auto fields = std::tuple{&Place::row, &Place::column};
};

// Numbers that are not negative lie in the order of their bits, which a loop over many of them compares
// several at a time; NaN is the largest.
inline std::int32_t bits_of_size(float size) {
    return std::bit_cast<std::int32_t>(size) & 0x7fffffff;
}
inline float size_of_bits(std::int32_t bits) {
    return std::bit_cast<float>(bits);
}

// Which pixels of a row take part: the largest size of theirs, and the first and last column, `width` and -1
// where none does. Written without branches, so that it compiles to loops over several at a time.
struct Taken {
    std::int32_t most = 0, left = 0, right = 0;

    void take(bool taken, std::int32_t size_bits, int x, int width) {
        const std::int32_t mask = -static_cast<std::int32_t>(taken);
        most = std::max(most, size_bits & mask);
        left = std::max(left, (width - x) & mask);
        right = std::max(right, (x + 1) & mask);
    }
    int first(int width) const { return width - left; }
    int last() const { return right - 1; }
};

}  // namespace nlens

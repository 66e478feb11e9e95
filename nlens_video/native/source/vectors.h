// Vectors of a fixed number of lanes; GCC and Clang translate them to any processor.
#pragma once

#include <cstdint>
#include <cstring>

namespace nlens {

using Float4 = float __attribute__((vector_size(16)));
using Float8 = float __attribute__((vector_size(32)));
using Double4 = double __attribute__((vector_size(32)));

template <class Lanes, class Number>
inline Lanes load(const Number* from) {
    Lanes made;
    std::memcpy(&made, from, sizeof made);
    return made;
}

template <class Lanes, class Number>
inline void store(Number* to, Lanes made) {
    std::memcpy(to, &made, sizeof made);
}

}  // namespace nlens

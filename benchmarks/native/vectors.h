// Vectors of a fixed number of lanes; GCC and Clang translate them to any processor.
#pragma once

#include <cstdint>
#include <cstring>

namespace nlens {

using Float4 = float __attribute__((vector_size(16)));
using Float8 = float __attribute__((vector_size(32)));
using Double4 = double __attribute__((vector_size(32)));

template <class Vector, class Number>
inline Vector load(const Number* from) {
    Vector made;
    std::memcpy(&made, from, sizeof made);
    return made;
}

template <class Vector, class Number>
inline void store(Number* to, Vector made) {
    std::memcpy(to, &made, sizeof made);
}

}  // namespace nlens

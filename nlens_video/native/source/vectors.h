// Vectors of a fixed number of lanes; GCC and Clang translate them to any processor.
#pragma once

#include <cstdint>
#include <cstring>

namespace nlens {

using Float4 = float __attribute__((vector_size(16)));
using Float8 = float __attribute__((vector_size(32)));
using Double4 = double __attribute__((vector_size(32)));

// As many lanes as registers of this level have, for kernels whose lanes know nothing of each other:
// wider vectors than the registers are many times slower.
#if defined(__AVX512F__)
using Floats = float __attribute__((vector_size(64)));
#elif defined(__AVX__)
using Floats = Float8;
#else
using Floats = Float4;
#endif

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

// NumPy arrays as kernels see them: the first element, the shape, and strides where they vary.
#pragma once

#include <cstddef>

namespace nlens {

// A C-contiguous array. `T` is const for arrays that a kernel only reads.
template <class T, int N>
struct Array {
    T* data;
    int shape[N];

    // The elements behind the leading indices: a number for all of them, else a row or a plane.
    template <class... Index>
    T* at(Index... index) const {
        static_assert(sizeof...(index) <= N);
        const std::ptrdiff_t places[] = {static_cast<std::ptrdiff_t>(index)...};
        std::ptrdiff_t offset = 0;
        for (int axis = 0; axis < N; ++axis) {
            offset *= shape[axis];
            if (axis < static_cast<int>(sizeof...(index))) offset += places[axis];
        }
        return data + offset;
    }

    template <class... Index>
    T& operator()(Index... index) const {
        static_assert(sizeof...(index) == N);
        return *at(index...);
    }
};

// An array of any strides, which count elements.
template <class T, int N>
struct Strided {
    T* data;
    int shape[N];
    std::ptrdiff_t strides[N];

    template <class... Index>
    T* at(Index... index) const {
        static_assert(sizeof...(index) <= N);
        const std::ptrdiff_t places[] = {static_cast<std::ptrdiff_t>(index)...};
        std::ptrdiff_t offset = 0;
        for (int axis = 0; axis < static_cast<int>(sizeof...(index)); ++axis)
            offset += places[axis] * strides[axis];
        return data + offset;
    }

    template <class... Index>
    T& operator()(Index... index) const {
        static_assert(sizeof...(index) == N);
        return *at(index...);
    }
};

}  // namespace nlens

// How arguments come from Python: arrays by type, dimensions and layout, named tuples by field.
//
// A struct that a named tuple fills lists its fields in the tuple's order:
//     static constexpr auto fields = std::tuple{&Discs::stamps, &Discs::spans};
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/tuple.h>

#include <tuple>
#include <type_traits>
#include <utility>

#include "arrays.h"

namespace nlens {
template <class T>
concept FromTuple = requires { T::fields; };
}  // namespace nlens

namespace nanobind::detail {

// Never converted: a copy would swallow what a kernel writes, and cost time unseen.
inline std::uint8_t exactly(std::uint8_t flags) {
    return flags & static_cast<std::uint8_t>(~static_cast<std::uint8_t>(cast_flags::convert));
}

template <class T, int N>
struct type_caster<nlens::Array<T, N>> {
    using Held = ndarray<T, numpy, ndim<N>, c_contig, device::cpu>;
    using Seen = nlens::Array<T, N>;
    NB_TYPE_CASTER(Seen, make_caster<Held>::Name)

    bool from_python(handle source, std::uint8_t flags, cleanup_list* cleanup) noexcept {
        make_caster<Held> caster;
        if (!caster.from_python(source, exactly(flags), cleanup)) return false;
        value.data = caster.value.data();
        for (int axis = 0; axis < N; ++axis) value.shape[axis] = static_cast<int>(caster.value.shape(axis));
        return true;
    }
};

template <class T, int N>
struct type_caster<nlens::Strided<T, N>> {
    using Held = ndarray<T, numpy, ndim<N>, device::cpu>;
    using Seen = nlens::Strided<T, N>;
    NB_TYPE_CASTER(Seen, make_caster<Held>::Name)

    bool from_python(handle source, std::uint8_t flags, cleanup_list* cleanup) noexcept {
        make_caster<Held> caster;
        if (!caster.from_python(source, exactly(flags), cleanup)) return false;
        value.data = caster.value.data();
        for (int axis = 0; axis < N; ++axis) {
            value.shape[axis] = static_cast<int>(caster.value.shape(axis));
            value.strides[axis] = caster.value.stride(axis);
        }
        return true;
    }
};

template <class T>
struct type_caster<T, enable_if_t<nlens::FromTuple<T>>> {
    NB_TYPE_CASTER(T, const_name("tuple"))

    bool from_python(handle source, std::uint8_t flags, cleanup_list* cleanup) noexcept {
        constexpr auto count = std::tuple_size_v<decltype(T::fields)>;
        if (!PyTuple_Check(source.ptr()) || PyTuple_GET_SIZE(source.ptr()) != count) return false;
        return filled(source.ptr(), flags, cleanup, std::make_index_sequence<count>());
    }

private:
    template <std::size_t... I>
    bool filled(PyObject* source, std::uint8_t flags, cleanup_list* cleanup,
                std::index_sequence<I...>) noexcept {
        return (field(PyTuple_GET_ITEM(source, I), flags, cleanup, std::get<I>(T::fields)) && ...);
    }

    template <class Field>
    bool field(PyObject* item, std::uint8_t flags, cleanup_list* cleanup, Field T::* member) noexcept {
        make_caster<Field> caster;
        if (!caster.from_python(item, flags, cleanup)) return false;
        value.*member = caster.operator cast_t<Field>();
        return true;
    }
};

}  // namespace nanobind::detail

// Python bindings. Arrays are checked for type, dimensions and layout before a kernel runs.
#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/array.h>
#include <nanobind/stl/pair.h>
#include <nanobind/stl/string.h>
#include <nanobind/stl/tuple.h>

#include <cstdlib>
#include <string>

#include "kernels.h"

namespace nb = nanobind;
using namespace nb::literals;

namespace {

template <class T, int N>
using In = nb::ndarray<const T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
template <class T, int N>
using Out = nb::ndarray<T, nb::ndim<N>, nb::c_contig, nb::device::cpu>;
template <class T, int N>
using Strided = nb::ndarray<T, nb::ndim<N>, nb::device::cpu>;
using Ints = std::pair<int, int>;

const nlens::Kernels* kernels = &nlens::baseline;

std::string choose(const std::string& level) {
#if defined(__x86_64__)
    __builtin_cpu_init();
    const bool v3 = __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
    const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                    __builtin_cpu_supports("avx512dq") && __builtin_cpu_supports("avx512vl");
    if (v4 && (level.empty() || level == "v4")) return kernels = &nlens::x86_64_v4, "v4";
    if (v3 && level != "baseline") return kernels = &nlens::x86_64_v3, "v3";
#endif
    return kernels = &nlens::baseline, "baseline";
}

using Discs = std::tuple<In<float, 3>, In<float, 3>, Ints, Ints, double, double>;

void scatter_rows(std::pair<In<float, 3>, In<float, 3>> light, In<std::int32_t, 2> rows, Discs discs,
                  std::pair<In<double, 1>, In<double, 1>> columns,
                  std::tuple<In<float, 3>, int, int> coarse, double largest, double rim,
                  Strided<float, 3> sums, Ints origin, Ints band) {
    const auto& [rgba, numbers] = light;
    const auto& [stamps, spans, steps, turned, aspect, outer] = discs;
    const auto& [finer, coarse_row, coarse_column] = coarse;
    const auto n = [](auto v) { return static_cast<int>(v); };
    const nlens::ScatterArgs args{
        rgba.data(), numbers.data(), rows.data(), n(rgba.shape(0)), n(rgba.shape(1)),
        stamps.data(), n(stamps.shape(0)), n(stamps.shape(1)), n(stamps.shape(2)),
        spans.data(), n(spans.shape(0)), n(spans.shape(2)),
        static_cast<float>(steps.first), static_cast<float>(steps.second),
        static_cast<std::uint32_t>(turned.first), static_cast<std::uint32_t>(turned.second),
        static_cast<float>(aspect), static_cast<float>(outer),
        columns.first.data(), columns.second.data(),
        finer.data(), n(finer.shape(0)), n(finer.shape(1)), coarse_row, coarse_column,
        largest, static_cast<float>(rim), sums.data(), sums.stride(0), n(sums.shape(1)),
        origin.first, origin.second, band.first, band.second};
    nb::gil_scoped_release release;
    kernels->scatter_rows(args);
}

using Shape = std::tuple<In<double, 2>, In<float, 2>, In<std::int32_t, 2>, In<double, 1>>;

void fill(In<std::int32_t, 1> drawn, int first, int last, Shape shape, In<std::int32_t, 2> spans,
          int width, Out<float, 2> disparity, Out<std::int32_t, 2> ids) {
    const auto& [points, positions, faces, lens] = shape;
    const nlens::FillArgs args{drawn.data(), static_cast<int>(drawn.shape(0)), first, last,
                               points.data(), positions.data(), faces.data(), lens.data(),
                               spans.data(), width, static_cast<int>(disparity.shape(1)),
                               disparity.data(), ids.data()};
    nb::gil_scoped_release release;
    kernels->fill(args);
}

using AnyPlane = nb::ndarray<nb::ndim<2>, nb::device::cpu>;
using Axis = std::tuple<int, int, int, In<float, 1>>;

nlens::PlaneArgs plane(const AnyPlane& p) {
    return {p.data(), p.stride(0), p.stride(1), static_cast<int>(p.shape(0)), static_cast<int>(p.shape(1))};
}

void composite_over(std::tuple<AnyPlane, AnyPlane, AnyPlane> planes, AnyPlane alpha,
                    std::pair<bool, bool> flags, std::pair<AnyPlane, AnyPlane> before,
                    std::pair<Axis, Axis> axes, Ints corner, In<float, 3> rgba,
                    std::tuple<In<float, 1>, In<float, 1>, In<float, 2>, In<float, 2>, In<float, 2>, In<float, 2>> maps,
                    double peak) {
    const auto& [first, second, third] = planes;
    const auto kind = first.dtype();
    const auto sample = kind == nb::dtype<std::uint8_t>()    ? nlens::Sample::u8
                        : kind == nb::dtype<std::uint16_t>() ? nlens::Sample::u16
                                                             : nlens::Sample::f32;
    const auto axis = [](const Axis& a) {
        const auto& [step, phase, start, weights] = a;
        return nlens::AxisArgs{step, phase, start, weights.data(), static_cast<int>(weights.shape(0))};
    };
    const auto& [to_linear, to_coded, rgb_from_codes, codes_from_rgb, from_bt709, to_bt709] = maps;
    const nlens::BlendArgs args{
        sample, {plane(first), plane(second), plane(third), plane(alpha)}, flags.first, flags.second,
        before.first.data(), before.second.data(), axis(axes.first), axis(axes.second),
        corner.first, corner.second, static_cast<int>(rgba.shape(0)), static_cast<int>(rgba.shape(1)),
        rgba.data(), to_linear.data(), to_coded.data(), static_cast<int>(to_linear.shape(0)),
        static_cast<int>(to_coded.shape(0)), rgb_from_codes.data(), codes_from_rgb.data(),
        from_bt709.data(), to_bt709.data(), static_cast<float>(peak)};
    nb::gil_scoped_release release;
    kernels->composite_over(args);
}

}  // namespace

NB_MODULE(nlens_native, m) {
    choose("");
    m.def("choose", &choose, "level"_a = "");
    m.def("scatter_rows", &scatter_rows);
    m.def("fill", &fill);
    m.def("composite_over", &composite_over);
}

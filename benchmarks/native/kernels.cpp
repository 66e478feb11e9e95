// Compiled once for each kind of processor; NLENS_LEVEL is the name of its table.
#include "kernels.h"

#include "blend.h"
#include "raster.h"
#include "scatter_rows.h"

namespace nlens {
namespace {

void call_scatter_rows(const ScatterArgs& a) {
    const Light light{a.rgba, a.numbers, a.rows, a.height, a.width};
    const Discs discs{a.stamps, a.stamp_rows, a.stamp_columns, a.stamp_entries,
                      a.spans, a.span_rows, a.span_entries, a.stamp_step, a.span_step,
                      a.stamp_turned, a.span_turned, a.aspect, a.outer};
    const Coarse coarse{a.coarse, a.coarse_rows, a.coarse_columns, a.coarse_row, a.coarse_column};
    scatter_rows(light, discs, a.first_column, a.last_column, coarse, a.largest, a.rim, a.sums,
                 a.stride, a.out_width, a.origin_row, a.origin_column, a.begin, a.end);
}

void call_fill(const FillArgs& a) {
    const Shape shape{a.points, a.positions, a.faces, a.lens};
    fill(a.drawn, a.count, a.first, a.last, shape, a.spans, {a.disparity, a.ids, a.width, a.stride});
}

template <class S>
void blend(const BlendArgs& a) {
    const auto plane = [](const PlaneArgs& p) {
        return Plane2<S>{static_cast<S*>(p.values), p.row, p.column, p.height, p.width};
    };
    const Frame<S> frame{plane(a.planes[0]), plane(a.planes[1]), plane(a.planes[2]),
                         plane(a.planes[3]), a.associated, a.of_plate};
    const Coding coding{{a.to_linear, a.linear_count}, {a.to_coded, a.coded_count},
                        {a.rgb_from_codes, 4}, {a.codes_from_rgb, 3}, {a.from_bt709, 3},
                        {a.to_bt709, 3}, a.peak};
    const auto axis = [](const AxisArgs& x) { return Axis{x.step, x.phase, x.first, x.weights, x.count}; };
    const Target box{a.y0, a.x0, a.height, a.width, reinterpret_cast<const Rgba*>(a.rgba)};
    composite_over(frame, static_cast<const S*>(a.luma), static_cast<const S*>(a.alpha),
                   axis(a.across), axis(a.down), box, coding);
}

void call_composite_over(const BlendArgs& a) {
    switch (a.sample) {
        case Sample::u8: return blend<std::uint8_t>(a);
        case Sample::u16: return blend<std::uint16_t>(a);
        case Sample::f32: return blend<float>(a);
    }
}

}  // namespace

extern const Kernels NLENS_LEVEL{call_scatter_rows, call_fill, call_composite_over};

}  // namespace nlens

// Culling of triangles, and the plane equations of their weights: `render/software/triangles.py`.
#include "triangles.h"

#include <algorithm>
#include <cmath>

#include "module.h"

namespace nlens {
namespace {

constexpr int kBackDrawn = 1, kMirrored = 2;  // bits of `sides`

// Lines of samples: the first and the last.
struct Span {
    int first, last;
};

// Planes of a triangle whose corners lie before the camera; `area` is twice its own.
void set_planes(float* row, const Corners& corners, double area, double facing) {
    const auto& [a, b, c] = corners;
    const double scale = 1.0 / area;
    const double planes[kPlanes] = {
        (b.y - c.y) * scale * a.w,
        (c.y - a.y) * scale * b.w,
        (a.y - b.y) * scale * c.w,
        0.0,
        (c.x - b.x) * scale * a.w,
        (a.x - c.x) * scale * b.w,
        (b.x - a.x) * scale * c.w,
        0.0,
        a.w,
        0.0,
        0.0,
        0.0,
        a.x,
        a.y,
        facing,
        0.0,
    };
    std::copy_n(planes, kPlanes, row);
}

// Planes of a triangle through the near plane.
void set_crossing(float* row, const ScreenPlane (&planes)[3], double facing) {
    for (int k = 0; k < 3; ++k) {
        row[kA + k] = planes[k].a, row[kB + k] = planes[k].b, row[kC + k] = planes[k].c;
    }
    row[kA + 3] = row[kB + 3] = row[kC + 3] = 0.0f;
    row[kX0] = row[kY0] = 0.0f, row[kFacing] = facing;
}

// Lines of samples whose row lies in [low, high).
Span lines_between(double low, double high, int lines) {
    const auto from = [&](double row) {
        return static_cast<int>(std::ceil(std::min(std::max((row - 0.125) * kSamples, 0.0), 1.0 * lines)));
    };
    return {from(low), from(high) - 1};
}

int set_up_triangles(const Shape& shape, Array<const std::uint8_t, 1> sides, int width, int lines,
                     Array<std::int32_t, 2> spans, Array<float, 2> planes, Array<std::int32_t, 1> kept) {
    int count = 0;
    for (int t = 0; t < shape.faces.shape[0]; ++t) {
        const Corners corners = shape.on_screen(t);
        const auto& [a, b, c] = corners;
        const bool back_drawn = sides(t) & kBackDrawn;
        const double mirrored = sides(t) & kMirrored ? -1.0 : 1.0;
        Span span{0, lines - 1};
        if (std::min({a.w, b.w, c.w}) > 0.0) {
            const double area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
            const double facing = area < 0.0 ? mirrored : -mirrored;  // rows run downwards
            if (area == 0.0 || (facing < 0.0 && !back_drawn)) continue;
            if (std::max({a.x, b.x, c.x}) < 0.0 || std::min({a.x, b.x, c.x}) > width) continue;
            span = lines_between(std::min({a.y, b.y, c.y}), std::max({a.y, b.y, c.y}), lines);
            if (span.first > span.last) continue;
            set_planes(planes.at(t), corners, area, facing);
        } else {
            if (std::max({a.w, b.w, c.w}) == 0.0) continue;
            const Crossing crossed = crossing(shape, t);
            const double facing = crossed.area < 0.0 ? mirrored : -mirrored;
            if (crossed.area == 0.0 || (facing < 0.0 && !back_drawn)) continue;
            set_crossing(planes.at(t), crossed.planes, facing);
        }
        spans(t, 0) = span.first, spans(t, 1) = span.last;
        kept(count++) = t;
    }
    return count;
}

}  // namespace

void bind_triangles(nanobind::module_& module) {
    module.def("set_up_triangles", &set_up_triangles, Unlocked());
}

}  // namespace nlens

// Visibility: the nearest triangle of each sample.
#include "raster.h"

#include <algorithm>
#include <cstdint>

#include "module.h"
#include "vectors.h"

namespace nlens {
namespace {

// Samples that are tested at once. Most runs are shorter than 8, and of wider vectors those of neighbouring
// triangles would overlap: reading what was just written in part waits for memory.
constexpr int kLanes = 4;
using Int4 = std::int32_t __attribute__((vector_size(16)));
constexpr Int4 kLaneNumbers = {0, 1, 2, 3};

struct Samples {
    Array<float, 2> disparity;  // (4 h, width + kLanes), the last columns of any content
    Array<std::int32_t, 2> ids;
};

// Depth test and write of `kLanes` samples of a run, from its sample `from` on.
inline void draw_lanes(float* disparity, std::int32_t* ids, int from, int count, float start, float slope,
                       int t) {
    const Int4 lanes = kLaneNumbers + from;
    const Float4 mine = start + __builtin_convertvector(lanes, Float4) * slope;
    const auto before = load<Float4>(disparity + from);
    const Int4 drawn = (lanes < count) & (mine >= before);
    store(disparity + from, drawn ? mine : before);
    store(ids + from, drawn ? Int4{} + t : load<Int4>(ids + from));
}

// Draws columns of a line; `start` is the disparity of the first, `slope` its change by a column.
inline void draw_run(Samples samples, int t, int line, Columns run, double slope, double start) {
    float* disparity = samples.disparity.at(line, run.first);
    std::int32_t* ids = samples.ids.at(line, run.first);
    const int count = run.last - run.first;
    const float begun = static_cast<float>(start), step = static_cast<float>(slope);
    // Unconditionally once: branch prediction fails on whether a short run is empty.
    draw_lanes(disparity, ids, 0, count, begun, step, t);
    for (int x = kLanes; x < count; x += kLanes) draw_lanes(disparity, ids, x, count, begun, step, t);
}

inline void fill_before(const Corners& corners, int t, int first, int last, int width, Samples samples) {
    const auto& [a, b, c] = corners;
    const Sides sides = sides_of(corners);
    const double area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    const double slope = ((b.w - a.w) * (c.y - a.y) - (c.w - a.w) * (b.y - a.y)) / area;
    const double down = ((c.w - a.w) * (b.x - a.x) - (b.w - a.w) * (c.x - a.x)) / area;
    for (int line = first; line <= last; ++line) {
        const Columns run = sides.columns(line, width);
        const double x = run.first + kSampleX[line & 3] - a.x, y = row_of(line) - a.y;
        draw_run(samples, t, line, run, slope, a.w + down * y + slope * x);
    }
}

void fill_crossed(const Crossed& crossed, int t, int first, int last, int width, Samples samples) {
    const auto [slope, down, start] = crossed.disparity;
    for (int line = first; line <= last; ++line) {
        const Columns run = crossed.columns(line, width);
        if (run.first >= run.last) continue;
        const double x = run.first + kSampleX[line & 3];
        draw_run(samples, t, line, run, slope, slope * x + down * row_of(line) + start);
    }
}

void fill_triangles(Array<const std::int32_t, 1> drawn, int first, int last, const Shape& shape,
                    Array<const std::int32_t, 2> spans, int width, Array<float, 2> disparity,
                    Array<std::int32_t, 2> ids) {
    const Samples samples{disparity, ids};
    for (int n = 0; n < drawn.shape[0]; ++n) {
        const int t = drawn(n);
        const int top = std::max(first, spans(t, 0)), bottom = std::min(last, spans(t, 1));
        if (top > bottom) continue;
        const Corners corners = shape.on_screen(t);
        if (is_before(corners)) {
            fill_before(corners, t, top, bottom, width, samples);
        } else {
            fill_crossed(crossed(shape, t), t, top, bottom, width, samples);
        }
    }
}

void fill_triangles_behind(Array<const std::int32_t, 1> drawn, int first, int last, const Shape& shape,
                           Array<const std::int32_t, 2> spans, Array<const float, 2> most,
                           Array<const float, 2> planes, Array<float, 2> disparity,
                           Array<std::int32_t, 2> ids) {
    const int width = most.shape[1];
    for (int n = 0; n < drawn.shape[0]; ++n) {
        const int t = drawn(n);
        const int top = std::max(first, spans(t, 0)), bottom = std::min(last, spans(t, 1));
        if (top > bottom) continue;
        const Coverage coverage(shape, t);
        const DisparityPlane plane = disparity_plane(planes, t);
        for (int line = top; line <= bottom; ++line) {
            const Columns run = coverage.columns(line, width);
            for (int x = run.first; x < run.last; ++x) {
                const float d = plane.at(x + kSampleX[line & 3], row_of(line));
                float& nearest = disparity(line, x);
                if (nearest <= d && d <= most(line / kSamples, x)) nearest = d, ids(line, x) = t;
            }
        }
    }
}

}  // namespace

void bind_raster(nanobind::module_& module) {
    module.attr("PADDING") = kLanes;  // columns that are written to beyond the last
    module.def("fill_triangles", &fill_triangles, Unlocked());
    module.def("fill_triangles_behind", &fill_triangles_behind, Unlocked());
}

}  // namespace nlens

// Visibility: the nearest triangle of each sample.
#include "raster.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>

#include "module.h"
#include "vectors.h"

namespace nlens {
namespace {

// More would wait longer for each other: runs of neighbouring triangles overlap, and most are short.
constexpr int kLanes = 4;
using Int4 = std::int32_t __attribute__((vector_size(16)));
constexpr Int4 kLaneNumbers = {0, 1, 2, 3};
constexpr double kSnap = 1.5 * 1048576.0;  // adding and taking it away rounds to 2^-32

// A line across rows: at `row` it lies at `column`, and `slope` columns further at the next row.
struct Edge {
    double column, slope, row;

    // Exact to 2^-32: columns of samples are met exactly or not at all.
    double at(double y) const { return (column + slope * (y - row) + kSnap) - kSnap; }
};

inline Edge edge_of(Corner p, Corner q) { return {p.x, (q.x - p.x) / (q.y - p.y), p.y}; }

// The long edge of a triangle before the camera, and those above and below its middle row.
struct Sides {
    Edge whole, upper, lower;
    double middle;
};

inline Sides sides_of(const Corners& corners) {
    auto [a, b, c] = corners;
    if (b.y < a.y) std::swap(a, b);
    if (c.y < a.y) std::swap(a, c);
    if (c.y < b.y) std::swap(b, c);
    const Edge whole = edge_of(a, c);
    return {whole, b.y > a.y ? edge_of(a, b) : whole, c.y > b.y ? edge_of(b, c) : whole, b.y};
}

inline Columns covered_before(const Sides& sides, int line, int width) {
    const double y = row_of(line);
    const double one = sides.whole.at(y), other = (y < sides.middle ? sides.upper : sides.lower).at(y);
    const double shift = kSampleX[line & 3], end = width;
    const double left = std::min(std::max(std::min(one, other) - shift, 0.0), end);
    const double right = std::min(std::max(one, other) - shift, end);
    return {static_cast<int>(std::ceil(left)), static_cast<int>(std::ceil(right))};
}

// Columns, as positions [px].
struct Interval {
    double first, last;
};

// The part where slope * x + level >= 0.
Interval cut(Interval run, double slope, double level) {
    if (slope > 0.0) return {std::max(run.first, -level / slope), run.last};
    if (slope < 0.0) return {run.first, std::min(run.last, -level / slope)};
    return level >= 0.0 ? run : Interval{1.0, 0.0};
}

// A triangle through the near plane, as far as it is drawn.
struct Crossed {
    ScreenPlane p, q, r;
    double slope, down, start;  // of its disparity
    double highest;             // disparity that is drawn

    Crossed(const Shape& shape, int t) : highest(1.0 / shape.lens(16)) {
        const Crossing found = crossing(shape, t);
        p = found.planes[0], q = found.planes[1], r = found.planes[2];
        slope = p.a + q.a + r.a, down = p.b + q.b + r.b, start = p.c + q.c + r.c;
    }

    Columns covered(int line, int width) const {
        const double y = row_of(line), level = down * y + start;
        Interval run{0.0, static_cast<double>(width)};
        for (const ScreenPlane& plane : {p, q, r}) run = cut(run, plane.a, plane.b * y + plane.c);
        run = cut(run, -slope, highest - level);
        if (!(run.first <= run.last)) return {0, 0};
        const double shift = kSampleX[line & 3];
        return {static_cast<int>(std::ceil(std::max(run.first - shift, 0.0))),
                static_cast<int>(std::ceil(run.last - shift))};
    }
};

bool is_before(const Corners& corners) { return std::min({corners.a.w, corners.b.w, corners.c.w}) > 0.0; }

struct Samples {
    Array<float, 2> disparity;  // (4 h, width + kLanes), the last columns of any content
    Array<std::int32_t, 2> ids;
};

// Depth test and write of `kLanes` samples of a run, from its sample `from` on.
inline void draw_lanes(float* disparity, std::int32_t* ids, int from, int count, float start, float slope, int t) {
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
        const Columns run = covered_before(sides, line, width);
        const double x = run.first + kSampleX[line & 3] - a.x, y = row_of(line) - a.y;
        draw_run(samples, t, line, run, slope, a.w + down * y + slope * x);
    }
}

void fill_crossed(const Crossed& crossed, int t, int first, int last, int width, Samples samples) {
    for (int line = first; line <= last; ++line) {
        const Columns run = crossed.covered(line, width);
        if (run.first >= run.last) continue;
        const double x = run.first + kSampleX[line & 3];
        const double start = crossed.slope * x + crossed.down * row_of(line) + crossed.start;
        draw_run(samples, t, line, run, crossed.slope, start);
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
            fill_crossed(Crossed(shape, t), t, top, bottom, width, samples);
        }
    }
}

void fill_triangles_behind(Array<const std::int32_t, 1> drawn, int first, int last, const Shape& shape,
                           Array<const std::int32_t, 2> spans, Array<const float, 2> most,
                           Array<const float, 2> planes, Array<float, 2> disparity, Array<std::int32_t, 2> ids) {
    const int width = most.shape[1];
    for (int n = 0; n < drawn.shape[0]; ++n) {
        const int t = drawn(n);
        const int top = std::max(first, spans(t, 0)), bottom = std::min(last, spans(t, 1));
        if (top > bottom) continue;
        const Corners corners = shape.on_screen(t);
        const bool before = is_before(corners);
        const Sides sides = sides_of(corners);
        const DisparityPlane plane = disparity_plane(planes, t);
        for (int line = top; line <= bottom; ++line) {
            const Columns run = before ? covered_before(sides, line, width) : covered(shape, t, line, width);
            for (int x = run.first; x < run.last; ++x) {
                const float d = plane.at(x + kSampleX[line & 3], row_of(line));
                float& nearest = disparity(line, x);
                if (nearest <= d && d <= most(line / kSamples, x)) nearest = d, ids(line, x) = t;
            }
        }
    }
}

}  // namespace

Columns covered(const Shape& shape, int t, int line, int width) {
    const Corners corners = shape.on_screen(t);
    if (!is_before(corners)) return Crossed(shape, t).covered(line, width);
    const auto& [a, b, c] = corners;
    const double y = row_of(line);
    const bool inside = std::min({a.y, b.y, c.y}) <= y && y < std::max({a.y, b.y, c.y});
    return inside ? covered_before(sides_of(corners), line, width) : Columns{0, 0};
}

void bind_raster(nanobind::module_& module) {
    module.attr("PADDING") = kLanes;  // columns that are written to beyond the last
    module.def("fill_triangles", &fill_triangles, Unlocked());
    module.def("fill_triangles_behind", &fill_triangles_behind, Unlocked());
}

}  // namespace nlens

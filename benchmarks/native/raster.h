// Visibility: the nearest triangle of each sample, see `render/software/raster.py`.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "vectors.h"

namespace nlens {
namespace {

#if defined(__AVX512F__)
constexpr int kLanes = 16;
#elif defined(__AVX2__)
constexpr int kLanes = 8;
#else
constexpr int kLanes = 4;
#endif
using Floats = float __attribute__((vector_size(4 * kLanes)));
using Ints = std::int32_t __attribute__((vector_size(4 * kLanes)));
constexpr double kSnap = 1.5 * 1048576.0;  // adding and taking it away rounds to 2^-32
constexpr double kSampleX[4] = {0.375, 0.875, 0.125, 0.625};

struct Point {
    double x, y, w;  // column, row, disparity; or homogeneous
};

// Columns at rows: at `row` it lies at `column`, and `slope` columns further at the next row.
struct Edge {
    double column, slope, row;

    double at(double y) const { return (column + slope * (y - row) + kSnap) - kSnap; }
};

struct Plane {
    double a, b, c;
};

// Triangles on the screen, see `triangles.Shape`.
struct Shape {
    const double* points;     // (V, 3)
    const float* positions;   // (V, 3)
    const std::int32_t* faces;  // (F, 3)
    const double* lens;       // camera parameters

    Point corner(int t, int k) const {
        const double* p = points + 3 * faces[3 * t + k];
        return {p[0], p[1], p[2]};
    }

    // A corner as (column * depth, row * depth, depth).
    Point homogeneous(int t, int k) const {
        const float* p = positions + 3 * faces[3 * t + k];
        const double x = p[0] - lens[9], y = p[1] - lens[10], z = p[2] - lens[11];
        const double right = x * lens[0] + y * lens[1] + z * lens[2];
        const double up = x * lens[3] + y * lens[4] + z * lens[5];
        const double depth = -(x * lens[6] + y * lens[7] + z * lens[8]);
        return {lens[12] * right + lens[14] * depth, lens[15] * depth - lens[13] * up, depth};
    }
};

struct Picture {
    float* disparity;
    std::int32_t* ids;
    int width;       // columns that are shown
    int stride;      // columns that are stored
};

struct Run {
    int first, last;  // one beyond the last column
};

inline Ints lane_numbers() {
    Ints made{};
    for (int i = 0; i < kLanes; ++i) made[i] = i;
    return made;
}

// Depth test and write of `kLanes` samples of a run, from its sample `from` on.
inline void draw_samples(Picture picture, std::ptrdiff_t at, int from, int count, float start, float slope, int t) {
    const Ints lanes = lane_numbers() + from;
    at += from;
    const Floats mine = start + __builtin_convertvector(lanes, Floats) * slope;
    const Floats before = load<Floats>(picture.disparity + at);
    const Ints drawn = (lanes < count) & (mine >= before);
    store(picture.disparity + at, drawn ? mine : before);
    store(picture.ids + at, drawn ? Ints{} + t : load<Ints>(picture.ids + at));
}

inline void draw_run(Picture picture, int t, int line, Run run, double slope, double start) {
    const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(line) * picture.stride + run.first;
    const int count = run.last - run.first;
    const float begun = static_cast<float>(start), step = static_cast<float>(slope);
    // Unconditionally once: branch prediction fails on whether a short run is empty.
    draw_samples(picture, at, 0, count, begun, step, t);
    for (int x = kLanes; x < count; x += kLanes) {
        draw_samples(picture, at, x, count, begun, step, t);
    }
}

struct Sides {
    Edge whole, upper, lower;
    double middle;
};

inline Edge edge_of(Point p, Point q) { return {p.x, (q.x - p.x) / (q.y - p.y), p.y}; }

inline Sides sides_of(Point a, Point b, Point c) {
    if (b.y < a.y) std::swap(a, b);
    if (c.y < a.y) std::swap(a, c);
    if (c.y < b.y) std::swap(b, c);
    const Edge whole = edge_of(a, c);
    return {whole, b.y > a.y ? edge_of(a, b) : whole, c.y > b.y ? edge_of(b, c) : whole, b.y};
}

inline Run covered(const Sides& sides, int line, int width) {
    const double y = 0.25 * line + 0.125;
    const double one = sides.whole.at(y), other = (y < sides.middle ? sides.upper : sides.lower).at(y);
    const double shift = kSampleX[line & 3];
    return {static_cast<int>(std::ceil(std::max(std::min(one, other) - shift, 0.0))),
            static_cast<int>(std::ceil(std::min(std::max(one, other) - shift, static_cast<double>(width))))};
}

inline void fill_one(Point a, Point b, Point c, int t, int first, int last, Picture picture) {
    const Sides sides = sides_of(a, b, c);
    const double area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    const double slope = ((b.w - a.w) * (c.y - a.y) - (c.w - a.w) * (b.y - a.y)) / area;
    const double down = ((c.w - a.w) * (b.x - a.x) - (b.w - a.w) * (c.x - a.x)) / area;
    for (int line = first; line <= last; ++line) {
        const Run run = covered(sides, line, picture.width);
        const double x = run.first + kSampleX[line & 3] - a.x, y = 0.25 * line + 0.125 - a.y;
        draw_run(picture, t, line, run, slope, a.w + down * y + slope * x);
    }
}

// Barycentric weights by depth as planes of the screen (Olano and Greer 1997).
inline std::array<Plane, 3> crossing(const Shape& shape, int t) {
    const Point a = shape.homogeneous(t, 0), b = shape.homogeneous(t, 1), c = shape.homogeneous(t, 2);
    const Plane p{b.y * c.w - b.w * c.y, b.w * c.x - b.x * c.w, b.x * c.y - b.y * c.x};
    const Plane q{c.y * a.w - c.w * a.y, c.w * a.x - c.x * a.w, c.x * a.y - c.y * a.x};
    const Plane r{a.y * b.w - a.w * b.y, a.w * b.x - a.x * b.w, a.x * b.y - a.y * b.x};
    const double s = 1.0 / (a.x * p.a + a.y * p.b + a.w * p.c);
    return {{{p.a * s, p.b * s, p.c * s}, {q.a * s, q.b * s, q.c * s}, {r.a * s, r.b * s, r.c * s}}};
}

struct Interval {
    double first, last;
};

inline Interval cut(Interval run, double slope, double level) {
    if (slope > 0.0) return {std::max(run.first, -level / slope), run.last};
    if (slope < 0.0) return {run.first, std::min(run.last, -level / slope)};
    return level >= 0.0 ? run : Interval{1.0, 0.0};
}

inline Run covered_crossing(const std::array<Plane, 3>& planes, double highest, int line, int width) {
    const double y = 0.25 * line + 0.125;
    double slope = 0.0, level = 0.0;
    Interval run{0.0, static_cast<double>(width)};
    for (const Plane& plane : planes) {
        run = cut(run, plane.a, plane.b * y + plane.c);
        slope += plane.a;
        level += plane.b * y + plane.c;
    }
    run = cut(run, -slope, highest - level);
    if (!(run.first <= run.last)) return {0, 0};
    const double shift = kSampleX[line & 3];
    return {static_cast<int>(std::ceil(std::max(run.first - shift, 0.0))),
            static_cast<int>(std::ceil(run.last - shift))};
}

inline void fill_crossing(const Shape& shape, int t, int first, int last, Picture picture) {
    const std::array<Plane, 3> planes = crossing(shape, t);
    const Plane sum{planes[0].a + planes[1].a + planes[2].a, planes[0].b + planes[1].b + planes[2].b,
                    planes[0].c + planes[1].c + planes[2].c};
    for (int line = first; line <= last; ++line) {
        const Run run = covered_crossing(planes, 1.0 / shape.lens[16], line, picture.width);
        if (run.first >= run.last) continue;
        const double x = run.first + kSampleX[line & 3], y = 0.25 * line + 0.125;
        draw_run(picture, t, line, run, sum.a, sum.a * x + sum.b * y + sum.c);
    }
}

// Draws triangles on the lines [first, last]; of equal disparities the later one stays.
inline void fill(const std::int32_t* drawn, int count, int first, int last, const Shape& shape,
                 const std::int32_t* spans, Picture picture) {
    for (int n = 0; n < count; ++n) {
        const int t = drawn[n];
        const int top = std::max(first, spans[2 * t]), bottom = std::min(last, spans[2 * t + 1]);
        if (top > bottom) continue;
        const Point a = shape.corner(t, 0), b = shape.corner(t, 1), c = shape.corner(t, 2);
        if (std::min({a.w, b.w, c.w}) > 0.0) {
            fill_one(a, b, c, t, top, bottom, picture);
        } else {
            fill_crossing(shape, t, top, bottom, picture);
        }
    }
}

}  // namespace
}  // namespace nlens

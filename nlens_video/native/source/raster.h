// Which samples a triangle covers: `render/software/raster.py`.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include "triangles.h"

namespace nlens {

// Where in a pixel its samples lie [px].
constexpr double kSampleX[kSamples] = {0.375, 0.875, 0.125, 0.625};
constexpr double kSampleY[kSamples] = {0.125, 0.375, 0.625, 0.875};
constexpr int kNothing = -1;  // no triangle

// The row of the samples of a line.
inline double row_of(int line) {
    return 0.25 * line + 0.125;
}

// Columns: the first, and one beyond the last.
struct Columns {
    int first, last;
};

// A line across rows: at `row` it lies at `column`, and `slope` columns further at the next row.
struct Edge {
    double column, slope, row;

    // Rounded to 2^-32 by what is added and taken away: columns of samples are met exactly or not at all.
    double at(double y) const {
        constexpr double snap = 1.5 * 1048576.0;
        return (column + slope * (y - row) + snap) - snap;
    }
};

inline Edge edge_of(Corner p, Corner q) {
    return {p.x, (q.x - p.x) / (q.y - p.y), p.y};
}

// The long edge of a triangle before the camera, and those above and below its middle row.
struct Sides {
    Edge whole, upper, lower;
    double middle;

    // Columns of a line between its first and last row that it covers.
    Columns columns(int line, int width) const {
        const double y = row_of(line);
        const double one = whole.at(y), other = (y < middle ? upper : lower).at(y);
        const double shift = kSampleX[line & 3], end = width;
        const double left = std::min(std::max(std::min(one, other) - shift, 0.0), end);
        const double right = std::min(std::max(one, other) - shift, end);
        return {static_cast<int>(std::ceil(left)), static_cast<int>(std::ceil(right))};
    }
};

inline Sides sides_of(const Corners& corners) {
    auto [a, b, c] = corners;
    if (b.y < a.y) std::swap(a, b);
    if (c.y < a.y) std::swap(a, c);
    if (c.y < b.y) std::swap(b, c);
    const Edge whole = edge_of(a, c);
    return {whole, b.y > a.y ? edge_of(a, b) : whole, c.y > b.y ? edge_of(b, c) : whole, b.y};
}

// A triangle through the near plane, as far as it is drawn.
struct Crossed {
    ScreenPlane weights[3];
    ScreenPlane disparity;
    double highest;  // disparity that is drawn

    Columns columns(int line, int width) const {
        const double y = row_of(line);
        double first = 0.0, last = width;
        const auto cut = [&](double slope, double level) {  // to where slope * x + level >= 0
            if (slope > 0.0)
                first = std::max(first, -level / slope);
            else if (slope < 0.0)
                last = std::min(last, -level / slope);
            else if (!(level >= 0.0))
                first = 1.0, last = 0.0;
        };
        for (const ScreenPlane& plane : weights) cut(plane.a, plane.b * y + plane.c);
        cut(-disparity.a, highest - (disparity.b * y + disparity.c));
        if (!(first <= last)) return {0, 0};
        const double shift = kSampleX[line & 3];
        return {static_cast<int>(std::ceil(std::max(first - shift, 0.0))),
                static_cast<int>(std::ceil(last - shift))};
    }
};

inline Crossed crossed(const Shape& shape, int t) {
    const auto [area, planes] = crossing(shape, t);
    const auto& [p, q, r] = planes;
    return {{p, q, r}, {p.a + q.a + r.a, p.b + q.b + r.b, p.c + q.c + r.c}, 1.0 / shape.lens(16)};
}

inline bool is_before(const Corners& corners) {
    return std::min({corners.a.w, corners.b.w, corners.c.w}) > 0.0;
}

// What a triangle covers, wherever it lies.
class Coverage {
public:
    Coverage(const Shape& shape, int t) {
        const Corners corners = shape.on_screen(t);
        before_ = is_before(corners);
        if (before_) {
            const auto& [a, b, c] = corners;
            low_ = std::min({a.y, b.y, c.y}), high_ = std::max({a.y, b.y, c.y});
            sides_ = sides_of(corners);
        } else {
            crossed_ = crossed(shape, t);
        }
    }

    // Of a line of samples.
    Columns columns(int line, int width) const {
        if (!before_) return crossed_.columns(line, width);
        const double y = row_of(line);
        return low_ <= y && y < high_ ? sides_.columns(line, width) : Columns{0, 0};
    }

private:
    bool before_;
    double low_ = 0.0, high_ = 0.0;
    Sides sides_{};
    Crossed crossed_{};
};

}  // namespace nlens

// A triangle on the screen in homogeneous positions, (column * w, row * w, w).
#pragma once

#include <algorithm>
#include <array>
#include <cmath>

#include "arrays.h"

namespace nlens {

struct Homogeneous {
    double x, y, w;
};

// Where in each pixel it is sampled, in [0, 1) [px].
struct SamplePlace {
    double column, row;
};

// The first column and row of pixels, and the last ones.
struct Extent {
    int left, top, right, bottom;

    bool empty() const { return left > right || top > bottom; }
};

// The pixels that a triangle may cover: all of them where it reaches behind the camera.
inline Extent extent(const std::array<Homogeneous, 3>& corners, int height, int width, SamplePlace at) {
    const auto& [a, b, c] = corners;
    const Extent nothing{0, 0, -1, -1};
    if (a.w <= 0.0 && b.w <= 0.0 && c.w <= 0.0) return nothing;
    if (a.w <= 0.0 || b.w <= 0.0 || c.w <= 0.0) return {0, 0, width - 1, height - 1};
    const auto [low_x, high_x] = std::minmax({a.x / a.w, b.x / b.w, c.x / c.w});
    const auto [low_y, high_y] = std::minmax({a.y / a.w, b.y / b.w, c.y / c.w});
    const double left = low_x - at.column, right = high_x - at.column;
    const double top = low_y - at.row, bottom = high_y - at.row;
    if (!(right >= 0.0 && bottom >= 0.0 && left <= width - 1 && top <= height - 1)) return nothing;
    return {static_cast<int>(std::ceil(std::max(left, 0.0))), static_cast<int>(std::ceil(std::max(top, 0.0))),
            static_cast<int>(std::floor(std::min(right, width - 1.0))),
            static_cast<int>(std::floor(std::min(bottom, height - 1.0)))};
}

// Functions that are zero on an edge and >= 0 inside; the place of a pixel is (x, y, 1).
struct EdgeFunctions {
    std::array<Homogeneous, 3> edges;

    double at(int edge, double x, double y) const {
        return edges[edge].x * x + edges[edge].y * y + edges[edge].w;
    }

    // The part of a run of columns, from the first to the last, at which a row is inside all edges.
    // `at` never falls, or never rises, along a row, rounding included: so the ends are exact.
    std::array<int, 2> inside(std::array<int, 2> run, double y, SamplePlace place) const {
        auto [first, last] = run;
        for (int edge = 0; edge < 3; ++edge) {
            const auto is_inside = [&](int column) { return at(edge, column + place.column, y) >= 0.0; };
            const double slope = edges[edge].x;
            const double zero = -(edges[edge].y * y + edges[edge].w) / slope - place.column;
            int bound = zero > first ? static_cast<int>(std::min(zero, last + 1.0)) : first;
            if (slope >= 0.0) {
                while (bound > first && is_inside(bound - 1)) --bound;
                while (bound <= last && !is_inside(bound)) ++bound;
                first = bound;
            } else {
                bound = std::min(bound, last);
                while (bound < last && is_inside(bound + 1)) ++bound;
                while (bound >= first && !is_inside(bound)) --bound;
                last = bound;
            }
        }
        return {first, last};
    }
};

// Fills in the edge functions, the rows of the adjugate; false for a triangle without area.
inline bool edge_functions(const std::array<Homogeneous, 3>& corners, EdgeFunctions& functions) {
    const auto& [a, b, c] = corners;
    const auto between = [](Homogeneous p, Homogeneous q) {
        return Homogeneous{p.y * q.w - p.w * q.y, p.w * q.x - p.x * q.w, p.x * q.y - p.y * q.x};
    };
    functions.edges = {between(b, c), between(c, a), between(a, b)};
    const Homogeneous& first = functions.edges[0];
    const double turn = first.x * a.x + first.y * a.y + first.w * a.w;
    if (turn < 0.0) {
        for (Homogeneous& edge : functions.edges) edge = {-edge.x, -edge.y, -edge.w};
    }
    return turn != 0.0;
}

}  // namespace nlens

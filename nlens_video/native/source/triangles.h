// Triangles on the screen, and their planes: `render/software/triangles.py`.
#pragma once

#include <cstdint>
#include <tuple>

#include "arrays.h"
#include "projection.h"

namespace nlens {

constexpr int kSamples = 4;  // of a pixel, each on a line of its own

// Numbers of a triangle's planes, in rows of four: q_k = a_k (x - x0) + b_k (y - y0) + c_k.
constexpr int kPlanes = 16, kA = 0, kB = 4, kC = 8, kX0 = 12, kY0 = 13, kFacing = 14;

// Column, row and disparity; or homogeneous: column * depth, row * depth and depth.
struct Corner {
    double x, y, w;
};

struct Corners {
    Corner a, b, c;
};

// a x + b y + c
struct ScreenPlane {
    double a, b, c;
};

struct Shape {
    Array<const double, 2> points;       // (V, 3) from `project`; disparity 0 behind the near plane
    Array<const float, 2> positions;     // (V, 3)
    Array<const std::int32_t, 2> faces;  // (F, 3)
    Lens lens;
    static constexpr auto fields = std::tuple{&Shape::points, &Shape::positions, &Shape::faces, &Shape::lens};

    Corner corner(int t, int k) const {
        const double* p = points.at(faces(t, k));
        return {p[0], p[1], p[2]};
    }

    Corners on_screen(int t) const { return {corner(t, 0), corner(t, 1), corner(t, 2)}; }

    Corner homogeneous(int t, int k) const {
        const float* p = positions.at(faces(t, k));
        const auto [right, up, depth] = in_camera(p[0], p[1], p[2], lens.data);
        return {lens(12) * right + lens(14) * depth, lens(15) * depth - lens(13) * up, depth};
    }
};

// Of a triangle anywhere: twice its homogeneous area, and the planes of its weights by depth. They are
// the inverse of the corners' matrix (Olano and Greer 1997).
struct Crossing {
    double area;
    ScreenPlane planes[3];
};

inline Crossing crossing(const Shape& shape, int t) {
    const Corner a = shape.homogeneous(t, 0), b = shape.homogeneous(t, 1), c = shape.homogeneous(t, 2);
    const auto product = [](Corner p, Corner q) {
        return ScreenPlane{p.y * q.w - p.w * q.y, p.w * q.x - p.x * q.w, p.x * q.y - p.y * q.x};
    };
    const ScreenPlane p = product(b, c), q = product(c, a), r = product(a, b);
    const double area = a.x * p.a + a.y * p.b + a.w * p.c;
    const double s = 1.0 / area;
    return {area, {{p.a * s, p.b * s, p.c * s}, {q.a * s, q.b * s, q.c * s}, {r.a * s, r.b * s, r.c * s}}};
}

// Disparity of a triangle as a plane: change by a column and a row; where, and how much.
struct DisparityPlane {
    float across, down, x0, y0, start;

    float at(double x, double y) const {
        return across * (static_cast<float>(x) - x0) + down * (static_cast<float>(y) - y0) + start;
    }
};

// `planes` (F, kPlanes) from `set_up_triangles`.
inline DisparityPlane disparity_plane(Array<const float, 2> planes, int t) {
    const float* p = planes.at(t);
    return {p[kA] + p[kA + 1] + p[kA + 2], p[kB] + p[kB + 1] + p[kB + 2], p[kX0], p[kY0],
            p[kC] + p[kC + 1] + p[kC + 2]};
}

}  // namespace nlens

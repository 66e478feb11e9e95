// Screen positions, bounds and motion of points: `scene/screen_projection.py`.
#include "projection.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <tuple>

#include "module.h"

namespace nlens {
namespace {

constexpr double kGrid = 256.0;
constexpr double kHuge = 1e9;  // positions beyond are far off the frame whatever they are [px]
constexpr double kInfinite = std::numeric_limits<double>::infinity();

double snapped(double place) {
    return std::nearbyint(std::min(std::max(place, -kHuge), kHuge) * kGrid) / kGrid;
}

void project(Array<const float, 2> positions, Lens lens, Array<double, 2> points) {
    for (int v = 0; v < positions.shape[0]; ++v) {
        const float* p = positions.at(v);
        const auto [right, up, depth] = in_camera(p[0], p[1], p[2], lens.data);
        const bool inside = depth >= lens(16);
        const double disparity = 1.0 / (inside ? depth : 1.0);
        double* to = points.at(v);
        to[0] = snapped(lens(14) + lens(12) * right * disparity);
        to[1] = snapped(lens(15) - lens(13) * up * disparity);
        to[2] = inside ? disparity : 0.0;
    }
}

// Columns and rows [px] and depths; no numbers for what is not before the camera.
template <class Number>
void places(Strided<const Number, 2> positions, Lens lens, Array<double, 2> found) {
    constexpr double none = std::numeric_limits<double>::quiet_NaN();
    for (int v = 0; v < positions.shape[0]; ++v) {
        const auto [right, up, depth] =
            in_camera(positions(v, 0), positions(v, 1), positions(v, 2), lens.data);
        const bool before = depth > 0.0;
        double* to = found.at(v);
        to[0] = before ? lens(14) + lens(12) * right / depth : none;
        to[1] = before ? lens(15) - lens(13) * up / depth : none;
        to[2] = before ? depth : none;
    }
}

struct Range {
    double low = kInfinite, high = -kInfinite;

    void add(double value) {
        low = std::min(low, value);
        high = std::max(high, value);
    }
};

template <class Number>
std::tuple<double, double, double, double, double, double> bounds(Strided<const Number, 2> positions,
                                                                  Lens lens) {
    Range x, y, z;
    for (int v = 0; v < positions.shape[0]; ++v) {
        const auto [right, up, depth] =
            in_camera(positions(v, 0), positions(v, 1), positions(v, 2), lens.data);
        x.add(lens(14) + lens(12) * right / depth);
        y.add(lens(15) - lens(13) * up / depth);
        z.add(depth);
    }
    return {x.low, x.high, y.low, y.high, z.low, z.high};
}

InCamera seen(const double* point, const double* lens) {
    return in_camera(point[0], point[1], point[2], lens);
}

double travel(Array<const double, 3> points, Array<const double, 2> lenses) {
    double slope_x = 0.0, slope_y = 0.0, total = 0.0, nearest = kInfinite;
    const int values = 3 * points.shape[1];
    for (int m = 0; m < points.shape[0]; ++m) {
        const double *place = points.at(m), *lens = lenses.at(m);
        for (int p = 0; p < values; p += 3) {
            const auto [right, up, depth] = seen(place + p, lens);
            if (!(0.0 < depth && depth < kInfinite)) return kInfinite;
            slope_x = std::max(slope_x, std::fabs(right / depth));
            slope_y = std::max(slope_y, std::fabs(up / depth));
            nearest = std::min(nearest, depth);
        }
    }
    for (int m = 1; m < points.shape[0]; ++m) {
        const double *place = points.at(m), *lens = lenses.at(m);
        const double *place_before = points.at(m - 1), *lens_before = lenses.at(m - 1);
        double way_x = 0.0, way_y = 0.0, way_z = 0.0;
        for (int p = 0; p < values; p += 3) {
            const InCamera now = seen(place + p, lens), before = seen(place_before + p, lens_before);
            way_x = std::max(way_x, std::fabs(now.right - before.right));
            way_y = std::max(way_y, std::fabs(now.up - before.up));
            way_z = std::max(way_z, std::fabs(now.depth - before.depth));
        }
        const double moved_x =
            (way_x + slope_x * way_z) * lens[12] + std::fabs(lens[12] - lens_before[12]) * slope_x * nearest;
        const double moved_y =
            (way_y + slope_y * way_z) * lens[13] + std::fabs(lens[13] - lens_before[13]) * slope_y * nearest;
        total += std::hypot(moved_x, moved_y) / nearest;
    }
    return total;
}

}  // namespace

void bind_projection(nanobind::module_& module) {
    module.def("project", &project, Unlocked());
    module.def("screen_places", &places<float>, Unlocked());
    module.def("screen_places", &places<double>, Unlocked());
    module.def("screen_bounds", &bounds<float>, Unlocked());
    module.def("screen_bounds", &bounds<double>, Unlocked());
    module.def("travel_bound", &travel, Unlocked());
}

}  // namespace nlens

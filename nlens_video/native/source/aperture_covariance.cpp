// Coverage and light that depend on each other over the aperture: `kernels/aperture_covariance.py`.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "module.h"
#include "vectors.h"

namespace nlens {
namespace {

using Plane = Array<const float, 2>;
using Picture = Array<const float, 3>;
using Band = std::tuple<int, int>;  // the first row, and the one past the last

// Points of the aperture by the radius of a disc of diameter 1, and where each sees a surface.
struct Views {
    int count;
    std::vector<float> along, down, x, y, near_coc;

    Views(Array<const float, 2> points, float aspect)
        : count(points.shape[0]), along(count), down(count), x(count), y(count), near_coc(count) {
        const float tall = 0.5f * aspect;
        for (int k = 0; k < count; ++k) {
            along[k] = 0.5f * points(k, 0);
            down[k] = tall * points(k, 1);
        }
    }

    // The surface point p that appears at a place from each point u of the aperture: it solves
    // p + coc(p) / 2 * u = place by a few rounds of fixed-point search.
    [[gnu::noinline]] void look(Plane coc, int column, int row, int rounds) {
        const float last_x = static_cast<float>(coc.shape[1] - 1),
                    last_y = static_cast<float>(coc.shape[0] - 1);
        const float place_x = static_cast<float>(column), place_y = static_cast<float>(row);
        const float* __restrict cocs = coc.data;
        const float* __restrict u = along.data(), * __restrict v = down.data();
        float* __restrict here = near_coc.data(), * __restrict to_x = x.data(), * __restrict to_y = y.data();
        const int width = coc.shape[1];
        const float first = coc(row, column);
        for (int k = 0; k < count; ++k) here[k] = first;
        for (int round = 0; round < rounds; ++round) {
            for (int k = 0; k < count; ++k) {
                const auto i = static_cast<std::int32_t>(
                    std::min(std::max(0.0f, place_x - here[k] * u[k] + 0.5f), last_x));
                const auto j = static_cast<std::int32_t>(
                    std::min(std::max(0.0f, place_y - here[k] * v[k] + 0.5f), last_y));
                here[k] = cocs[j * width + i];
            }
        }
        for (int k = 0; k < count; ++k) {
            to_x[k] = std::min(std::max(0.0f, place_x - here[k] * u[k]), last_x);
            to_y[k] = std::min(std::max(0.0f, place_y - here[k] * v[k]), last_y);
        }
    }

    // Values of a map at these places, between four pixels.
    [[gnu::noinline]] void sample(Plane values, float* __restrict out) const {
        const float* __restrict from = values.data;
        const float* __restrict at_x = x.data(), * __restrict at_y = y.data();
        const int width = values.shape[1], last_x = width - 1, last_y = values.shape[0] - 1;
        for (int k = 0; k < count; ++k) {
            const auto i = static_cast<std::int32_t>(at_x[k]), j = static_cast<std::int32_t>(at_y[k]);
            const float across = at_x[k] - static_cast<float>(i), below = at_y[k] - static_cast<float>(j);
            const int beside = i < last_x ? 1 : 0, under = j < last_y ? width : 0, at = j * width + i;
            const float upper = from[at] + across * (from[at + beside] - from[at]);
            const float lower = from[at + under] + across * (from[at + under + beside] - from[at + under]);
            out[k] = upper + below * (lower - upper);
        }
    }

    Float4 light(Picture values, int k) const {
        const auto i = static_cast<std::int32_t>(x[k]), j = static_cast<std::int32_t>(y[k]);
        const float across = x[k] - static_cast<float>(i), below = y[k] - static_cast<float>(j);
        const int beside = i + 1 < values.shape[1] ? 4 : 0;
        const float* upper = values.at(j, i);
        const float* lower = j + 1 < values.shape[0] ? upper + 4 * values.shape[1] : upper;
        const Float4 a = load<Float4>(upper), b = load<Float4>(lower);
        const Float4 above = a + across * (load<Float4>(upper + beside) - a);
        const Float4 under = b + across * (load<Float4>(lower + beside) - b);
        return above + below * (under - above);
    }
};

// Rows of the covariance of the near layer's coverage and the back layer's light.
void aperture_covariance(std::tuple<Plane, Plane> near, std::tuple<Picture, Plane> back,
                         Array<const float, 2> points, float aspect, Array<const bool, 2> wanted,
                         Array<float, 3> out, Band band) {
    const auto& [coverage, near_coc] = near;
    const auto& [light, back_coc] = back;
    Views views(points, aspect);
    std::vector<float> covers(views.count);
    const float scale = 1.0f / static_cast<float>(views.count);
    for (int y = std::get<0>(band); y < std::get<1>(band); ++y) {
        for (int x = 0; x < wanted.shape[1]; ++x) {
            if (!wanted(y, x)) continue;
            views.look(near_coc, x, y, 2);
            views.sample(coverage, covers.data());
            views.look(back_coc, x, y, 1);
            Float4 total{}, both{};  // light, and its product with the coverage
            float covered = 0.0f;
            for (int k = 0; k < views.count; ++k) {
                const Float4 seen = views.light(light, k);
                total += seen;
                both += covers[k] * seen;
                covered += covers[k];
            }
            store(out.at(y, x), scale * (both - (scale * covered) * total));
        }
    }
}

// Slope of the coverage along columns and rows (Sobel), at the border as beside it [1 / px].
struct Slope {
    double along = 0.0, down = 0.0;

    Slope(Picture rgba, int y, int x) {
        const int rows[] = {std::max(y - 1, 0), y, std::min(y + 1, rgba.shape[0] - 1)};
        const int columns[] = {std::max(x - 1, 0), x, std::min(x + 1, rgba.shape[1] - 1)};
        const auto alpha = [&](int j, int i) { return static_cast<double>(rgba(rows[j], columns[i], 3)); };
        for (int k = 0; k < 3; ++k) {
            const double weight = k == 1 ? 0.25 : 0.125;
            along += weight * (alpha(k, 2) - alpha(k, 0));
            down += weight * (alpha(2, k) - alpha(0, k));
        }
    }
};

// Adds a part of what the plate shows at a place more than here, between four pixels.
void add_displaced(Picture plate, double y, double x, const float* here, double part, float* out) {
    const int last_y = plate.shape[0] - 1, last_x = plate.shape[1] - 1;
    y = std::min(std::max(0.0, y), static_cast<double>(last_y));
    x = std::min(std::max(0.0, x), static_cast<double>(last_x));
    const int j = static_cast<int>(y), i = static_cast<int>(x);
    const double down = y - j, along = x - i;
    const int j1 = std::min(j + 1, last_y), i1 = std::min(i + 1, last_x);
    const float *a = plate.at(j, i), *b = plate.at(j, i1), *p = plate.at(j1, i), *q = plate.at(j1, i1);
    for (int c = 0; c < 3; ++c) {
        const double above = a[c] + along * static_cast<double>(b[c] - a[c]);
        const double below = p[c] + along * static_cast<double>(q[c] - p[c]);
        const double seen = above + down * (below - above);
        out[c] = static_cast<float>(out[c] + part * (seen - here[c]));
    }
}

struct Parallax {
    int top, left;         // of the layer on the plate
    double aspect, least;  // least: coverage, or what it leaves free, below this changes no sample
    static constexpr auto fields =
        std::tuple{&Parallax::top, &Parallax::left, &Parallax::aspect, &Parallax::least};
};

// Rows of the layer, corrected for what the free part of the aperture sees of the plate.
void edge_parallax(Picture rgba, Picture plate, std::tuple<Plane, Plane> cocs, Plane trust,
                   Array<const float, 1> table, const Parallax& numbers, Array<float, 3> out, Band band) {
    const auto& [object_coc, plate_coc] = cocs;
    const double aspect = numbers.aspect;
    for (int y = std::get<0>(band); y < std::get<1>(band); ++y) {
        for (int x = 0; x < rgba.shape[1]; ++x) {
            const double alpha = rgba(y, x, 3), free = 1.0 - alpha, trusted = trust(y, x);
            if (!(alpha >= numbers.least && free >= numbers.least && trusted > 0.0)) continue;
            const double place = alpha * (table.shape[0] - 2);
            const int entry = static_cast<int>(place);
            double scale =
                table(entry) + (place - entry) * static_cast<double>(table(entry + 1) - table(entry));
            scale *= 0.5 * object_coc(y, x) / free;
            const Slope slope(rgba, y, x);
            double u = scale * slope.along, v = scale * slope.down * aspect;
            const double length = std::sqrt(u * u + v * v);
            if (length > 1.0) u /= length, v /= length;
            const double moved = 0.5 * plate_coc(y, x);
            const int row = y + numbers.top, column = x + numbers.left;
            add_displaced(plate, row - moved * v * aspect, column - moved * u, plate.at(row, column),
                          free * trusted, out.at(y, x));
        }
    }
}

}  // namespace

void bind_aperture_covariance(nanobind::module_& module) {
    module.def("aperture_covariance", &aperture_covariance, Unlocked());
    module.def("edge_parallax", &edge_parallax, Unlocked());
}

}  // namespace nlens

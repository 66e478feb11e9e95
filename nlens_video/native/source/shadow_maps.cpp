// Surface points looked up in maps of the casters: `effects/shadow/shadow_maps.py`.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <tuple>
#include <vector>

#include "module.h"
#include "vectors.h"

namespace nlens {
namespace {

constexpr int kBlock = 256;           // points that are projected at a time
constexpr double kClosest = 1e-6;     // to a near lamp [scene unit]
constexpr double kOutside = -1e4;     // column of points behind a near lamp [px]
constexpr float kNothing = -3.0e38f;  // nearness where nothing is drawn

// The views of some lights of one kind: matrices (N, 3, 4), whether they are distant, and columns and
// rows of their maps (N, 2).
struct Views {
    Array<const double, 3> matrices;
    int far;
    Array<const std::int32_t, 2> sizes;
    static constexpr auto fields = std::tuple{&Views::matrices, &Views::far, &Views::sizes};

    int count() const { return matrices.shape[0]; }
};

// Some points, coordinate by coordinate.
struct Block {
    double x[kBlock], y[kBlock], z[kBlock];
    int count;

    Block(Array<const float, 2> points, int first) : count(std::min(kBlock, points.shape[0] - first)) {
        for (int i = 0; i < count; ++i) {
            const float* point = points.at(first + i);
            x[i] = point[0], y[i] = point[1], z[i] = point[2];
        }
    }
};

// Columns and rows [px] of some points in a map, and their nearness to its light.
struct Places {
    double column[kBlock], row[kBlock], near[kBlock];

    void project(const Views& views, int number, const Block& block) {
        const double *a = views.matrices.at(number, 0), *b = views.matrices.at(number, 1),
                     *c = views.matrices.at(number, 2);
        for (int i = 0; i < block.count; ++i) {
            const double x = block.x[i], y = block.y[i], z = block.z[i];
            column[i] = (a[0] * x + a[1] * y + a[2] * z) + a[3];
            row[i] = (b[0] * x + b[1] * y + b[2] * z) + b[3];
            near[i] = (c[0] * x + c[1] * y + c[2] * z) + c[3];
        }
        if (views.far) return;
        for (int i = 0; i < block.count; ++i) {
            const double depth = near[i], before = std::max(depth, kClosest);
            column[i] = depth > 0.0 ? column[i] / before : kOutside;
            row[i] = row[i] / before;
            near[i] = -depth;
        }
    }

    // Which of the points lie inside a map of that size, moved to its corner; 0 or 1, in whole words.
    void inside(int count, double left, double top, int width, int height, std::uint8_t* found) {
        for (int i = 0; i < count; ++i) {
            column[i] -= left, row[i] -= top;
            found[i] = (column[i] >= 0.0) & (row[i] >= 0.0) & (column[i] < width) & (row[i] < height);
        }
        std::fill(found + count, found + kBlock, std::uint8_t{0});
    }
};

// What is drawn: cells of how many pixels each way (n,), the nearness of the first surface in them
// (n, cells, cells), where in each pixel it is sampled (n, 2), one bit a view (h, w), and the share that
// transparent surfaces take, (n, h, w) or nothing.
struct Drawn {
    Array<const std::int32_t, 1> sides;
    Array<const float, 3> first;
    Array<const double, 2> at;
    Array<const std::uint8_t, 2> bits;
    Array<const float, 3> taken;
    static constexpr auto fields =
        std::tuple{&Drawn::sides, &Drawn::first, &Drawn::at, &Drawn::bits, &Drawn::taken};

    // Share of a light that is kept from a point at a pixel of its map.
    float blocked(int number, int column, int row, float near) const {
        const bool opaque = (bits(row, column) >> number) & 1;
        const float share = opaque ? 1.0f : (taken.shape[0] ? taken(number, row, column) : 0.0f);
        if (!(share > 0.0f)) return 0.0f;
        const int side = sides(number);
        return near < first(number, row / side, column / side) ? share : 0.0f;
    }
};

// What each light counts at points of normals (M, 3): the cosine to vectors (n, 3), as long as the light
// is bright. Without normals (0, 3) each counts 1.
struct Weights {
    Array<const float, 2> normals, toward;
    static constexpr auto fields = std::tuple{&Weights::normals, &Weights::toward};

    float of(int point, int number) const {
        if (!normals.shape[0]) return 1.0f;
        const float *n = normals.at(point), *t = toward.at(number);
        return std::max((n[0] * t[0] + n[1] * t[1]) + n[2] * t[2], 0.0f);
    }
};

// The maps' first surfaces (N, cells, cells) from points of the casters (P, 3), and the nearest of all
// (N,). Cells without a point take the nearest of their neighbours.
void first_surfaces(Array<const float, 2> points, const Views& views, Array<const std::int32_t, 1> sides,
                    Array<float, 3> first, Array<double, 1> nearest) {
    const int cells = first.shape[1], width = first.shape[2];
    std::vector<float> own(static_cast<std::size_t>(cells) * width);
    Places places;
    for (int number = 0; number < views.count(); ++number) {
        float farthest = std::numeric_limits<float>::max();
        double most = -std::numeric_limits<double>::infinity();
        std::fill(own.begin(), own.end(), kNothing);
        const int side = sides(number);
        for (int start = 0; start < points.shape[0]; start += kBlock) {
            const Block block(points, start);
            places.project(views, number, block);
            for (int i = 0; i < block.count; ++i) {
                const auto cell = [side](double place, int limit) {
                    return static_cast<int>(std::clamp(place / side, 0.0, limit - 1.0));
                };
                float& held = own[static_cast<std::size_t>(cell(places.row[i], cells)) * width +
                                  cell(places.column[i], width)];
                const auto near = static_cast<float>(places.near[i]);
                held = std::max(held, near);
                farthest = std::min(farthest, near);
                most = std::max(most, places.near[i]);
            }
        }
        nearest(number) = most;
        for (int y = 0; y < cells; ++y) {
            for (int x = 0; x < width; ++x) {
                float best = farthest;
                for (int v = std::max(y - 1, 0); v <= std::min(y + 1, cells - 1); ++v)
                    for (int u = std::max(x - 1, 0); u <= std::min(x + 1, width - 1); ++u)
                        best = std::max(best, own[static_cast<std::size_t>(v) * width + u]);
                first(number, y, x) = best;
            }
        }
    }
}

// Marks points (M, 3) that may lie in the casters' shadow, in any view.
void may_be_blocked(Array<const float, 2> points, const Views& views, Array<const double, 1> nearest,
                    Array<bool, 1> found) {
    Places places;
    for (int start = 0; start < points.shape[0]; start += kBlock) {
        const Block block(points, start);
        for (int number = 0; number < views.count(); ++number) {
            const double width = views.sizes(number, 0), height = views.sizes(number, 1);
            places.project(views, number, block);
            for (int i = 0; i < block.count; ++i) {
                const double column = places.column[i], row = places.row[i];
                found(start + i) |= (column >= 0.0) & (row >= 0.0) & (column <= width) & (row <= height) &
                                    (places.near[i] < nearest(number));
            }
        }
    }
}

// Adds what is blocked of some lights at points (M, 3), and all that there is of them, to sums (2, M).
void add_blocked(Array<const float, 2> points, const Views& views, const Drawn& drawn, const Weights& weights,
                 Array<float, 2> sums) {
    Places places;
    std::uint8_t inside[kBlock];
    for (int start = 0; start < points.shape[0]; start += kBlock) {
        const Block block(points, start);
        for (int number = 0; number < views.count(); ++number) {
            const int width = views.sizes(number, 0), height = views.sizes(number, 1);
            const double left = drawn.at(number, 0) - 0.5, top = drawn.at(number, 1) - 0.5;
            places.project(views, number, block);
            float *blocked = sums.at(0, start), *all = sums.at(1, start);
            for (int i = 0; i < block.count; ++i) all[i] += weights.of(start + i, number);
            places.inside(block.count, left, top, width, height, inside);
            for (int first = 0; first < block.count; first += 8) {
                if (load<std::uint64_t>(inside + first) == 0) continue;
                for (int i = first; i < first + 8; ++i) {
                    if (!inside[i]) continue;
                    const float share =
                        drawn.blocked(number, static_cast<int>(places.column[i]),
                                      static_cast<int>(places.row[i]), static_cast<float>(places.near[i]));
                    if (share > 0.0f) blocked[i] += share * weights.of(start + i, number);
                }
            }
        }
    }
}

// The loss (M, 3) at points, by what each light gives (n, M, 3) and the share of it that is blocked (n, M).
void lost_light(Array<const float, 2> shares, Array<const double, 3> given, Array<float, 2> loss) {
    const int lights = shares.shape[0];
    for (int i = 0; i < loss.shape[0]; ++i) {
        for (int k = 0; k < 3; ++k) {
            double total = 0.0, lost = 0.0;
            for (int number = 0; number < lights; ++number) {
                total += given(number, i, k);
                lost += shares(number, i) * given(number, i, k);
            }
            loss(i, k) = static_cast<float>(total > 0.0 ? lost / total : 0.0);
        }
    }
}

// Irradiance / pi (M, 3) of surfaces of unit normals (M, 3) by ambient light (9, 3).
void ambient_light(Array<const double, 2> normals, Array<const double, 2> ambient, Array<double, 2> light) {
    for (int i = 0; i < normals.shape[0]; ++i) {
        const double x = normals(i, 0), y = normals(i, 1), z = normals(i, 2);
        const double terms[] = {1.0, y, z, x, x * y, y * z, 3.0 * z * z - 1.0, x * z, x * x - y * y};
        double sums[3] = {};
        for (int term = 0; term < 9; ++term)
            for (int k = 0; k < 3; ++k) sums[k] += terms[term] * ambient(term, k);
        for (int k = 0; k < 3; ++k) light(i, k) = std::max(sums[k], 0.0);
    }
}

// The slopes across and down of the plane that fits best among the windows that hold a pixel, `reach`
// pixels around it, by what each leaves (h, w): of every so many pixels, into slopes (h / step, w / step, 2).
void best_slopes(Array<const double, 2> across, Array<const double, 2> down, Array<const double, 2> left,
                 int reach, Array<float, 3> slopes) {
    const int height = left.shape[0], width = left.shape[1];
    for (int y = 0; y < height; ++y) {
        const int rows[] = {y, std::max(y - reach, 0), std::min(y + reach, height - 1)};
        for (int x = 0; x < width; ++x) {
            const int columns[] = {x, std::max(x - reach, 0), std::min(x + reach, width - 1)};
            int row = y, column = x;
            for (const int v : rows) {
                for (const int u : columns) {
                    if (left(v, u) < left(row, column)) row = v, column = u;
                }
            }
            slopes(y, x, 0) = static_cast<float>(across(row, column));
            slopes(y, x, 1) = static_cast<float>(down(row, column));
        }
    }
}

}  // namespace

void bind_shadow_maps(nanobind::module_& module) {
    module.def("first_surfaces", &first_surfaces, Unlocked());
    module.def("may_be_blocked", &may_be_blocked, Unlocked());
    module.def("add_blocked", &add_blocked, Unlocked());
    module.def("lost_light", &lost_light, Unlocked());
    module.def("ambient_light", &ambient_light, Unlocked());
    module.def("best_slopes", &best_slopes, Unlocked());
}

}  // namespace nlens

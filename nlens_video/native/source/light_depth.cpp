// Depth of the object as its lights see it, and what of their light reaches a point.
#include "light_depth.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <numbers>
#include <tuple>

#include "module.h"
#include "vectors.h"

namespace nlens {
namespace {

constexpr int kCell = 16;          // pixels of a cell each way
constexpr float kNarrow = 6.0f;    // radius from which on more taps look for what blocks the light [px]
constexpr float kSharpest = 1.0f;  // radius of the filter [px]
constexpr float kBias = 1.0f, kSlopeBias = 0.5f, kSteepest = 64.0f;  // [px], of the slope, [1]

// Points of the unit disc, of equal areas (Vogel 1979).
template <int kTaps>
struct Disc {
    float x[kTaps], y[kTaps];

    Disc() {
        for (int i = 0; i < kTaps; ++i) {
            const double radius = std::sqrt((i + 0.5) / kTaps);
            const double turn = i * std::numbers::pi * (3.0 - std::sqrt(5.0));
            x[i] = static_cast<float>(radius * std::cos(turn));
            y[i] = static_cast<float>(radius * std::sin(turn));
        }
    }
};

template <int kTaps>
const Disc<kTaps> kDisc;

inline float product(const float* row, Vector v, float last) {
    return row[0] * v.x + row[1] * v.y + row[2] * v.z + row[3] * last;
}

// A point of a surface in a map, and how near around it something must be to the light to block it.
struct Receiver {
    float column, row, nearness, across, down, bias;

    float least(float x, float y) const {
        const float plane = nearness + (x + 0.5f - column) * across + (y + 0.5f - row) * down;
        return std::max(plane, nearness) + bias;
    }
};

// Pixels of a map at the taps of a disc around a receiver. Loops over taps vectorise, but for the reads.
template <int kTaps>
class Taps {
public:
    // `shift` is added to the places, which are rounded down; beyond the border lies what is on it.
    Taps(Array<const float, 3> maps, int number, const Receiver& at, float radius, float shift)
        : nearness_(maps.at(number)), side_(maps.shape[1]), at_(at) {
        const float end = static_cast<float>(side_ - 2);  // one pixel more can be read
        for (int i = 0; i < kTaps; ++i) {
            const float x = std::min(std::max(at.column + radius * kDisc<kTaps>.x[i] + shift, 0.0f), end);
            const float y = std::min(std::max(at.row + radius * kDisc<kTaps>.y[i] + shift, 0.0f), end);
            column_[i] = static_cast<std::int32_t>(x), row_[i] = static_cast<std::int32_t>(y);
            across_[i] = x - static_cast<float>(column_[i]), down_[i] = y - static_cast<float>(row_[i]);
            index_[i] = row_[i] * side_ + column_[i];
        }
    }

    // The mean nearness of what blocks the light, less that of the point; 0 for nothing.
    float blocker() const {
        float before[kTaps];
        std::int32_t blocks[kTaps], count = 0;
        read(0, before);
        for (int i = 0; i < kTaps; ++i) {
            blocks[i] = before[i] > least(i, 0, 0);
            before[i] = blocks[i] ? before[i] - at_.nearness : 0.0f;
        }
        for (int i = 0; i < kTaps; ++i) count += blocks[i];
        return count ? sum(before) / static_cast<float>(count) : 0.0f;
    }

    // The share of the taps that are blocked, each between four pixels.
    float blocked_share() const {
        float corners[4][kTaps], shares[kTaps];
        for (int corner = 0; corner < 4; ++corner) {
            const int x = corner & 1, y = corner >> 1;
            read(y * side_ + x, corners[corner]);
            for (int i = 0; i < kTaps; ++i)
                corners[corner][i] = corners[corner][i] > least(i, x, y) ? 1.0f : 0.0f;
        }
        for (int i = 0; i < kTaps; ++i) {
            const float above = corners[0][i] + (corners[1][i] - corners[0][i]) * across_[i];
            const float below = corners[2][i] + (corners[3][i] - corners[2][i]) * across_[i];
            shares[i] = above + (below - above) * down_[i];
        }
        return sum(shares) / kTaps;
    }

private:
    float least(int i, int x, int y) const {
        return at_.least(static_cast<float>(column_[i] + x), static_cast<float>(row_[i] + y));
    }

    void read(int beyond, float* values) const {
        for (int i = 0; i < kTaps; ++i) values[i] = nearness_[index_[i] + beyond];
    }

    // In one order at every level of processors.
    static float sum(const float* values) {
        float sums[4] = {};
        for (int i = 0; i < kTaps; i += 4) {
            for (int k = 0; k < 4; ++k) sums[k] += values[i + k];
        }
        return (sums[0] + sums[1]) + (sums[2] + sums[3]);
    }

    const float* nearness_;
    int side_;
    const Receiver& at_;
    std::int32_t column_[kTaps], row_[kTaps], index_[kTaps];
    float across_[kTaps], down_[kTaps];
};

template <int kTaps>
float blocker(const DepthMaps& maps, int number, const Receiver& at, float radius) {
    return Taps<kTaps>(maps.nearness, number, at, radius, 0.0f).blocker();
}

template <int kTaps>
float blocked_share(const DepthMaps& maps, int number, const Receiver& at, float radius) {
    return Taps<kTaps>(maps.nearness, number, at, radius, -0.5f).blocked_share();
}

// What of a surface is drawn: texture coordinates and factor of alpha (V, 3), or (0, 3) where all is; the
// texture's alpha, how it is wrapped, and from which alpha on the surface is there.
struct Cutout {
    Array<const float, 2> surface, alpha;
    std::tuple<int, int> wrap;
    float cutoff;
    static constexpr auto fields =
        std::tuple{&Cutout::surface, &Cutout::alpha, &Cutout::wrap, &Cutout::cutoff};

    bool drawn(const std::int32_t* corners, const float (&weights)[3]) const {
        if (!surface.shape[0]) return true;
        float sums[3] = {};
        for (int k = 0; k < 3; ++k) {
            for (int c = 0; c < 3; ++c) sums[c] += weights[k] * surface(corners[k], c);
        }
        const auto [along_u, along_v] = wrap;
        const int column = texel(sums[0], alpha.shape[1], along_u);
        const int row = texel(sums[1], alpha.shape[0], along_v);
        return alpha(row, column) * sums[2] >= cutoff;
    }

private:
    // The texel at a coordinate: 0 repeated, 1 mirrored, 2 clamped.
    static int texel(float place, int size, int wrap) {
        if (!(std::fabs(place) < 1e6f)) return 0;
        if (wrap == 0) place -= std::floor(place);
        if (wrap == 1) place = 1.0f - std::fabs(place - 2.0f * std::floor(0.5f * place) - 1.0f);
        return std::clamp(static_cast<int>(place * size), 0, size - 1);
    }
};

// Middles of the pixels of a vector, from its first one.
const Floats kMiddles = [] {
    Floats made;
    for (std::size_t i = 0; i < sizeof(Floats) / sizeof(float); ++i) made[i] = static_cast<float>(i) + 0.5f;
    return made;
}();

// Where a line crosses rows of a map.
struct Edge {
    float column, row, slope;

    Edge(const float* p, const float* q)
        : column(p[0]), row(p[1]), slope(q[1] > p[1] ? (q[0] - p[0]) / (q[1] - p[1]) : 0.0f) {}

    float at(float y) const { return column + (y - row) * slope; }
};

// A triangle in a map: corners (column, row, nearness), and how its nearness changes.
struct DrawnTriangle {
    const float *a, *b, *c;
    float scale;  // one by twice its area
    float across, down, low, high;

    DrawnTriangle(const float* p, const float* q, const float* r) : a(p), b(q), c(r) {
        const float ux = q[0] - p[0], uy = q[1] - p[1], vx = r[0] - p[0], vy = r[1] - p[1];
        scale = 1.0f / (ux * vy - vx * uy);
        across = ((q[2] - p[2]) * vy - (r[2] - p[2]) * uy) * scale;
        down = ((r[2] - p[2]) * ux - (q[2] - p[2]) * vx) * scale;
        low = std::min({p[2], q[2], r[2]}), high = std::max({p[2], q[2], r[2]});
    }

    float nearness(float x, float y) const {
        const float found = a[2] + (x - a[0]) * across + (y - a[1]) * down;
        return std::min(std::max(found, low), high);  // slivers have any slope
    }

    void weigh(float x, float y, float (&weights)[3]) const {
        const auto weight = [&](const float* p, const float* q) {
            return ((q[0] - p[0]) * (y - p[1]) - (x - p[0]) * (q[1] - p[1])) * scale;
        };
        weights[0] = weight(b, c), weights[1] = weight(c, a), weights[2] = weight(a, b);
    }
};

// The first of some whole numbers whose middle is at or beyond a place.
inline int first_beyond(float place, int end) {
    return static_cast<int>(std::ceil(std::min(std::max(0.0f, place - 0.5f), static_cast<float>(end))));
}

// Calls `draw(row, first, end)` with the columns of pixels whose centres a triangle holds, row by row.
template <class Draw>
void for_rows(const DrawnTriangle& triangle, int first, int last, int width, Draw draw) {
    const float *top = triangle.a, *middle = triangle.b, *bottom = triangle.c;
    if (middle[1] < top[1]) std::swap(top, middle);
    if (bottom[1] < middle[1]) std::swap(middle, bottom);
    if (middle[1] < top[1]) std::swap(top, middle);
    const Edge whole(top, bottom);
    const auto part = [&](const float* from, const float* to) {
        const Edge edge(from, to);
        const int end = first_beyond(to[1], last);
        for (int y = std::max(first_beyond(from[1], last), first); y < end; ++y) {
            const float place = static_cast<float>(y) + 0.5f, one = whole.at(place), other = edge.at(place);
            draw(y, first_beyond(std::min(one, other), width), first_beyond(std::max(one, other), width));
        }
    };
    part(top, middle), part(middle, bottom);
}

// Raises the columns [first, end) of a row of a map to the nearness of a triangle. In whole vectors, of
// which a row has some: most triangles are a few pixels wide.
inline void raise(const DrawnTriangle& triangle, int y, int first, int end, float* row) {
    constexpr int kLanes = sizeof(Floats) / sizeof(float);
    static_assert(kCell % kLanes == 0);
    const float begin = triangle.a[2] + (static_cast<float>(y) + 0.5f - triangle.a[1]) * triangle.down;
    const float left = static_cast<float>(first), right = static_cast<float>(end);
    for (int x = first / kLanes * kLanes; x < end; x += kLanes) {
        const Floats place = kMiddles + static_cast<float>(x), before = load<Floats>(row + x);
        Floats near = begin + (place - triangle.a[0]) * triangle.across;
        near = near < triangle.low ? Floats{} + triangle.low : near;  // slivers have any slope
        near = near > triangle.high ? Floats{} + triangle.high : near;
        store(row + x, (place > left) & (place < right) & (near > before) ? near : before);
    }
}

// Raises rows [first, last) of a map to the nearness of triangles with corners (V, 3) [px, px, nearness].
void draw_nearness(Array<const float, 2> points, Array<const std::int32_t, 2> faces, const Cutout& cutout,
                   int first, int last, Array<float, 2> map) {
    const bool solid = cutout.surface.shape[0] == 0;
    for (int t = 0; t < faces.shape[0]; ++t) {
        const std::int32_t* corners = faces.at(t);
        const float *a = points.at(corners[0]), *b = points.at(corners[1]), *c = points.at(corners[2]);
        const float top = std::max(std::ceil(std::min({a[1], b[1], c[1]}) - 0.5f), static_cast<float>(first));
        const float end = std::min(std::max({a[1], b[1], c[1]}) - 0.5f, static_cast<float>(last - 1));
        const float left_most = std::ceil(std::min({a[0], b[0], c[0]}) - 0.5f);
        if (!(top <= end) || !(left_most <= std::max({a[0], b[0], c[0]}) - 0.5f)) continue;  // no centre
        const DrawnTriangle triangle(a, b, c);
        if (!std::isfinite(triangle.scale)) continue;
        for_rows(triangle, first, last, map.shape[1], [&](int y, int left, int right) {
            float* row = map.at(y);
            if (solid) return raise(triangle, y, left, right, row);
            for (int x = left; x < right; ++x) {
                const float u = static_cast<float>(x) + 0.5f, v = static_cast<float>(y) + 0.5f;
                const float found = triangle.nearness(u, v);
                float weights[3];
                triangle.weigh(u, v, weights);
                if (found > row[x] && cutout.drawn(corners, weights)) row[x] = found;
            }
        });
    }
}

// The highest nearness (h / kCell, w / kCell) in each cell of some rows (h, w) of a map.
void highest_in_cells(Array<const float, 2> map, Array<float, 2> highest) {
    for (int cell_y = 0; cell_y < highest.shape[0]; ++cell_y) {
        for (int cell_x = 0; cell_x < highest.shape[1]; ++cell_x) {
            float columns[kCell];
            std::copy_n(map.at(kCell * cell_y) + kCell * cell_x, kCell, columns);
            for (int y = 1; y < kCell; ++y) {
                const float* row = map.at(kCell * cell_y + y) + kCell * cell_x;
                for (int x = 0; x < kCell; ++x) columns[x] = columns[x] > row[x] ? columns[x] : row[x];
            }
            highest(cell_y, cell_x) = *std::max_element(columns, columns + kCell);
        }
    }
}

// `visible` for points (N, 3), facets (N, 3) and directions (N, 3), for tests.
void visible_points(const DepthMaps& maps, int number, Array<const float, 2> places,
                    Array<const float, 2> facets, Array<const float, 2> towards, Array<float, 1> shares) {
    const auto vector = [](const float* v) { return Vector{v[0], v[1], v[2]}; };
    for (int i = 0; i < shares.shape[0]; ++i)
        shares(i) = visible(maps, number, vector(places.at(i)), vector(facets.at(i)), vector(towards.at(i)));
}

}  // namespace

float visible(const DepthMaps& maps, int number, Vector place, Vector facet, Vector toward) {
    const float* view = maps.views.at(number);
    const float w = product(view + 12, place, 1.0f);
    if (!(w > 0.0f)) return 1.0f;
    Receiver at{product(view, place, 1.0f) / w,
                product(view + 4, place, 1.0f) / w,
                product(view + 8, place, 1.0f) / w,
                0.0f,
                0.0f,
                view[kLift]};
    const float end = static_cast<float>(maps.nearness.shape[1]);
    if (!(at.column >= 0.0f && at.row >= 0.0f && at.column < end && at.row < end)) return 1.0f;
    if (dot(facet, toward) > 0.0f) {  // else its own body is before it, which is near it
        const float* planes = view + kPlanes4;
        const float offset = -dot(facet, place), depth = product(planes + 8, facet, offset);
        const float across = -product(planes, facet, offset) / depth;
        const float down = -product(planes + 4, facet, offset) / depth;
        const float slope = std::fabs(across) + std::fabs(down);
        if (slope < kSteepest) {
            at.across = across, at.down = down;
            at.bias = std::min(kBias + kSlopeBias * slope, at.bias);
        }
    }
    const int cell_x = static_cast<int>(at.column) / kCell, cell_y = static_cast<int>(at.row) / kCell;
    const float highest = maps.highest(number, cell_y, cell_x);
    if (!(highest > at.nearness + at.bias)) return 1.0f;
    const auto radius = [&](float before) {
        return std::min(std::max(view[kSoftness] * before, kSharpest), view[kSoftest]);
    };
    const float widest = radius(highest - at.nearness);
    const float before =
        widest <= kNarrow ? blocker<16>(maps, number, at, widest) : blocker<32>(maps, number, at, widest);
    if (!(before > 0.0f)) return 1.0f;
    const float own = radius(before);  // wide edges are drawn from more taps, so that none shows
    if (own <= 2.0f) return 1.0f - blocked_share<8>(maps, number, at, own);
    return 1.0f - (own <= 6.0f ? blocked_share<16> : blocked_share<32>)(maps, number, at, own);
}

void bind_light_depth(nanobind::module_& module) {
    module.attr("LIGHT_DEPTH_CELL") = kCell;
    module.attr("LIGHT_DEPTH_MAPS") = kDepthMaps;
    module.def("draw_nearness", &draw_nearness, Unlocked());
    module.def("highest_in_cells", &highest_in_cells, Unlocked());
    module.def("visible_points", &visible_points, Unlocked());
}

}  // namespace nlens

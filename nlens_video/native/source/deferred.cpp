// Each surface visible in a pixel is shaded once; resolve of its depth.
#include "deferred.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <limits>

#include "layers.h"
#include "module.h"
#include "raster.h"

namespace nlens {
namespace {

constexpr float kOneSurface = 1.005f;  // samples of one surface differ by less, seen from the front
constexpr float kSteeper = 1.5f;

// Whether two triangles share a corner and show the same side.
bool same_surface(const Mesh& mesh, int one, int other) {
    const std::int32_t *a = mesh.faces.at(one), *b = mesh.faces.at(other);
    bool shared = false;  // without branches, which nothing predicts
    for (int i = 0; i < 3; ++i) {
        for (int j = 0; j < 3; ++j) shared |= a[i] == b[j];
    }
    return shared && mesh.planes(one, kFacing) == mesh.planes(other, kFacing);
}

// The normal of a triangle, of any length, on the side that a direction points to.
Vector facet_of(const Mesh& mesh, int triangle, Vector to) {
    const std::int32_t* corners = mesh.faces.at(triangle);
    const auto corner = [&](int k) {
        const float* v = mesh.positions.at(corners[k]);
        return Vector{v[0], v[1], v[2]};
    };
    const Vector a = corner(0), normal = cross(corner(1) - a, corner(2) - a);
    return dot(normal, to) < 0.0f ? normal * -1.0f : normal;
}

// Finds which share of the lamps' light reaches the first `count` points of a block.
void find_visible(Block& block, int count, const Mesh& mesh, const Lights& lights) {
    if (!lights.depth.count()) return;
    for (int i = 0; i < count; ++i) {
        const Vector view = get(block.view, i);
        const Vector facet = facet_of(mesh, block.triangle[i], view);
        for (int n = 0; n < lights.lamps.shape[0]; ++n) {
            const int map = map_of(lights.lamps.at(n));
            if (map < 0) continue;
            const Vector toward = lamp_at(block, i, lights, n).toward;
            const bool lit = dot(get(block.normal, i), toward) > 0.0f;
            block.visible[map][i] =
                lit ? visible(lights.depth, map, view * -block.distance[i], facet, toward) : 1.0f;
        }
    }
}

constexpr int kEvery = (1 << kSamples) - 1;

// Where in a pixel the centre of some of its samples lies [px].
struct Centre {
    double x, y;
};

// Of each set of samples, a bit each.
constexpr auto kCentres = [] {
    std::array<Centre, kEvery + 1> centres{};
    for (int mask = 1; mask <= kEvery; ++mask) {
        Centre sum{};
        for (int s = 0; s < kSamples; ++s) {
            if (mask >> s & 1) sum.x += kSampleX[s], sum.y += kSampleY[s];
        }
        const int count = std::popcount(static_cast<unsigned>(mask));
        centres[mask] = {sum.x / count, sum.y / count};
    }
    return centres;
}();

// Points of the picture, shaded whenever a block is full.
class Points {
public:
    Points(const ShadingInputs& scene, Array<float, 2> rgba) : scene_(scene), rgba_(rgba) {}

    // A pixel's point adds `weight` of the pixel.
    void put(int triangle, int pixel, double x, double y, double weight) {
        block_.triangle[count_] = triangle;
        block_.pixel[count_] = pixel;
        block_.x[count_] = static_cast<float>(x);
        block_.y[count_] = static_cast<float>(y);
        block_.weight[count_] = static_cast<float>(weight);
        if (++count_ == kPoints) flush();
    }

    // Shades the points and adds their light to the pixels.
    void flush() {
        if (count_ == 0) return;
        shade(block_, count_, scene_);
        for (int i = 0; i < count_; ++i) {
            float* to = rgba_.at(block_.pixel[i]);
            const float weight = block_.weight[i];
            for (int c = 0; c < 3; ++c) to[c] += weight * std::min(block_.light[c][i], kBrightest);
            to[3] += weight;
        }
        count_ = 0;
    }

private:
    const ShadingInputs& scene_;
    Array<float, 2> rgba_;
    Block block_{};  // what no point has written must be harmless numbers
    int count_ = 0;
};

// The part of the light that reaches the samples of a pixel, of as many as are set in `mask`; `passed` is
// (0, 0) where all reaches all.
double share_of(Array<const float, 2> passed, int y, int x, int mask) {
    if (passed.shape[0] == 0) return std::popcount(static_cast<unsigned>(mask));
    double share = 0.0;
    for (int s = 0; s < kSamples; ++s) {
        if (mask >> s & 1) share += passed(kSamples * y + s, x);
    }
    return share;
}

// Points of a pixel that shows several triangles, or less than a whole one.
void put_edge_pixel(Points& points, const Mesh& mesh, Array<const float, 2> passed, int y, int x, int pixel,
                    const int (&ids)[kSamples]) {
    int left = 0;
    for (int s = 0; s < kSamples; ++s) left |= (ids[s] != kNothing) << s;
    while (left) {
        const int t = ids[std::countr_zero(static_cast<unsigned>(left))];
        int own = 0;
        for (int s = 0; s < kSamples; ++s) own |= (ids[s] == t) << s;
        own &= left;
        int joined = own;
        for (int s = 0; s < kSamples; ++s) {
            if ((left & ~own) >> s & 1 && same_surface(mesh, t, ids[s])) joined |= 1 << s;
        }
        const Centre centre = kCentres[own];
        points.put(t, pixel, x + centre.x, y + centre.y, share_of(passed, y, x, joined) / kSamples);
        left &= ~joined;
    }
}

// Adds the light of the opaque surfaces to rows [first, last) of the picture, `rgba` (h * width, 4).
void shade_rows(int first, int last, int width, Array<const std::int32_t, 2> ids,
                Array<const float, 2> passed, const ShadingInputs& scene, Array<float, 2> rgba) {
    const bool all_passes = passed.shape[0] == 0;
    Points points(scene, rgba);
    for (int y = first; y < last; ++y) {
        const std::int32_t* line[kSamples];
        for (int s = 0; s < kSamples; ++s) line[s] = ids.at(kSamples * y + s);
        for (int x = 0; x < width; ++x) {
            const int here[kSamples] = {line[0][x], line[1][x], line[2][x], line[3][x]};
            const int t = here[0], pixel = y * width + x;
            const bool every = t == here[1] && t == here[2] && t == here[3];
            if (every && t == kNothing) continue;
            if (every && all_passes) {
                points.put(t, pixel, x + 0.5, y + 0.5, 1.0);
            } else {
                put_edge_pixel(points, scene.mesh, passed, y, x, pixel, here);
            }
        }
    }
    points.flush();
}

// Disparities of samples (4 h, w or more), `least` for nothing.
struct Disparities {
    Array<const float, 2> samples;
    int height, width;
    float least;

    // Of the samples of a pixel, or of the nearest one in the picture: greatest less least.
    float spread(int y, int x) const {
        y = std::clamp(y, 0, height - 1);
        x = std::clamp(x, 0, width - 1);
        float low = std::max(samples(kSamples * y, x), least), high = low;
        for (int s = 1; s < kSamples; ++s) {
            const float d = std::max(samples(kSamples * y + s, x), least);
            low = std::min(low, d), high = std::max(high, d);
        }
        return high - low;
    }

    // Whether samples that differ lie on one steep surface and not on two. On a plane the neighbours'
    // samples differ as much; across a step, those of the neighbours on either side do not.
    bool steep(int y, int x) const {
        const float beside = std::min(spread(y, x - 1), spread(y, x + 1));
        const float over = std::min(spread(y - 1, x), spread(y + 1, x));
        return spread(y, x) < kSteeper * std::min(beside, over);
    }
};

// Fills in depths (h, w) on rows [first, last), +inf where nothing is; see `deferred.resolve_depth`.
void resolve_depth(Array<const float, 2> disparity, int first, int last, float least, Array<float, 2> depth) {
    const Disparities disparities{disparity, depth.shape[0], depth.shape[1], least};
    for (int y = first; y < last; ++y) {
        const float* line[kSamples];
        for (int s = 0; s < kSamples; ++s) line[s] = disparity.at(kSamples * y + s);
        float* to = depth.at(y);
        for (int x = 0; x < depth.shape[1]; ++x) {
            const float a = line[0][x], b = line[1][x], c = line[2][x], d = line[3][x];
            const float low = std::min(std::min(a, b), std::min(c, d));
            const float high = std::max(std::max(a, b), std::max(c, d));
            if (high == 0.0f) {
                to[x] = std::numeric_limits<float>::infinity();
            } else if (low > 0.0f && (high < kOneSurface * low || disparities.steep(y, x))) {
                to[x] = static_cast<float>(kSamples) / (a + b + c + d);
            } else {
                to[x] = 1.0f / high;
            }
        }
    }
}

}  // namespace

void shade(Block& block, int count, const ShadingInputs& scene) {
    const bool layers = evaluate_materials(block, count, scene.mesh, scene.paint, scene.lens);
    find_visible(block, count, scene.mesh, scene.lights);
    light_points(block, count, scene.lights);
    if (layers) light_layers(block, count, scene.paint, scene.lights);
}

void bind_deferred(nanobind::module_& module) {
    module.def("shade_rows", &shade_rows, Unlocked());
    module.def("resolve_depth", &resolve_depth, Unlocked());
}

}  // namespace nlens

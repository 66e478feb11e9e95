// Each surface visible in a pixel is shaded once; resolve of its depth.
#include "deferred.h"

#include <algorithm>
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
    if (mesh.planes(one, kFacing) != mesh.planes(other, kFacing)) return false;
    const std::int32_t *a = mesh.faces.at(one), *b = mesh.faces.at(other);
    return std::any_of(a, a + 3, [&](int corner) { return std::find(b, b + 3, corner) != b + 3; });
}

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

// Samples of the picture, a line of them for each of a pixel's four: the triangle, and the share of light
// that reaches it, (0, 0) for all of it.
struct Samples {
    Array<const std::int32_t, 2> ids;
    Array<const float, 2> passed;

    double share(int line, int x) const { return passed.shape[0] > 0 ? passed(line, x) : 1.0; }
};

// Points of a pixel that shows several triangles, or less than a whole one.
void put_edge_pixel(Points& points, const Mesh& mesh, const Samples& samples, int x, int y, int pixel) {
    int left = (1 << kSamples) - 1;
    for (int s = 0; s < kSamples; ++s) {
        const int t = samples.ids(kSamples * y + s, x);
        if (!(left >> s & 1) || t == kNothing) continue;
        double weight = 0.0, px = 0.0, py = 0.0;
        int own = 0;
        for (int other = s; other < kSamples; ++other) {
            const int line = kSamples * y + other, u = samples.ids(line, x);
            if (!(left >> other & 1) || u == kNothing) continue;
            if (u == t) {
                own += 1;
                px += kSampleX[other];
                py += kSampleY[other];
            } else if (!same_surface(mesh, t, u)) {
                continue;
            }
            weight += samples.share(line, x);
            left &= ~(1 << other);
        }
        points.put(t, pixel, x + px / own, y + py / own, weight / kSamples);
    }
}

// Adds the light of the opaque surfaces to rows [first, last) of the picture, `rgba` (h * width, 4).
void shade_rows(int first, int last, int width, Array<const std::int32_t, 2> ids,
                Array<const float, 2> passed, const ShadingInputs& scene, Array<float, 2> rgba) {
    const Samples samples{ids, passed};
    const bool all_passes = passed.shape[0] == 0;
    Points points(scene, rgba);
    for (int y = first; y < last; ++y) {
        const std::int32_t* line[kSamples];
        for (int s = 0; s < kSamples; ++s) line[s] = ids.at(kSamples * y + s);
        for (int x = 0; x < width; ++x) {
            const int t = line[0][x], pixel = y * width + x;
            const bool every = t == line[1][x] && t == line[2][x] && t == line[3][x];
            if (every && t == kNothing) continue;
            if (every && all_passes) {
                points.put(t, pixel, x + 0.5, y + 0.5, 1.0);
            } else {
                put_edge_pixel(points, scene.mesh, samples, x, y, pixel);
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
    light_points(block, count, scene.lights);
    if (layers) light_layers(block, count, scene.paint, scene.lights);
}

void bind_deferred(nanobind::module_& module) {
    module.def("shade_rows", &shade_rows, Unlocked());
    module.def("resolve_depth", &resolve_depth, Unlocked());
}

}  // namespace nlens

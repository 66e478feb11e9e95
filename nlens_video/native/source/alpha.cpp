// Alpha-tested (MASK) and blended (BLEND) triangles, pixel by pixel: `render/software/alpha.py`.
//
// Blending runs from near to far: each sample stores its remaining transmittance only, no colour.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <tuple>

#include "deferred.h"
#include "module.h"
#include "raster.h"

namespace nlens {
namespace {

constexpr float kFlat = 1e-4f;  // change of alpha by a pixel, up to which it is the same all over it
constexpr int kPatterns[] = {0, 1, 9, 11, 15};  // samples of a pixel that is covered by so many quarters

struct Triangles {
    Shape shape;
    Array<const std::int32_t, 2> spans;  // first and last line of samples of each (F, 2)
    static constexpr auto fields = std::tuple{&Triangles::shape, &Triangles::spans};
};

struct Rows {
    int first, end;  // one beyond the last
    static constexpr auto fields = std::tuple{&Rows::first, &Rows::end};
};

// The samples of a picture, of which each pixel has four, on lines of their own.
template <class Number>
using Samples = Array<Number, 2>;

// The part of a triangle that lies in a pixel: its samples, a bit each, and their centroid.
struct Fragment {
    int triangle, x, y;
    int mask;
    double centre_x, centre_y;  // [px], in the picture
};

bool has(int mask, int sample) {
    return mask >> sample & 1;
}

// Calls `use(fragment)` for all that triangles cover on some rows, triangle by triangle.
template <class Use>
void for_each_fragment(Array<const std::int32_t, 1> drawn, Rows rows, int width, const Triangles& triangles,
                       const Use& use) {
    for (int n = 0; n < drawn.shape[0]; ++n) {
        const int t = drawn(n);
        const int top = std::max(rows.first, triangles.spans(t, 0) / kSamples);
        const int bottom = std::min(rows.end - 1, triangles.spans(t, 1) / kSamples);
        const Coverage coverage(triangles.shape, t);
        for (int y = top; y <= bottom; ++y) {
            Columns runs[kSamples];
            int left = width, right = 0;
            for (int s = 0; s < kSamples; ++s) {
                runs[s] = coverage.columns(kSamples * y + s, width);
                if (runs[s].first >= runs[s].last) continue;
                left = std::min(left, runs[s].first);
                right = std::max(right, runs[s].last);
            }
            for (int x = left; x < right; ++x) {
                int mask = 0, count = 0;
                double px = 0.0, py = 0.0;
                for (int s = 0; s < kSamples; ++s) {
                    if (x < runs[s].first || x >= runs[s].last) continue;
                    mask |= 1 << s;
                    count += 1;
                    px += kSampleX[s], py += kSampleY[s];
                }
                if (count) use(Fragment{t, x, y, mask, x + px / count, y + py / count});
            }
        }
    }
}

// Disparity of a triangle at one of a pixel's samples.
float disparity_at(const DisparityPlane& plane, int x, int y, int sample) {
    return plane.at(x + kSampleX[sample], y + kSampleY[sample]);
}

// Draws masked triangles; three points of a block for each fragment: here, a column on, a row on.
class Cutter {
public:
    Cutter(int width, const Mesh& mesh, const Paint& paint, Samples<const float> most,
           Samples<float> disparity, Samples<std::int32_t> ids)
        : width_(width), mesh_(mesh), paint_(paint), most_(most), disparity_(disparity), ids_(ids) {}

    void put(const Fragment& at) {
        for (int k = 0; k < 3; ++k) {
            block_.triangle[count_ + k] = at.triangle;
            block_.x[count_ + k] = static_cast<float>(at.centre_x + (k == 1));
            block_.y[count_ + k] = static_cast<float>(at.centre_y + (k == 2));
        }
        block_.pixel[count_] = at.y * width_ + at.x;
        block_.mask[count_] = at.mask;
        count_ += 3;
        if (count_ > kPoints - 3) flush();
    }

    void flush() {
        interpolate(block_, count_, mesh_);
        for (Run run{0, 0}; run.last < count_;) {
            run = same_material(block_, run.last, count_);
            base_colors(block_, run, paint_);
        }
        for (int i = 0; i < count_; i += 3) draw(i);
        count_ = 0;
    }

private:
    // Samples that the cutoff leaves, sharpened to one pixel around it.
    int kept(int i, float cutoff) const {
        const float here = block_.alpha[i];
        const float slope = std::fabs(block_.alpha[i + 1] - here) + std::fabs(block_.alpha[i + 2] - here);
        const float over = here - cutoff;
        float share = over >= 0.0f ? 1.0f : 0.0f;
        if (slope > kFlat) share = std::min(std::max(over / slope + 0.5f, 0.0f), 1.0f);
        return kPatterns[static_cast<int>(share * kSamples + 0.5f)];
    }

    void draw(int i) {
        const int t = block_.triangle[i], y = block_.pixel[i] / width_, x = block_.pixel[i] % width_;
        const int mask = block_.mask[i] & kept(i, paint_.numbers(block_.material[i], kCutoff));
        const DisparityPlane plane = disparity_plane(mesh_.planes, t);
        for (int s = 0; s < kSamples; ++s) {
            if (!has(mask, s)) continue;
            const float d = disparity_at(plane, x, y, s);
            if (most_.shape[0] > 0 && d > most_(y, x)) continue;
            float& nearest = disparity_(kSamples * y + s, x);
            if (d >= nearest) nearest = d, ids_(kSamples * y + s, x) = t;
        }
    }

    int width_;
    const Mesh& mesh_;
    const Paint& paint_;
    Samples<const float> most_;
    Samples<float> disparity_;
    Samples<std::int32_t> ids_;
    Block block_{};  // what no point has written must be harmless numbers
    int count_ = 0;
};

void cut_out(Array<const std::int32_t, 1> drawn, Rows rows, int width, const Triangles& triangles,
             const Mesh& mesh, const Paint& paint, Samples<const float> most, Samples<float> disparity,
             Samples<std::int32_t> ids) {
    Cutter cutter(width, mesh, paint, most, disparity, ids);
    for_each_fragment(drawn, rows, width, triangles, [&](const Fragment& at) { cutter.put(at); });
    cutter.flush();
}

// What blending changes: share of light that gets through to each sample, disparity of the nearest
// surface there, and premultiplied linear light (h * width, 4).
struct Blended {
    Samples<float> passed, front;
    Array<float, 2> rgba;
    static constexpr auto fields = std::tuple{&Blended::passed, &Blended::front, &Blended::rgba};
};

// Shades fragments and lays them, in order, under what lies before them.
class Blender {
public:
    Blender(int width, const ShadingInputs& scene, Samples<const float> disparity, const Blended& blended)
        : width_(width), scene_(scene), disparity_(disparity), blended_(blended) {}

    void put(const Fragment& at) {
        const int mask = seen(at);
        if (!mask) return;
        block_.triangle[count_] = at.triangle;
        block_.pixel[count_] = at.y * width_ + at.x;
        block_.mask[count_] = mask;
        block_.x[count_] = static_cast<float>(at.centre_x);
        block_.y[count_] = static_cast<float>(at.centre_y);
        if (++count_ == kPoints) flush();
    }

    void flush() {
        std::fill_n(block_.hidden, count_, 1.0f);  // less where light goes through
        shade(block_, count_, scene_);
        for (int i = 0; i < count_; ++i) {
            if (block_.alpha[i] > 0.0f) lay_under(i);
        }
        count_ = 0;
    }

private:
    // Those samples that no opaque surface hides.
    int seen(const Fragment& at) const {
        const DisparityPlane plane = disparity_plane(scene_.mesh.planes, at.triangle);
        int mask = at.mask;
        for (int s = 0; s < kSamples; ++s) {
            if (!has(mask, s)) continue;
            if (disparity_at(plane, at.x, at.y, s) < disparity_(kSamples * at.y + s, at.x)) mask &= ~(1 << s);
        }
        return mask;
    }

    void lay_under(int i) {
        const int pixel = block_.pixel[i], y = pixel / width_, x = pixel % width_;
        const DisparityPlane plane = disparity_plane(scene_.mesh.planes, block_.triangle[i]);
        const float alpha = block_.alpha[i], hidden = block_.hidden[i];
        float weight = 0.0f;
        for (int s = 0; s < kSamples; ++s) {
            if (!has(block_.mask[i], s)) continue;
            const int line = kSamples * y + s;
            weight += blended_.passed(line, x);
            blended_.passed(line, x) *= 1.0f - alpha * hidden;
            float& front = blended_.front(line, x);
            front = std::max(front, disparity_at(plane, x, y, s));
        }
        weight *= alpha / kSamples;
        float* to = blended_.rgba.at(pixel);
        for (int c = 0; c < 3; ++c) to[c] += weight * std::min(block_.light[c][i], kBrightest);
        to[3] += weight * hidden;
    }

    int width_;
    const ShadingInputs& scene_;
    Samples<const float> disparity_;
    const Blended& blended_;
    Block block_{};  // what no point has written must be harmless numbers
    int count_ = 0;
};

void blend(Array<const std::int32_t, 1> drawn, Rows rows, int width, const Triangles& triangles,
           const ShadingInputs& scene, Samples<const float> disparity, const Blended& blended) {
    Blender blender(width, scene, disparity, blended);
    for_each_fragment(drawn, rows, width, triangles, [&](const Fragment& at) { blender.put(at); });
    blender.flush();
}

}  // namespace

void bind_alpha(nanobind::module_& module) {
    module.def("cut_out_triangles", &cut_out, Unlocked());
    module.def("blend_triangles", &blend, Unlocked());
}

}  // namespace nlens

// Two depth layers of the object, and pull-push inpainting: `kernels/depth_layers.py`.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "module.h"
#include "vectors.h"

namespace nlens {
namespace {

using Mask = Array<const bool, 2>;
using Picture = Array<const float, 3>;

// Whether one of the eight neighbours of a pixel has a value in the mask, or the pixel itself.
bool touches(Mask mask, int y, int x, bool value) {
    const int left = std::max(0, x - 1), right = std::min(mask.shape[1], x + 2);
    for (int j = std::max(0, y - 1); j < std::min(mask.shape[0], y + 2); ++j) {
        const bool* row = mask.at(j);
        for (int i = left; i < right; ++i) {
            if (row[i] == value) return true;
        }
    }
    return false;
}

// Mean colour of what is wholly near within two pixels, and how much there is.
struct InnerMean {
    int count = 0;
    Float4 rgba{};

    InnerMean(Array<float, 3> colours, const std::vector<std::uint8_t>& inner, int y, int x) {
        const int height = colours.shape[0], width = colours.shape[1];
        for (int j = std::max(0, y - 2); j < std::min(height, y + 3); ++j) {
            for (int i = std::max(0, x - 2); i < std::min(width, x + 3); ++i) {
                if (!inner[static_cast<std::size_t>(j) * width + i]) continue;
                ++count;
                rgba += load<Float4>(colours.at(j, i));
            }
        }
        if (count > 0) rgba /= static_cast<float>(count);
    }
};

// Unmixes the near layer's antialiased edge pixels from the surface behind: their coverage is the
// mix of the near colour beside them and the inpainted back.
void take_back_out(Array<float, 3> near_rgba, Mask near, Mask back, Picture filled) {
    const int height = near.shape[0], width = near.shape[1];
    std::vector<std::uint8_t> inner(static_cast<std::size_t>(height) * width);
    std::vector<std::array<int, 2>> edges;
    for (int y = 0; y < height; ++y) {
        const bool* row = near.at(y);
        for (int x = 0; x < width; ++x) {
            if (!row[x]) continue;
            if (touches(back, y, x, true)) {
                edges.push_back({y, x});
            } else {
                inner[static_cast<std::size_t>(y) * width + x] = 1;
            }
        }
    }
    for (const auto [y, x] : edges) {
        const InnerMean mean(near_rgba, inner, y, x);
        if (mean.count == 0) continue;
        float* mixed = near_rgba.at(y, x);
        const float* behind = filled.at(y, x);
        double along = 0.0, square = 0.0;
        for (int c = 0; c < 3; ++c) {
            const float apart = mean.rgba[c] - behind[c];
            along += static_cast<double>((mixed[c] - behind[c]) * apart);
            square += static_cast<double>(apart * apart);
        }
        if (square <= 0.0) continue;
        const auto free = static_cast<float>(1.0 - std::min(std::max(along / square, 0.0), 1.0));
        for (int c = 0; c < 4; ++c) {
            // light of a wide gamut may be negative, coverage may not
            const float least = c < 3 ? std::min(static_cast<float>(mean.rgba[c]), 0.0f) : 0.0f;
            mixed[c] = std::max(mixed[c] - free * behind[c], least);
        }
    }
}

// Fills in the near layer's colours and those that it hides. Its antialiased pixels are those beside
// what is not near; only they are parted, for on a steep surface samples of one pixel lie apart too.
void part_layers(Mask near, Picture whole, Picture alone, Picture hidden, Array<float, 3> near_rgba,
                 Array<float, 3> back_rgba) {
    for (int y = 0; y < near.shape[0]; ++y) {
        for (int x = 0; x < near.shape[1]; ++x) {
            if (!near(y, x)) continue;
            const Picture& source = touches(near, y, x, false) ? alone : whole;
            std::copy_n(source.at(y, x), 4, near_rgba.at(y, x));
            std::copy_n(hidden.at(y, x), 4, back_rgba.at(y, x));
        }
    }
}

// Weighted means of 2 x 2 pixels, the first pixel `offset` into its cell, and their weights. The
// results come as zeros.
void halve(Picture values, Array<const float, 2> weight, std::tuple<int, int> offset, Array<float, 3> out,
           Array<float, 2> kept) {
    const auto [down, right] = offset;
    const int channels = values.shape[2];
    for (int y = 0; y < values.shape[0]; ++y) {
        for (int x = 0; x < values.shape[1]; ++x) {
            const float part = weight(y, x);
            if (part <= 0.0f) continue;
            const int j = (y + down) / 2, i = (x + right) / 2;
            const float* from = values.at(y, x);
            float* to = out.at(j, i);
            kept(j, i) += part;
            for (int c = 0; c < channels; ++c) to[c] += part * from[c];
        }
    }
    for (int j = 0; j < kept.shape[0]; ++j) {
        for (int i = 0; i < kept.shape[1]; ++i) {
            float& sum = kept(j, i);
            if (sum <= 0.0f) continue;
            float* mean = out.at(j, i);
            for (int c = 0; c < channels; ++c) mean[c] /= sum;
            sum = std::min(1.0f, sum);
        }
    }
}

// Two neighbouring pixels of the coarse level, and the share of the second one.
struct Between {
    int low, high;
    float share;

    Between(int fine, int offset, int count) {
        const double place = 0.5 * (fine + offset) - 0.25, first = std::floor(place);
        low = std::max(static_cast<int>(first), 0);
        high = std::min(static_cast<int>(first) + 1, count - 1);
        share = static_cast<float>(place - first);
    }
};

template <int Channels>
void raise_channels(Picture fine, Array<const float, 2> weight, Picture coarse, std::tuple<int, int> offset,
                    Array<float, 3> out) {
    const int channels = Channels > 0 ? Channels : fine.shape[2];
    for (int y = 0; y < fine.shape[0]; ++y) {
        const Between rows(y, std::get<0>(offset), coarse.shape[0]);
        for (int x = 0; x < fine.shape[1]; ++x) {
            const float known = weight(y, x), part = 1.0f - known;
            if (part <= 0.0f) continue;
            const Between columns(x, std::get<1>(offset), coarse.shape[1]);
            const float *a = coarse.at(rows.low, columns.low), *b = coarse.at(rows.low, columns.high);
            const float *p = coarse.at(rows.high, columns.low), *q = coarse.at(rows.high, columns.high);
            const float* own = fine.at(y, x);
            float* to = out.at(y, x);
            for (int c = 0; c < channels; ++c) {
                const float above = a[c] + columns.share * (b[c] - a[c]);
                const float below = p[c] + columns.share * (q[c] - p[c]);
                to[c] = known * own[c] + part * (above + rows.share * (below - above));
            }
        }
    }
}

// Fills the unknown pixels of the fine level, of which `out` is a copy, from the coarse one.
void raise(Picture fine, Array<const float, 2> weight, Picture coarse, std::tuple<int, int> offset,
           Array<float, 3> out) {
    const auto work = fine.shape[2] == 5 ? &raise_channels<5> : &raise_channels<0>;  // colour, alpha and CoC
    work(fine, weight, coarse, offset, out);
}

}  // namespace

void bind_depth_layers(nanobind::module_& module) {
    module.def("take_back_out", &take_back_out, Unlocked());
    module.def("part_layers", &part_layers, Unlocked());
    module.def("halve", &halve, Unlocked());
    module.def("raise_level", &raise, Unlocked());
}

}  // namespace nlens

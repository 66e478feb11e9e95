// Light absorbed by transparent triangles: `effects/shadow/transparency.py`.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>

#include "module.h"
#include "shadow_triangles.h"

namespace nlens {
namespace {

enum Wrap { kRepeated, kMirrored, kClamped };

// Alpha of a surface, and from which value on it is opaque; negative for alpha blending.
struct Texture {
    Array<const float, 2> alpha;
    std::tuple<int, int> wrap;
    double cutoff;
    static constexpr auto fields = std::tuple{&Texture::alpha, &Texture::wrap, &Texture::cutoff};
};

struct Sums {
    Array<float, 2> taken, left;
    Array<std::int32_t, 2> call;
    static constexpr auto fields = std::tuple{&Sums::taken, &Sums::left, &Sums::call};
};

struct Opaque {
    Array<const std::uint8_t, 2> bits;
    int number;
    static constexpr auto fields = std::tuple{&Opaque::bits, &Opaque::number};
};

std::int64_t remainder_of(std::int64_t index, std::int64_t size) {
    const std::int64_t rest = index % size;
    return rest < 0 ? rest + size : rest;
}

// The texel at any index, wrapped.
int texel(std::int64_t index, int size, int wrap) {
    if (index >= 0 && index < size) return static_cast<int>(index);
    if (wrap == kClamped) return index < 0 ? 0 : size - 1;
    if (wrap == kRepeated) return static_cast<int>(remainder_of(index, size));
    const std::int64_t turned = remainder_of(index, 2LL * size);
    return static_cast<int>(turned < size ? turned : 2LL * size - 1 - turned);
}

// Two neighbouring texels, and the share of the second one.
struct Between {
    int low, high;
    double share;

    Between(double place, int size, int wrap) {
        const double first = std::fabs(place) < 0x1p62 ? std::floor(place) : 0.0;
        const auto index = static_cast<std::int64_t>(first);
        low = texel(index, size, wrap);
        high = texel(index + 1, size, wrap);
        share = place - first;
    }
};

double sampled(const Texture& texture, double u, double v) {
    const auto& alpha = texture.alpha;
    const Between across(u * alpha.shape[1] - 0.5, alpha.shape[1], std::get<0>(texture.wrap));
    const Between down(v * alpha.shape[0] - 0.5, alpha.shape[0], std::get<1>(texture.wrap));
    const auto along = [&](int row) {
        const float low = alpha(row, across.low);
        return low + across.share * static_cast<double>(alpha(row, across.high) - low);
    };
    const double above = along(down.low);
    return above + down.share * (along(down.high) - above);
}

// Share of the light that a point of a triangle absorbs. `corners` have u, v and a factor of alpha.
double stopped(std::array<double, 3> weights, const std::array<const double*, 3>& corners,
               const Texture& texture) {
    const double total = weights[0] + weights[1] + weights[2];
    const double p = weights[0] / total, q = weights[1] / total, r = weights[2] / total;
    const auto mean = [&](int k) { return p * corners[0][k] + q * corners[1][k] + r * corners[2][k]; };
    const double share = std::min(std::max(mean(2) * sampled(texture, mean(0), mean(1)), 0.0), 1.0);
    if (texture.cutoff >= 0.0) return share >= texture.cutoff ? 1.0 : 0.0;
    return share;
}

void absorb(const Sums& sums, const Opaque& opaque, Array<const double, 2> points,
            Array<const double, 2> surface, Array<const std::int32_t, 2> faces, const Texture& texture,
            int call, std::tuple<double, double> at) {
    const SamplePlace sample{std::get<0>(at), std::get<1>(at)};
    const int height = sums.taken.shape[0], width = sums.taken.shape[1];
    for (int t = 0; t < faces.shape[0]; ++t) {
        const std::int32_t* face = faces.at(t);
        const auto point = [&](int k) {
            const double* of = points.at(face[k]);
            return Homogeneous{of[0], of[1], of[2]};
        };
        const std::array<Homogeneous, 3> positions{point(0), point(1), point(2)};
        const Extent inside = extent(positions, height, width, sample);
        EdgeFunctions edges;
        if (inside.empty() || !edge_functions(positions, edges)) continue;
        const std::array<const double*, 3> corners{surface.at(face[0]), surface.at(face[1]),
                                                   surface.at(face[2])};
        for (int y = inside.top; y <= inside.bottom; ++y) {
            const double row = y + sample.row;
            for (int x = inside.left; x <= inside.right; ++x) {
                if ((opaque.bits(y, x) >> opaque.number) & 1) continue;
                const double column = x + sample.column;
                const double p = edges.at(0, column, row), q = edges.at(1, column, row),
                             r = edges.at(2, column, row);
                if (p < 0.0 || q < 0.0 || r < 0.0 || !(p + q + r > 0.0)) continue;
                float& left = sums.left(y, x);
                if (sums.call(y, x) != call) {
                    sums.call(y, x) = call;
                    left = 1.0f;
                }
                if (left == 0.0f) continue;
                const float taken = static_cast<float>(stopped({p, q, r}, corners, texture)) * left;
                sums.taken(y, x) += taken;
                left -= taken;
            }
        }
    }
}

}  // namespace

void bind_shadow_transparency(nanobind::module_& module) {
    module.def("absorb", &absorb, Unlocked());
}

}  // namespace nlens

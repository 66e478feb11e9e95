// Light on the points of a block, vectorised over them.
#include "light.h"

#include <cstring>
#include <numbers>

#include "module.h"
#include "vectors.h"

namespace nlens {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
constexpr int kLevels = 4;  // of a surround, for roughnesses up to kRoughest

// What a point reflects of light from a unit direction. `by_levels`: share of what it mirrors of the light
// around that the levels give.
inline Vector reflected(const Block& block, int i, const Ray& ray, float by_levels) {
    const Vector n = get(block.normal, i), v = get(block.view, i), l = ray.toward;
    const float nl = larger(dot(n, l), 0.0f);
    const float nv = larger(std::fabs(dot(n, v)), 1e-4f);
    const Vector h = l + v;
    const float scale = 1.0f / std::sqrt(larger(dot(h, h), 1e-30f));
    const float nh = larger(dot(n, h) * scale, 0.0f);
    const float vh = smaller(larger(dot(v, h) * scale, 0.0f), 1.0f);
    const float away = 1.0f - vh;
    const float grazing = away * away * (away * away) * away;
    const float a2 = widened(block.roughness[i], block.widening[i]), rest = 1.0f - a2;
    const float spread = 1.0f - nh * nh * rest;
    const float hidden = nl * std::sqrt(nv * nv * rest + a2) + nv * std::sqrt(nl * nl * rest + a2);
    const float lobe = a2 * 0.5f / (kPi * spread * spread * hidden);
    const float f90 = block.specular[i], metallic = block.metallic[i];
    const Vector f0 = get(block.f0, i), base = get(block.base, i);
    const auto to_edge = [&](float f) { return f + (f90 - f) * grazing; };
    const Vector f{to_edge(f0.x), to_edge(f0.y), to_edge(f0.z)};
    const float plastic = 1.0f - metallic;
    const float diffuse = plastic * (1.0f - larger(f.x, larger(f.y, f.z))) * (1.0f / kPi);
    const float left = lobe * (1.0f - ray.in_levels * by_levels);
    const float shine = left * plastic, gleam = left * metallic;
    const auto channel = [&](float b, float fresnel) {
        return diffuse * b + shine * fresnel + gleam * (b + (1.0f - b) * grazing);
    };
    return {nl * ray.light.x * channel(base.x, f.x), nl * ray.light.y * channel(base.y, f.y),
            nl * ray.light.z * channel(base.z, f.z)};
}

void light_by_sun(Block& block, const float* lamp, const float* visible, const float* by_levels) {
    const Ray ray = from_sun(lamp);
    for (int i = 0; i < kPoints; ++i)
        set(block.light, i, get(block.light, i) + reflected(block, i, ray, by_levels[i]) * visible[i]);
}

void light_by_lamp(Block& block, const float* row, const float* visible, const float* by_levels) {
    float lamp[16];
    std::copy_n(row, 16, lamp);
    for (int i = 0; i < kPoints; ++i) {
        const Ray ray = from_lamp(lamp, get(block.view, i), block.distance[i]);
        set(block.light, i, get(block.light, i) + reflected(block, i, ray, by_levels[i]) * visible[i]);
    }
}

inline Vector mix(Vector a, Vector b, float share) {
    return a + (b - a) * share;
}

// What the points of a block mirror of the light around: from where, how much, the share of what they
// reflect that this is.
struct Mirrored {
    Block::Numbers share, light[3];
};

// Where on the levels of a surround to look, and shares of the texels beside, below and on the next level.
struct Place {
    int texel;
    float across, down, rougher;
};

inline Place place_of(Vector toward, float roughness, int side) {
    const float size = std::fabs(toward.x) + std::fabs(toward.y) + std::fabs(toward.z);
    const float scale = 1.0f / larger(size, 1e-30f);
    const float x = toward.x * scale, z = toward.z * scale;
    const float beyond_x = std::copysign(1.0f - std::fabs(z), x);
    const float beyond_z = std::copysign(1.0f - std::fabs(x), z);
    const float half = 0.5f * static_cast<float>(side - 2);
    const float column = ((toward.y < 0.0f ? beyond_x : x) + 1.0f) * half + 0.5f;
    const float row = ((toward.y < 0.0f ? beyond_z : z) + 1.0f) * half + 0.5f;
    const float level = larger(smaller(roughness, kRoughest), 0.0f) * ((kLevels - 1) / kRoughest);
    const int left = std::clamp(static_cast<int>(column), 0, side - 2);
    const int top = std::clamp(static_cast<int>(row), 0, side - 2);
    const int finer = std::min(static_cast<int>(level), kLevels - 2);
    return {(finer * side + top) * side + left, column - static_cast<float>(left),
            row - static_cast<float>(top), level - static_cast<float>(finer)};
}

inline Float8 mix(Float8 a, Float8 b, float share) {
    return a + (b - a) * share;
}

// Red, green and blue there, and a fourth number.
inline Float4 look_up(Array<const float, 4> levels, const Place& place) {
    const std::ptrdiff_t row = 4 * levels.shape[2], level = row * levels.shape[1];
    const float* at = levels.data + 4 * static_cast<std::ptrdiff_t>(place.texel);
    const auto pairs = [&](const float* from) {  // of texels side by side
        return mix(load<Float8>(from), load<Float8>(from + row), place.down);
    };
    const Float8 both = mix(pairs(at), pairs(at + level), place.rougher);
    const Float4 left = __builtin_shufflevector(both, both, 0, 1, 2, 3);
    const Float4 right = __builtin_shufflevector(both, both, 4, 5, 6, 7);
    return left + (right - left) * place.across;
}

inline Vector reflection(Vector n, Vector v) {
    const float nv = dot(n, v);
    return n * (nv + nv) - v;
}

// Looks up what the first `count` points mirror; places are computed for many points at once.
void find_mirrored(const Block& block, int count, Array<const float, 4> levels, Mirrored& mirrored) {
    Block::Integers texel;
    Block::Numbers across, down, rougher;
    const int side = levels.shape[1];
    for (int i = 0; i < kPoints; ++i) {
        const float roughness = widened_roughness(block.roughness[i], block.widening[i]);
        const Place place = place_of(reflection(get(block.normal, i), get(block.view, i)), roughness, side);
        texel[i] = place.texel;
        across[i] = place.across;
        down[i] = place.down;
        rougher[i] = place.rougher;
        mirrored.share[i] = share_of_levels(roughness);
    }
    for (int i = 0; i < count; ++i) {
        if (!(mirrored.share[i] > 0.0f)) continue;
        const Float4 rgb = look_up(levels, {texel[i], across[i], down[i], rougher[i]});
        set(mirrored.light, i, {rgb[0], rgb[1], rgb[2]});
    }
}

void light_from_around(Block& block, const float* rows, const Mirrored& mirrored) {
    float ambient[36];
    std::copy_n(rows, 36, ambient);
    for (int i = 0; i < kPoints; ++i) {
        const Vector n = get(block.normal, i), v = get(block.view, i);
        const float nv = dot(n, v), roughness = block.roughness[i], metallic = block.metallic[i];
        const float wide = widened_roughness(roughness, block.widening[i]);
        const Vector around = around_on(ambient, n);
        const Vector soft = mix(around_on(ambient, n * (nv + nv) - v), around, wide);
        const Vector ahead = mix(soft, get(mirrored.light, i), mirrored.share[i]);
        const RoughMirror mirror = rough_mirror(nv, roughness);
        const float edge = block.specular[i] + (1.0f - block.specular[i]) * metallic;
        const Vector base = get(block.base, i), color = mix(get(block.f0, i), base, metallic);
        const float plastic = (1.0f - metallic) * mirror.left(get(block.f0, i), block.specular[i]);
        const float part = block.occlusion[i];
        const Vector lit{around.x * base.x * plastic + ahead.x * mirror.share(color.x, edge),
                         around.y * base.y * plastic + ahead.y * mirror.share(color.y, edge),
                         around.z * base.z * plastic + ahead.z * mirror.share(color.z, edge)};
        set(block.light, i, get(block.light, i) + lit * part);
    }
}

// `light_points` on a block given as an array of its rows (n, 64), for tests.
void light_rows(Array<float, 2> rows, const Lights& lights) {
    Block block{};
    std::memcpy(&block, rows.data, sizeof(float) * kPoints * rows.shape[0]);
    light_points(block, kPoints, lights);
    std::memcpy(rows.data, &block, sizeof(float) * kPoints * rows.shape[0]);
}

}  // namespace

Vector mirrored_around(const Lights& lights, Vector toward, Vector normal, float roughness) {
    const float* ambient = lights.ambient.data;
    const Vector soft = mix(around_on(ambient, toward), around_on(ambient, normal), roughness);
    if (!lights.has_surround() || !(roughness < kRoughest)) return soft;
    const Float4 found = look_up(lights.levels, place_of(toward, roughness, lights.levels.shape[1]));
    return mix(soft, {found[0], found[1], found[2]}, share_of_levels(roughness));
}

void light_points(Block& block, int count, const Lights& lights) {
    Block::Numbers all, visible;
    std::fill_n(all, kPoints, 1.0f);
    Mirrored mirrored{};
    if (lights.has_surround()) find_mirrored(block, count, lights.levels, mirrored);
    for (int n = 0; n < lights.lamps.shape[0]; ++n) {
        const float* lamp = lights.lamps.at(n);
        const int map = map_of(lamp);
        std::copy_n(map < 0 ? all : block.visible[map], kPoints, visible);
        if (n < lights.suns) {
            light_by_sun(block, lamp, visible, mirrored.share);
        } else {
            light_by_lamp(block, lamp, visible, mirrored.share);
        }
    }
    if (lights.has_ambient()) light_from_around(block, lights.ambient.data, mirrored);
}

void bind_light(nanobind::module_& module) {
    module.attr("SURROUND_LEVELS") = kLevels;
    module.attr("SURROUND_ROUGHEST") = kRoughest;
    module.def("light_points", &light_rows, Unlocked());
}

}  // namespace nlens

// glTF 2.0 metallic-roughness shading (appendix B) under punctual and ambient light:
// `render/software/light.py`.
#pragma once

#include <algorithm>
#include <cmath>
#include <tuple>

#include "arrays.h"
#include "light_depth.h"
#include "shading_block.h"

namespace nlens {

// The light of a scene, see `deferred.Lights`.
struct Lights {
    Array<const float, 2> lamps;    // (L, 16), see `Lighting.lamp_rows`
    int suns;                       // how many of them, the first ones, have no place
    Array<const float, 2> ambient;  // (9, 4), or (0, 4) for none
    Array<const float, 4> levels;   // `Surround.levels`, (0, 0, 0, 4) where nothing mirrors them
    DepthMaps depth;                // of as many lamps as have one
    static constexpr auto fields =
        std::tuple{&Lights::lamps, &Lights::suns, &Lights::ambient, &Lights::levels, &Lights::depth};

    bool has_ambient() const { return ambient.shape[0] > 0; }
    bool has_surround() const { return levels.shape[0] > 0; }
};

// Unlike std::max and std::min, `b` if either is none, as processors have it.
inline float larger(float a, float b) {
    return a > b ? a : b;
}
inline float smaller(float a, float b) {
    return a < b ? a : b;
}

constexpr float kLeastAlpha = 0.002f;
constexpr float kRoughest = 0.6f;  // roughness of the last level of a surround, see `scene/surround.py`

// The square of alpha of a roughness, widened, see `Block::widening`.
inline float widened(float roughness, float widening) {
    const float alpha = larger(roughness * roughness, kLeastAlpha);
    return smaller(alpha * alpha + widening, 1.0f);
}

// The roughness of that alpha, as the light around is looked up by; where nothing is widened, the own one.
inline float widened_roughness(float roughness, float widening) {
    const float wider = std::sqrt(std::sqrt(widened(roughness, widening)));
    return widening > 0.0f ? wider : roughness;
}

// Light that reaches a point: the unit direction it comes from, and how much. `in_levels`: 1 where the
// levels show its lamp too, which smooth surfaces then mirror there alone.
struct Ray {
    Vector toward, light;
    float in_levels;
};

// From a lamp with a place; `lamp` is its row of numbers, `view` and `distance` those of the point.
inline Ray from_lamp(const float* lamp, Vector view, float distance) {
    const Vector way = Vector{lamp[4], lamp[5], lamp[6]} + view * distance;
    const float squared = larger(dot(way, way), 1e-30f);
    const float near = 1.0f / std::sqrt(squared);
    const float beyond = squared * lamp[7];
    const float window = smaller(larger(1.0f - beyond * beyond, 0.0f), 1.0f);
    const float facing = dot({lamp[8], lamp[9], lamp[10]}, way) * near * lamp[12] + lamp[13];
    const float spot = smaller(larger(facing, 0.0f), 1.0f);
    const float part = window * spot * spot / squared;
    // number by number: vectors copied whole would keep loops from being vectorised
    return {{way.x * near, way.y * near, way.z * near},
            {part * lamp[0], part * lamp[1], part * lamp[2]},
            lamp[3]};
}

inline Ray from_sun(const float* lamp) {
    return {{lamp[8], lamp[9], lamp[10]}, {lamp[0], lamp[1], lamp[2]}, lamp[3]};
}

// From any of the lamps, as if nothing were before it.
inline Ray lamp_at(const Block& block, int i, const Lights& lights, int number) {
    const float* lamp = lights.lamps.at(number);
    if (number < lights.suns) return from_sun(lamp);
    return from_lamp(lamp, get(block.view, i), block.distance[i]);
}

// The same, as far as it reaches the point.
inline Ray visible_lamp_at(const Block& block, int i, const Lights& lights, int number) {
    const Ray ray = lamp_at(block, i, lights, number);
    const int map = map_of(lights.lamps.at(number));
    return map < 0 ? ray : Ray{ray.toward, ray.light * block.visible[map][i], ray.in_levels};
}

// `Illumination.ambient` on a unit normal; `ambient` are its rows (9, 4).
inline Vector around_on(const float* ambient, Vector n) {
    const float xy = n.x * n.y, yz = n.y * n.z, zz = 3.0f * n.z * n.z - 1.0f, xz = n.x * n.z;
    const float xx_yy = n.x * n.x - n.y * n.y;
    const auto channel = [&](const float* a) {
        return larger(a[0] + a[4] * n.y + a[8] * n.z + a[12] * n.x + a[16] * xy + a[20] * yz + a[24] * zz +
                          a[28] * xz + a[32] * xx_yy,
                      0.0f);
    };
    return {channel(ambient), channel(ambient + 1), channel(ambient + 2)};
}

// What a rough mirror reflects of even light.
struct RoughMirror {
    float scale, bias, repeated;

    // The share, by its colour and what it reflects at grazing angles.
    float share(float color, float edge) const {
        return (color * scale + edge * bias) * (1.0f + color * repeated);
    }

    // What a dielectric mirror leaves for what lies below; alike for all colours, as under lamps.
    float left(Vector color, float edge) const {
        const float most = larger(color.x, larger(color.y, color.z));
        return larger(1.0f - share(most, edge), 0.0f);
    }
};

// Of cosine and alpha, each up to its square.
inline float biquadratic(const float (&c)[9], float x, float y) {
    const float still = c[0] + y * (c[1] + y * c[2]), once = c[3] + y * (c[4] + y * c[5]);
    return still + x * (once + x * (c[6] + y * (c[7] + y * c[8])));
}

// The integral of the lobe that `reflected` has, with Schlick's edge: a fit of quotients of two polynomials
// by `models/reflectance/fit.py`, within 5 % of what a surface of F0 0.02 to 1 reflects.
inline RoughMirror rough_mirror(float nv, float roughness) {
    constexpr float kScale[] = {0.03316f,  8.70555f, -6.2036f, 2.42758f,  -16.24609f,
                                19.20866f, 9.5918f,  2.49477f, -12.18657f};
    constexpr float kScaleDivisor[] = {1.0f,      6.76272f,  -4.8963f,   -0.08257f, -1.65557f,
                                       13.42527f, 11.08393f, -11.41159f, 11.4047f};
    constexpr float kBias[] = {0.92646f,  0.12232f, 0.18276f,  -2.19505f, 0.88655f,
                               -1.37967f, 1.28238f, -1.09258f, 1.28171f};
    constexpr float kBiasDivisor[] = {1.0f,       13.85686f, 11.31672f, -0.09151f,  -48.11424f,
                                      221.28821f, 15.29834f, 35.43781f, -179.87302f};
    const float cosine = smaller(larger(nv, 0.0f), 1.0f), alpha = roughness * roughness;
    const float scale = biquadratic(kScale, cosine, alpha) / biquadratic(kScaleDivisor, cosine, alpha);
    const float bias =
        larger(biquadratic(kBias, cosine, alpha) / biquadratic(kBiasDivisor, cosine, alpha), 0.0f);
    return {scale, bias, 1.0f / (scale + bias) - 1.0f};
}

// The share of what a surface mirrors of the light around that the levels give.
inline float share_of_levels(float roughness) {
    constexpr float kSoft = 0.4f;  // up to here the levels are taken alone; at the last one, none of them
    return smaller(larger((kRoughest - roughness) * (1.0f / (kRoughest - kSoft)), 0.0f), 1.0f);
}

// Light from around that a surface mirrors from a direction, by harmonics where it is rough.
Vector mirrored_around(const Lights& lights, Vector toward, Vector normal, float roughness);

// Adds the light that the first `count` points of a block reflect towards the eye to theirs.
void light_points(Block& block, int count, const Lights& lights);

}  // namespace nlens

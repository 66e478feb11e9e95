// Radiance of materials with clear coat, sheen, anisotropy or transmission, point by point.
//
// The formulas of the OpenGL shader (`render/opengl/shaders/object.frag`), which are those of
// KHR_materials_clearcoat, _sheen, _anisotropy and _transmission; defined by `reference_kernels.layered`
// and `passed`.
#include "layers.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include "module.h"

namespace nlens {
namespace {

constexpr float kPi = std::numbers::pi_v<float>;
constexpr float kLeast = 1e-30f, kLeastNv = 1e-4f;
constexpr float kCoatF0 = 0.04f;
constexpr float kLeastSheen = 0.07f, kFitted = 0.1f, kLeastFrost = 0.2f;
constexpr float kRed = 0.2126f, kGreen = 0.7152f, kBlue = 0.0722f;  // shares of luminance

Vector unit(Vector v) {
    return v * (1.0f / std::sqrt(std::max(dot(v, v), kLeast)));
}
Vector mirror(Vector n, Vector v) {
    return n * (2.0f * dot(n, v)) - v;
}
float fifth(float x) {
    return x * x * (x * x) * x;
}
float square(float x) {
    return x * x;
}
float largest(Vector v) {
    return std::max(v.x, std::max(v.y, v.z));
}
float within_one(float x) {
    return std::min(std::max(x, 0.0f), 1.0f);
}
float mix(float low, float high, float share) {
    return low + (high - low) * share;
}

// Of half vector, light and eye: their cosines to the normal; or to another direction.
struct Cosines {
    float half, light, eye;
};

Cosines cosines_of(Vector n, Vector half, Vector light, Vector eye) {
    return {std::max(dot(n, half), 0.0f), dot(n, light), std::max(std::fabs(dot(n, eye)), kLeastNv)};
}

// `a2` is the square of alpha.
float glossy(Cosines n, float a2) {
    const float spread = n.half * n.half * (a2 - 1.0f) + 1.0f;
    const float hidden = n.light * std::sqrt(n.eye * n.eye * (1.0f - a2) + a2) +
                         n.eye * std::sqrt(n.light * n.light * (1.0f - a2) + a2);
    return a2 * 0.5f / (kPi * spread * spread * hidden);
}

// Where highlights are stretched to and the direction across it, with the alpha of either.
struct Stretch {
    Vector along, beside;
    float wide, narrow;
};

// What facets do not hide from each other, by the product of the cosines to light and eye.
float unhidden(const Stretch& stretch, Cosines n, Vector light, Vector eye) {
    const auto reach = [&](Vector to, float cosine) {
        return std::sqrt(square(stretch.wide * dot(stretch.along, to)) +
                         square(stretch.narrow * dot(stretch.beside, to)) + square(cosine));
    };
    return std::min(0.5f / (n.light * reach(eye, n.eye) + n.eye * reach(light, n.light)), 1.0f);
}

float stretched(const Stretch& stretch, Cosines n, Vector half, Vector light, Vector eye) {
    const float a2 = stretch.wide * stretch.narrow;
    const float across = square(stretch.narrow * dot(stretch.along, half));
    const float w2 = a2 / (across + square(stretch.wide * dot(stretch.beside, half)) + square(a2 * n.half));
    return a2 * w2 * w2 / kPi * unhidden(stretch, n, light, eye);
}

float fibre_fit(float x, float alpha) {
    const float s = square(1.0f - alpha);
    const float a = mix(21.5473f, 25.3245f, s), b = mix(3.82987f, 3.32435f, s);
    const float c = mix(0.19823f, 0.16801f, s), d = mix(-1.97760f, -1.27393f, s);
    return a / (1.0f + b * std::pow(x, c)) + d * x + mix(-4.32054f, -4.85967f, s);
}

float fibre_shadow(float x, float alpha) {
    if (x < 0.5f) return std::exp(fibre_fit(x, alpha));
    return std::exp(2.0f * fibre_fit(0.5f, alpha) - fibre_fit(1.0f - x, alpha));
}

float fibres(Cosines n, float roughness) {
    const float alpha = roughness * roughness;
    const float half = std::min(n.half, 1.0f), light = std::min(n.light, 1.0f), eye = std::min(n.eye, 1.0f);
    const float lobe =
        (2.0f + 1.0f / alpha) * std::pow(std::max(1.0f - half * half, 0.0f), 0.5f / alpha) / (2.0f * kPi);
    const float shadows = 1.0f + fibre_shadow(eye, alpha) + fibre_shadow(light, alpha);
    return lobe * std::min(1.0f / (shadows * 4.0f * eye * light), 1.0f);
}

// Share of even light that white fibres return.
float fibre_share(float nv, float roughness) {
    const float r = std::max(roughness, kFitted);
    const float a = 0.1022f / r - 0.6472f + 0.3144f * r;
    const float b = -0.6898f / r - 1.8652f + 1.1422f * r;
    const float c = -1.5261f / r + 4.2535f - 2.9285f * r;
    return std::min(std::exp(a + (b + c * nv) * nv), 1.0f);
}

// What a point is made of.
struct Surface {
    Vector normal, view, base, f0;
    float metallic, roughness, specular, occlusion;
    float widening;
    float anisotropy;
    Vector along, beside;  // of any length
    float coat, coat_roughness;
    Vector coat_normal;
    Vector sheen;
    float sheen_roughness;
    float through;
    Vector volume, glow;

    Surface(const Block& block, int i)
        : normal(get(block.normal, i)),
          view(get(block.view, i)),
          base(get(block.base, i)),
          f0(get(block.f0, i)),
          metallic(block.metallic[i]),
          roughness(block.roughness[i]),
          specular(block.specular[i]),
          occlusion(block.occlusion[i]),
          widening(block.widening[i]),
          anisotropy(block.anisotropy[i]),
          along(get(block.along, i)),
          beside(get(block.beside, i)),
          coat(block.coat[i]),
          coat_roughness(block.coat_roughness[i]),
          coat_normal(unit(get(block.coat_normal, i))),
          sheen(get(block.sheen, i)),
          sheen_roughness(block.sheen_roughness[i]),
          through(block.through[i]),
          volume(get(block.volume, i)),
          glow(get(block.glow, i)) {}

    bool is_stretched() const { return anisotropy > 0.0f && dot(along, along) > 0.0f; }
    bool has_sheen() const { return largest(sheen) > 0.0f; }
    bool has_coat() const { return coat > 0.0f; }

    // Share of light that dielectric facets let in, from F0 towards grazing angles.
    float let_in(float grazing) const {
        const float strongest = largest(f0);
        return 1.0f - (strongest + (specular - strongest) * grazing);
    }
};

// Light that each layer of a point reflects: base, sheen and coat apart.
struct Layers {
    Vector base{}, sheen{}, coat{};
};

// Share of what a layer mirrors of a lamp that its highlight has.
float of_highlight(const Ray& ray, float roughness, float widening) {
    if (!(ray.in_levels > 0.0f)) return 1.0f;
    return 1.0f - ray.in_levels * share_of_levels(widened_roughness(roughness, widening));
}

Stretch stretch_of(const Surface& surface) {
    const float alpha = std::max(square(surface.roughness), kLeastAlpha);
    const float wide = alpha + (1.0f - alpha) * square(surface.anisotropy);
    return {unit(surface.along), unit(surface.beside),
            std::sqrt(std::min(wide * wide + surface.widening, 1.0f)),
            std::sqrt(widened(surface.roughness, surface.widening))};
}

// Microfacets of the base.
float base_lobe(const Surface& surface, Cosines cosines, Vector half, Vector light) {
    if (!surface.is_stretched()) return glossy(cosines, widened(surface.roughness, surface.widening));
    return stretched(stretch_of(surface), cosines, half, light, surface.view);
}

constexpr int kFacets = 16;

// Light from around that a stretched lobe mirrors: the mean over facets that are tilted along the stretch,
// as often as their slopes are, each with a lobe that reaches the next one's.
Vector mirrored_along(const Lights& lights, const Surface& surface) {
    const Stretch stretch = stretch_of(surface);
    const float most = std::sqrt(std::max(square(stretch.wide) - square(stretch.narrow), 0.0f));
    const float roughness = std::sqrt(std::max(stretch.narrow, most / kFacets));
    Vector sum{};
    float weights = kLeast;
    for (int k = 0; k < kFacets; ++k) {
        const float share = static_cast<float>(2 * k + 1) / kFacets - 1.0f;
        const float slope = most * share / std::sqrt(1.0f - share * share);
        const Vector half = unit(surface.normal + stretch.along * slope);
        const Vector light = mirror(half, surface.view);
        const Cosines n = cosines_of(surface.normal, half, light, surface.view);
        const float to_eye = dot(half, surface.view);
        if (!(n.light > 0.0f) || !(to_eye > 0.0f)) continue;
        const float weight = unhidden(stretch, n, light, surface.view) * n.light * to_eye / n.half;
        sum = sum + mirrored_around(lights, light, surface.normal, roughness) * weight;
        weights += weight;
    }
    return sum * (1.0f / weights);
}

void add_lamp(Layers& layers, const Surface& surface, const Ray& ray) {
    const Vector half = unit(ray.toward + surface.view);
    const Cosines n = cosines_of(surface.normal, half, ray.toward, surface.view);
    if (n.light > 0.0f) {
        const float lobe =
            base_lobe(surface, n, half, ray.toward) * of_highlight(ray, surface.roughness, surface.widening);
        const float grazing = fifth(1.0f - within_one(dot(surface.view, half)));
        const float scattered = surface.let_in(grazing) * (1.0f - surface.through);
        const auto reflected = [&](float base, float f0) {
            const float plastic = scattered * base / kPi + lobe * (f0 + (surface.specular - f0) * grazing);
            const float metal = lobe * (base + (1.0f - base) * grazing);
            return n.light * (plastic + (metal - plastic) * surface.metallic);
        };
        const auto [base, f0] = std::pair{surface.base, surface.f0};
        layers.base =
            layers.base + Vector{ray.light.x * reflected(base.x, f0.x), ray.light.y * reflected(base.y, f0.y),
                                 ray.light.z * reflected(base.z, f0.z)};
        if (surface.has_sheen()) {
            const float roughness = std::min(std::max(surface.sheen_roughness, kLeastSheen), 1.0f);
            layers.sheen = layers.sheen + ray.light * (n.light * fibres(n, roughness));
        }
    }
    if (!surface.has_coat()) return;
    const Cosines coat = cosines_of(surface.coat_normal, half, ray.toward, surface.view);
    if (!(coat.light > 0.0f)) return;
    const float a2 = widened(surface.coat_roughness, surface.widening);
    const float share = of_highlight(ray, surface.coat_roughness, surface.widening);
    layers.coat = layers.coat + ray.light * (coat.light * glossy(coat, a2) * share);
}

// Adds what a point reflects of the light from around, likewise.
void add_surround(Layers& layers, const Surface& surface, const Lights& lights) {
    const Vector n = surface.normal, v = surface.view;
    const float facing = dot(n, v), metallic = surface.metallic;
    const float edge = surface.specular + (1.0f - surface.specular) * metallic;
    const float wide = widened_roughness(surface.roughness, surface.widening);
    const Vector ahead = surface.is_stretched() ? mirrored_along(lights, surface)
                                                : mirrored_around(lights, mirror(n, v), n, wide);
    const Vector around = around_on(lights.ambient.data, n);
    const RoughMirror rough = rough_mirror(facing, surface.roughness);
    const float left = rough.left(surface.f0, surface.specular);
    const float scattered = (1.0f - metallic) * (1.0f - surface.through) * left;
    const auto part = [&](float light, float mirrored, float base, float f0) {
        return light * base * scattered + mirrored * rough.share(f0 + (base - f0) * metallic, edge);
    };
    const Vector base = surface.base, f0 = surface.f0;
    const Vector lit{part(around.x, ahead.x, base.x, f0.x), part(around.y, ahead.y, base.y, f0.y),
                     part(around.z, ahead.z, base.z, f0.z)};
    layers.base = layers.base + lit * surface.occlusion;
    if (surface.has_sheen()) {
        const float fuzz = fibre_share(std::min(std::fabs(facing), 1.0f), surface.sheen_roughness);
        layers.sheen = layers.sheen + around * (surface.occlusion * fuzz);
    }
    if (surface.has_coat()) {
        const Vector coat = surface.coat_normal;
        const float spread = widened_roughness(surface.coat_roughness, surface.widening);
        const Vector gloss = mirrored_around(lights, mirror(coat, v), coat, spread);
        layers.coat = layers.coat + gloss * surface.occlusion;
    }
}

// Sheen laid over the base and the coat over all.
struct Covered {
    Vector light;
    float left;  // share of what is below
};

Covered lay_over(const Layers& layers, const Surface& surface) {
    const float nv = std::min(std::fabs(dot(surface.normal, surface.view)), 1.0f);
    float kept = 1.0f;
    if (surface.has_sheen()) kept -= largest(surface.sheen) * fibre_share(nv, surface.sheen_roughness);
    const float coat_nv = std::min(std::fabs(dot(surface.coat_normal, surface.view)), 1.0f);
    const float coat = surface.coat * (kCoatF0 + (1.0f - kCoatF0) * fifth(1.0f - coat_nv));
    const auto over = [&](float base, float tint, float sheen, float glow, float shine) {
        const float under = kept * base + tint * sheen + glow;
        return under + (shine - under) * coat;
    };
    const auto& [base, sheen, shine] = layers;
    const Vector tint = surface.sheen, glow = surface.glow;
    return {{over(base.x, tint.x, sheen.x, glow.x, shine.x), over(base.y, tint.y, sheen.y, glow.y, shine.y),
             over(base.z, tint.z, sheen.z, glow.z, shine.z)},
            kept * (1.0f - coat)};
}

// Light from behind that is let through.
struct Through {
    Vector light;
    float hidden;  // share of what is behind that is not seen
};

// `under` is the share that further layers leave. What hides the things behind is alike for all colours. In
// which colours light differs from that, and what roughness scatters, is taken from the light around, as
// blurred.
Through see_through(const Surface& surface, float under, float bending, const Lights& lights) {
    const float nv = std::min(std::fabs(dot(surface.normal, surface.view)), 1.0f);
    const float kept =
        surface.let_in(fifth(1.0f - nv)) * (surface.through * (1.0f - surface.metallic) * under);
    const float red = kept * surface.base.x * std::exp(-surface.volume.x);
    const float green = kept * surface.base.y * std::exp(-surface.volume.y);
    const float blue = kept * surface.base.z * std::exp(-surface.volume.z);
    const float frosted = std::min(surface.roughness * bending, 1.0f);
    const float shown = std::min(kRed * red + kGreen * green + kBlue * blue, 1.0f) * (1.0f - frosted);
    Vector light{};
    if (lights.has_ambient()) {
        const Vector behind = surface.view * -1.0f;
        light = mirrored_around(lights, behind, behind, std::max(frosted, kLeastFrost));
        light = {(red - shown) * light.x, (green - shown) * light.y, (blue - shown) * light.z};
    }
    return {light, 1.0f - shown};
}

void light_point(Block& block, int i, float bending, const Lights& lights) {
    const Surface surface(block, i);
    Layers layers;
    for (int number = 0; number < lights.lamps.shape[0]; ++number) {
        add_lamp(layers, surface, visible_lamp_at(block, i, lights, number));
    }
    if (lights.has_ambient()) add_surround(layers, surface, lights);
    Covered covered = lay_over(layers, surface);
    if (surface.through > 0.0f) {
        const Through through = see_through(surface, covered.left, bending, lights);
        covered.light = covered.light + through.light;
        block.hidden[i] = through.hidden;
    }
    set(block.light, i, covered.light);
}

// `light_layers` on the points of a block given as its rows of floats, all of the first material.
void light_layers_of_rows(Array<float, 2> rows, const Paint& paint, const Lights& lights) {
    Block block{};
    const auto size = sizeof(float) * kPoints * rows.shape[0];
    std::memcpy(&block, rows.data, size);
    light_layers(block, kPoints, paint, lights);
    std::memcpy(rows.data, &block, size);
}

}  // namespace

void light_layers(Block& block, int count, const Paint& paint, const Lights& lights) {
    for (Run run{0, 0}; run.last < count;) {
        run = same_material(block, run.last, count);
        const int m = block.material[run.first];
        if (!(paint.flags(m) & kLayered)) continue;
        for (int i = run.first; i < run.last; ++i) light_point(block, i, paint.numbers(m, kBending), lights);
    }
}

void bind_layers(nanobind::module_& module) {
    module.def("light_layers", &light_layers_of_rows, Unlocked());
}

}  // namespace nlens

// Base colour, alpha, normal, reflectance and emission at surface points, vectorised over runs of points
// of one material.
#include "materials.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "module.h"

namespace nlens {
namespace {

using Numbers = Block::Numbers;

// A material's textures, in the order of `shader_inputs.SLOTS`.
enum Slot {
    kColorMap,
    kMetalMap,
    kNormalMap,
    kOcclusionMap,
    kEmissionMap,
    kSpecularMap,
    kSpecularColorMap,
    kCoatMap,
    kCoatRoughnessMap,
    kCoatNormalMap,
    kSheenColorMap,
    kSheenRoughnessMap,
    kStretchMap,
    kTransmissionMap,
    kThicknessMap,
};

// One material of the scene.
struct Material {
    const Paint& paint;
    int number;

    const float* numbers() const { return paint.numbers.at(number); }
    // How a texture is used: (a, b, c, uv set, d, e, f, strength).
    const float* use(Slot slot) const { return numbers() + kTextureUses + 8 * slot; }
    float strength(Slot slot) const { return use(slot)[7]; }
    int map(Slot slot) const { return paint.maps(number, slot); }
    bool is(int flag) const { return (paint.flags(number) & flag) != 0; }
};

void fill(Numbers& field, Run run, float value) {
    std::fill(field + run.first, field + run.last, value);
}

void scale(Numbers& field, Run run, float factor) {
    for (int i = run.first; i < run.last; ++i) field[i] *= factor;
}

// Multiplies a field by another one and a number.
void multiply(Numbers& field, const Numbers& other, Run run, float factor = 1.0f) {
    float* __restrict to = field;
    for (int i = run.first; i < run.last; ++i) to[i] *= factor * other[i];
}

template <int N>
void multiply(Numbers (&fields)[N], const Numbers* others, Run run) {
    for (int k = 0; k < N; ++k) multiply(fields[k], others[k], run);
}

// Keeps a field within [0, 1].
void clip(Numbers& field, Run run) {
    for (int i = run.first; i < run.last; ++i) {
        const float value = field[i] > 0.0f ? field[i] : 0.0f;
        field[i] = value < 1.0f ? value : 1.0f;
    }
}

// Fills in the texels of a material's texture; whether it has one.
bool sampled(Block& block, Run run, const Material& material, Slot slot) {
    const int map = material.map(slot);
    if (map < 0) return false;
    const float* use = material.use(slot);
    const int first = use[3] < 0.5f ? 0 : 2;
    for (int k = 0; k < 3; ++k) {
        const float left = k == 0 ? use[2] : 0.0f, up = k == 0 ? use[6] : 0.0f;
        const float *us = block.coordinates[k][first], *vs = block.coordinates[k][first + 1];
        float *to_u = block.uv[k][0], *to_v = block.uv[k][1];
        for (int i = run.first; i < run.last; ++i) {
            const float u = us[i], v = vs[i];
            to_u[i] = use[0] * u + use[1] * v + left;
            to_v[i] = use[4] * u + use[5] * v + up;
        }
    }
    sample_texture(block, run, material.paint.atlas, map);
    return true;
}

// Dielectric reflectance by textures of its weight and its colour.
void texture_specular(Block& block, Run run, const Material& material) {
    if (sampled(block, run, material, kSpecularMap)) multiply(block.specular, block.texel[3], run);
    if (sampled(block, run, material, kSpecularColorMap)) multiply(block.f0, block.texel, run);
    for (Numbers& f0 : block.f0) {
        for (int i = run.first; i < run.last; ++i) f0[i] = (f0[i] < 1.0f ? f0[i] : 1.0f) * block.specular[i];
    }
}

// How a run of points reflects and glows.
void find_reflectance(Block& block, Run run, const Material& material) {
    const float* numbers = material.numbers();
    fill(block.metallic, run, numbers[kMetallic]);
    fill(block.roughness, run, numbers[kRoughness]);
    fill(block.specular, run, numbers[kSpecular]);
    fill(block.occlusion, run, 1.0f);
    for (int k = 0; k < 3; ++k) {
        fill(block.light[k], run, numbers[kEmission + k]);
        fill(block.f0[k], run, numbers[kReflectance + k]);
    }
    if (sampled(block, run, material, kMetalMap)) {
        multiply(block.metallic, block.texel[2], run);
        multiply(block.roughness, block.texel[1], run);
    }
    if (sampled(block, run, material, kOcclusionMap)) {
        const float strength = material.strength(kOcclusionMap);
        for (int i = run.first; i < run.last; ++i)
            block.occlusion[i] = 1.0f + strength * (block.texel[0][i] - 1.0f);
    }
    if (sampled(block, run, material, kEmissionMap)) multiply(block.light, block.texel, run);
    clip(block.metallic, run);
    clip(block.roughness, run);
    if (material.map(kSpecularMap) >= 0 || material.map(kSpecularColorMap) >= 0)
        texture_specular(block, run, material);
}

// Unlit points: their base colour is their radiance, and they reflect nothing.
void emit(Block& block, Run run) {
    for (int k = 0; k < 3; ++k) {
        std::copy(block.base[k] + run.first, block.base[k] + run.last, block.light[k] + run.first);
        fill(block.base[k], run, 0.0f);
        fill(block.f0[k], run, 0.0f);
    }
    fill(block.specular, run, 0.0f);
    fill(block.metallic, run, 0.0f);
}

// Normals of the clear coat, which the base's normal map does not tilt.
void find_coat_normals(Block& block, Run run, const Mesh& mesh, const Material& material) {
    for (int k = 0; k < 3; ++k)
        std::copy(block.normal[k] + run.first, block.normal[k] + run.last, block.coat_normal[k] + run.first);
    if (!sampled(block, run, material, kCoatNormalMap)) return;
    apply_normal_map(block, run, mesh, material.strength(kCoatNormalMap));
    for (int k = 0; k < 3; ++k)
        std::swap_ranges(block.normal[k] + run.first, block.normal[k] + run.last,
                         block.coat_normal[k] + run.first);
}

// Anisotropy and its direction, before normals are tilted.
void find_stretch(Block& block, Run run, const Mesh& mesh, const Material& material) {
    const float* numbers = material.numbers();
    const float x = std::cos(numbers[kStretchTurn]), y = std::sin(numbers[kStretchTurn]);
    fill(block.anisotropy, run, numbers[kStretch]);
    fill(block.along[0], run, x);
    fill(block.along[1], run, y);
    if (!(numbers[kStretch] > 0.0f)) return;
    if (sampled(block, run, material, kStretchMap)) {
        multiply(block.anisotropy, block.texel[2], run);
        for (int i = run.first; i < run.last; ++i) {
            const float u = block.texel[0][i] + block.texel[0][i] - 1.0f;
            const float v = block.texel[1][i] + block.texel[1][i] - 1.0f;
            const float scale = 1.0f / std::sqrt(std::max(u * u + v * v, 1e-12f));
            block.along[0][i] = (x * u - y * v) * scale;
            block.along[1][i] = (y * u + x * v) * scale;
        }
    }
    const int first = numbers[kTangentPair] < 0.5f ? 0 : 2;
    for (int k = 1; k < 3; ++k) {
        for (int axis = 0; axis < 2; ++axis) {
            const Numbers& change = block.coordinates[k][first + axis];
            std::copy(change + run.first, change + run.last, block.uv[k][axis] + run.first);
        }
    }
    find_directions(block, run, mesh);
}

// Emission kept apart, clear coat and sheen of a run.
void find_cover(Block& block, Run run, const Material& material) {
    const float* numbers = material.numbers();
    fill(block.coat, run, numbers[kCoat]);
    fill(block.coat_roughness, run, numbers[kCoatRoughness]);
    fill(block.sheen_roughness, run, numbers[kSheenRoughness]);
    for (int k = 0; k < 3; ++k) {
        fill(block.sheen[k], run, numbers[kSheen + k]);
        std::copy(block.light[k] + run.first, block.light[k] + run.last, block.glow[k] + run.first);
    }
    if (sampled(block, run, material, kCoatMap)) multiply(block.coat, block.texel[0], run);
    if (sampled(block, run, material, kCoatRoughnessMap)) multiply(block.coat_roughness, block.texel[1], run);
    if (sampled(block, run, material, kSheenColorMap)) multiply(block.sheen, block.texel, run);
    if (sampled(block, run, material, kSheenRoughnessMap))
        multiply(block.sheen_roughness, block.texel[3], run);
}

// Transmission and volume of a run.
void find_transmission(Block& block, Run run, const Material& material) {
    fill(block.through, run, material.numbers()[kTransmission]);
    if (sampled(block, run, material, kTransmissionMap)) multiply(block.through, block.texel[0], run);
    for (int k = 0; k < 3; ++k) fill(block.volume[k], run, material.numbers()[kAbsorption + k]);
    if (sampled(block, run, material, kThicknessMap)) {
        for (Numbers& volume : block.volume) multiply(volume, block.texel[1], run);
    }
}

// Alpha as the material uses it.
void finish_alpha(Block& block, Run run, const Material& material) {
    if (material.is(kOpaque)) fill(block.alpha, run, 1.0f);
    if (material.is(kCut)) {
        const float cutoff = material.numbers()[kCutoff];
        for (int i = run.first; i < run.last; ++i) block.alpha[i] = block.alpha[i] >= cutoff ? 1.0f : 0.0f;
    }
    clip(block.alpha, run);
}

void color(Block& block, Run run, const Material& material) {
    const float* factors = material.numbers() + kBaseColor;
    const bool textured = sampled(block, run, material, kColorMap);
    for (int k = 0; k < 4; ++k) {
        Numbers& field = k < 3 ? block.base[k] : block.alpha;
        if (textured) {
            multiply(field, block.texel[k], run, factors[k]);
        } else {
            scale(field, run, factors[k]);
        }
    }
}

}  // namespace

void base_colors(Block& block, Run run, const Paint& paint) {
    color(block, run, {paint, block.material[run.first]});
}

bool evaluate_materials(Block& block, int count, const Mesh& mesh, const Paint& paint,
                        Array<const float, 1> lens) {
    interpolate(block, count, mesh);
    bool layers = false;
    for (Run run{0, 0}; run.last < count;) {
        run = same_material(block, run.last, count);
        const Material material{paint, block.material[run.first]};
        color(block, run, material);
        finish_alpha(block, run, material);
        if (material.is(kUnlit)) {
            emit(block, run);
            continue;
        }
        const bool layered = material.is(kLayered);
        if (layered) {
            find_coat_normals(block, run, mesh, material);
            find_stretch(block, run, mesh, material);
        }
        if (sampled(block, run, material, kNormalMap))
            apply_normal_map(block, run, mesh, material.strength(kNormalMap));
        find_reflectance(block, run, material);
        if (layered) {
            find_cover(block, run, material);
            find_transmission(block, run, material);
        }
        layers |= layered;
    }
    view_vectors(block, lens);
    return layers;
}

void bind_materials(nanobind::module_& module) {
    module.attr("UNLIT") = kUnlit;
    module.attr("OPAQUE") = kOpaque;
    module.attr("LAYERED") = kLayered;
    module.attr("CUT") = kCut;
}

}  // namespace nlens

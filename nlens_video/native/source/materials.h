// Materials at surface points: `render/software/material_eval.py`.
#pragma once

#include <cstdint>
#include <tuple>

#include "arrays.h"
#include "interpolation.h"
#include "shading_block.h"
#include "textures.h"

namespace nlens {

// Flags of a material.
constexpr int kUnlit = 1, kOpaque = 2, kLayered = 4, kCut = 8;
// Where its numbers lie in a row, see `shader_inputs.material_params`.
constexpr int kBaseColor = 0, kMetallic = 4, kRoughness = 5, kSpecular = 6, kCutoff = 7, kEmission = 8,
              kTransmission = 11, kReflectance = 12, kStretchTurn = 15, kCoat = 16, kCoatRoughness = 17,
              kStretch = 18, kSheenRoughness = 19, kSheen = 20, kTangentPair = 23, kAbsorption = 24,
              kBending = 27, kTextureUses = 28;

// The scene's materials.
struct Paint {
    Array<const float, 2> numbers;       // (M, MATERIAL_FLOATS)
    Array<const std::int32_t, 2> maps;   // textures (M, slots), -1 for none
    Array<const std::int32_t, 1> flags;  // (M,)
    Atlas atlas;
    static constexpr auto fields = std::tuple{&Paint::numbers, &Paint::maps, &Paint::flags, &Paint::atlas};
};

// The run of points from `first` on that are of one material.
inline Run same_material(const Block& block, int first, int count) {
    int last = first + 1;
    while (last < count && block.material[last] == block.material[first]) ++last;
    return {first, last};
}

// Makes vertex colours of a run the linear base colours and alphas, which is not clipped.
void base_colors(Block& block, Run run, const Paint& paint);

// Evaluates materials at the first `count` points of a block; whether any has layers. `lens` is as for
// `view_vectors`.
bool evaluate_materials(Block& block, int count, const Mesh& mesh, const Paint& paint,
                        Array<const float, 1> lens);

}  // namespace nlens

// Radiance of the points of a block: `render/software/deferred.py`.
#pragma once

#include <tuple>

#include "arrays.h"
#include "interpolation.h"
#include "light.h"
#include "materials.h"
#include "shading_block.h"

namespace nlens {

// What to shade with, see `deferred.ShadingInputs`.
struct ShadingInputs {
    Mesh mesh;
    Paint paint;
    Array<const float, 1> lens;  // as for `view_vectors`
    Lights lights;
    static constexpr auto fields =
        std::tuple{&ShadingInputs::mesh, &ShadingInputs::paint, &ShadingInputs::lens, &ShadingInputs::lights};
};

// As much as the OpenGL backend's half floats hold: nothing overflows in the blur.
constexpr float kBrightest = 60000.0f;

// Computes the radiance of the first `count` points of a block.
void shade(Block& block, int count, const ShadingInputs& scene);

}  // namespace nlens

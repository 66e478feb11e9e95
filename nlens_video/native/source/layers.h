// Clear coat, sheen, anisotropy, transmission: `render/software/layers.py`.
#pragma once

#include "light.h"
#include "materials.h"
#include "shading_block.h"

namespace nlens {

// Replaces the radiance of those of the first `count` points whose materials have layers.
void light_layers(Block& block, int count, const Paint& paint, const Lights& lights);

}  // namespace nlens

// Textures: mipmaps of all in one atlas, see `render/software/textures.py`.
#pragma once

#include <cstdint>
#include <tuple>

#include "arrays.h"
#include "shading_block.h"

namespace nlens {

struct Atlas {
    Array<const std::uint16_t, 1> texels;
    Array<const std::int64_t, 2> levels, table;
    static constexpr auto fields = std::tuple{&Atlas::texels, &Atlas::levels, &Atlas::table};
};

// Fill in `texel`, a texture's colours, linear RGBA, at a run of points; `uv` is read.
void sample_texture(Block& block, Run run, const Atlas& atlas, int texture);

}  // namespace nlens

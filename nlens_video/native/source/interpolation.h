// Perspective-correct interpolation of vertex attributes, with exact screen-space derivatives.
//
// Barycentric weights and their derivatives follow in closed form from the triangle's planes
// (`triangles.h`), so no pixel quads are needed. Corners are read point by point, four numbers at a
// time; all that needs no corners is vectorised over points.
#pragma once

#include <cstdint>
#include <tuple>

#include "arrays.h"
#include "shading_block.h"

namespace nlens {

struct Mesh {
    Array<const float, 2> positions;        // (V, 3)
    Array<const float, 2> normals;          // (V, 4), the last number of any content
    Array<const float, 2> uv;               // (V, 4), two pairs of texture coordinates
    Array<const float, 2> colors;           // (V, 4), or (0, 4) where all are white
    Array<const std::int32_t, 2> faces;     // (F, 3)
    Array<const std::int32_t, 1> material;  // (F,)
    Array<const float, 2> planes;           // (F, kPlanes)
    static constexpr auto fields = std::tuple{&Mesh::positions, &Mesh::normals,  &Mesh::uv,    &Mesh::colors,
                                              &Mesh::faces,     &Mesh::material, &Mesh::planes};
};

// Interpolates vertex attributes at the first `count` points: depth, normals of any length and how they
// vary, vertex colours as base colour, texture coordinates and their change, and which material it is.
void interpolate(Block& block, int count, const Mesh& mesh);

// Tilts the normals of a run by its normal map; their frame comes from derivatives of `uv`.
void apply_normal_map(Block& block, Run run, const Mesh& mesh, float strength);

// Turns directions `along` in the plane of texture coordinates, x and y, into the world's. They are 0
// where the coordinates do not change. `beside` lies across them on the surface.
void find_directions(Block& block, Run run, const Mesh& mesh);

// Unit normals, directions to the eye and distances of all points; `lens` (13,) has the
// camera's axes (right, up, back), fx, fy, cx, cy.
void view_vectors(Block& block, Array<const float, 1> lens);

}  // namespace nlens

// A block of surface points shaded together, and what they are shaded with.
#pragma once

#include <cmath>
#include <cstdint>

#include "arrays.h"

namespace nlens {

constexpr int kPoints = 64;    // of a block
constexpr int kDepthMaps = 4;  // of lamps, at most

// Rows of one number of each point, so that loops over points vectorise.
struct Block {
    using Numbers = float[kPoints];
    using Integers = std::int32_t[kPoints];

    // Where in the picture: column and row [px], and the share of the pixel that the point stands for.
    Numbers x, y, weight;
    // Unit vectors in the world: of the surface, facing the eye, and towards the eye.
    Numbers normal[3], view[3];
    Numbers distance;  // from the eye [scene unit]
    // The material there; linear light.
    Numbers base[3], alpha;
    Numbers metallic, roughness, specular;
    Numbers f0[3];
    Numbers occlusion;
    Numbers light[3];  // radiance towards the eye: emission at first, then all of it
    Numbers depth;     // along the optical axis [scene unit]
    // The mesh's texture coordinates: two pairs, then their change by a column and by a row.
    Numbers coordinates[3][4];
    // What samples a texture: coordinates in its picture and their change by a column and by a row; what
    // was found.
    Numbers uv[3][2];
    Numbers texel[4];
    // Layers of materials that have some: emission; weight, roughness and normal (of any length) of the
    // clear coat; colour and roughness of the sheen; anisotropy, its direction on the surface and the
    // one across it (of any length).
    Numbers glow[3];
    Numbers coat, coat_roughness, coat_normal[3];
    Numbers sheen[3], sheen_roughness;
    Numbers anisotropy, along[3], beside[3];
    // Share of light that goes through, optical depth of the volume; what hides the things behind.
    Numbers through, volume[3], hidden;

    // How much the normal varies within the pixel, as what it adds to the square of alpha.
    Numbers widening;
    // Share of the light of lamps with a depth map that reaches the point, map by map.
    Numbers visible[kDepthMaps];

    // Triangle, pixel (row * columns + column), samples (a bit each), material.
    Integers triangle, pixel, mask, material;
};
static_assert(sizeof(Block) == (76 + 4) * kPoints * 4);  // tests know the rows

// Points of a block: the first, and one beyond the last.
struct Run {
    int first, last;
};

struct Vector {
    float x, y, z;
};

inline Vector operator+(Vector a, Vector b) {
    return {a.x + b.x, a.y + b.y, a.z + b.z};
}
inline Vector operator-(Vector a, Vector b) {
    return {a.x - b.x, a.y - b.y, a.z - b.z};
}
inline Vector operator*(Vector a, float by) {
    return {a.x * by, a.y * by, a.z * by};
}
inline float dot(Vector a, Vector b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline Vector cross(Vector a, Vector b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}

// Of one point, from three rows of a block; and back.
inline Vector get(const Block::Numbers (&rows)[3], int i) {
    return {rows[0][i], rows[1][i], rows[2][i]};
}
inline void set(Block::Numbers (&rows)[3], int i, Vector v) {
    rows[0][i] = v.x, rows[1][i] = v.y, rows[2][i] = v.z;
}

}  // namespace nlens

// Interpolation of vertex attributes over the points of a block.
#include "interpolation.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "triangles.h"
#include "vectors.h"

namespace nlens {
namespace {

constexpr float kLeast = 1e-30f;
constexpr float kKernel = 1.0f / std::numbers::pi_v<float>, kWidest = 0.06f;  // see `find_widening`
constexpr float kThinnest = 1e-8f;  // square of how far coordinates are stretched; beyond, it is noise

float sum_of_three(Float4 v) {
    return v[0] + v[1] + v[2];
}

// Of a triangle's corners at a position, their change by a column and a row; depth there.
struct Weights {
    Float4 here, across, down;
    float depth;
};

Weights weights(const float* planes, float x, float y) {
    const auto a = load<Float4>(planes + kA), b = load<Float4>(planes + kB), c = load<Float4>(planes + kC);
    // weights divided by depth; their sum, 1 / depth
    const Float4 shares = a * (x - planes[kX0]) + b * (y - planes[kY0]) + c;
    const float depth = 1.0f / sum_of_three(shares);
    const Float4 here = shares * depth;
    return {here, (a - here * sum_of_three(a)) * depth, (b - here * sum_of_three(b)) * depth, depth};
}

// Rows of four numbers of a triangle's corners.
struct CornerRows {
    Float4 a, b, c;

    CornerRows(Array<const float, 2> values, const std::int32_t* corners)
        : a(load<Float4>(values.at(corners[0]))),
          b(load<Float4>(values.at(corners[1]))),
          c(load<Float4>(values.at(corners[2]))) {}

    Float4 weighted(Float4 by) const { return a * by[0] + b * by[1] + c * by[2]; }
    // By weights whose sum is 0: exactly 0 where corners are alike.
    Float4 moved(Float4 by) const { return (b - a) * by[1] + (c - a) * by[2]; }
};

void put(Block::Numbers* rows, int i, Float4 v) {
    for (int k = 0; k < 4; ++k) rows[k][i] = v[k];
}

// Fills in what normals that change by so much a column and a row add to the square of alpha: Tokuyoshi and
// Kaplanyan, "Improved Geometric Specular Antialiasing" (2019), the isotropic one. Under one sample a pixel,
// highlights narrower than that come and go as the surface moves. Bounded more tightly than there (0.18): at
// rims, wider highlights reflect lamps that no point within the pixel does.
void find_widening(Block& block, int count, const Block::Numbers (&across)[3],
                   const Block::Numbers (&down)[3]) {
    for (int i = 0; i < count; ++i) {
        const Vector n = get(block.normal, i), x = get(across, i), y = get(down, i);
        const float least = dot(n, n), squared = least > kLeast ? least : kLeast;
        const float along = dot(n, x), below = dot(n, y);
        const float turned = (dot(x, x) + dot(y, y) - (along * along + below * below) / squared) / squared;
        const float widening = kKernel * (turned > 0.0f ? turned : 0.0f);
        block.widening[i] = widening < kWidest ? widening : kWidest;
    }
}

// Weighted corners where the weights' sum is 0, in differences: worlds may lie far off.
Vector moved(const Mesh& mesh, const std::int32_t* corners, Float4 by) {
    const float* a = mesh.positions.at(corners[0]);
    const float* b = mesh.positions.at(corners[1]);
    const float* c = mesh.positions.at(corners[2]);
    const float u = by[1], v = by[2];
    return {u * (b[0] - a[0]) + v * (c[0] - a[0]), u * (b[1] - a[1]) + v * (c[1] - a[1]),
            u * (b[2] - a[2]) + v * (c[2] - a[2])};
}

// Unit normal, and tangent and bitangent along what is in `uv`, of unit length too: the frame of MikkTSpace.
// Both are 0 where the coordinates do not change, or in one direction only.
struct Frame {
    Vector normal, tangent, bitangent;
};

Frame frame(const Block& block, int i, const Mesh& mesh) {
    const int t = block.triangle[i];
    const float* planes = mesh.planes.at(t);
    const std::int32_t* corners = mesh.faces.at(t);
    const Weights by = weights(planes, block.x[i], block.y[i]);
    Vector n = get(block.normal, i);
    n = n * (planes[kFacing] / std::sqrt(std::max(dot(n, n), kLeast)));
    const Vector px = moved(mesh, corners, by.across), py = moved(mesh, corners, by.down);
    const Vector fy = cross(py, n), fx = cross(n, px);
    // The handedness of gradients follows the screen's: columns and rows turn about +-n.
    const float turn = dot(py, fx) < 0.0f ? -1.0f : 1.0f;
    const auto gradient = [&](int k) { return (fy * block.uv[1][k][i] + fx * block.uv[2][k][i]) * turn; };
    const Vector rightwards = gradient(0);
    // v grows downwards in the picture, the map's green upwards.
    const Vector upwards = gradient(1) * -1.0f;
    const float width = dot(rightwards, rightwards), height = dot(upwards, upwards);
    if (!(std::min(width, height) > kThinnest * std::max(width, height))) return {n, {}, {}};
    const Vector bitangent = upwards * (1.0f / std::sqrt(height));
    const Vector tangent = cross(bitangent, n);
    return {n, dot(tangent, rightwards) < 0.0f ? tangent * -1.0f : tangent, bitangent};
}

bool equal(Vector a, Vector b) {
    return a.x == b.x && a.y == b.y && a.z == b.z;
}

}  // namespace

void interpolate(Block& block, int count, const Mesh& mesh) {
    const bool coloured = mesh.colors.shape[0] > 0;
    Block::Numbers across[3], down[3];
    for (int i = 0; i < count; ++i) {
        const int t = block.triangle[i];
        const float* planes = mesh.planes.at(t);
        const std::int32_t* corners = mesh.faces.at(t);
        const Weights by = weights(planes, block.x[i], block.y[i]);
        block.material[i] = mesh.material(t);
        block.depth[i] = by.depth;
        const CornerRows uv(mesh.uv, corners);
        put(block.coordinates[0], i, uv.weighted(by.here));
        put(block.coordinates[1], i, uv.weighted(by.across));
        put(block.coordinates[2], i, uv.weighted(by.down));
        const CornerRows normals(mesh.normals, corners);
        const Float4 n = normals.weighted(by.here) * planes[kFacing];
        set(block.normal, i, {n[0], n[1], n[2]});
        const Float4 x = normals.moved(by.across), y = normals.moved(by.down);
        set(across, i, {x[0], x[1], x[2]});
        set(down, i, {y[0], y[1], y[2]});
        Float4 color = {1.0f, 1.0f, 1.0f, 1.0f};
        if (coloured) color = CornerRows(mesh.colors, corners).weighted(by.here);
        set(block.base, i, {color[0], color[1], color[2]});
        block.alpha[i] = color[3];
    }
    find_widening(block, count, across, down);
}

void apply_normal_map(Block& block, Run run, const Mesh& mesh, float strength) {
    for (int i = run.first; i < run.last; ++i) {
        const auto [n, s, t] = frame(block, i, mesh);
        float a = strength * (block.texel[0][i] * 2.0f - 1.0f);
        float b = strength * (block.texel[1][i] * 2.0f - 1.0f);
        float c = block.texel[2][i] * 2.0f - 1.0f;
        if (equal(s, t)) a = 0.0f, b = 0.0f, c = 1.0f;  // both are 0: there is no frame
        set(block.normal, i, (s * a + t * b + n * c) * mesh.planes(block.triangle[i], kFacing));
    }
}

void find_directions(Block& block, Run run, const Mesh& mesh) {
    for (int i = run.first; i < run.last; ++i) {
        const auto [n, s, t] = frame(block, i, mesh);
        const Vector along = s * block.along[0][i] + t * block.along[1][i];
        set(block.along, i, along);
        set(block.beside, i, cross(n, along));
    }
}

void view_vectors(Block& block, Array<const float, 1> lens) {
    for (int i = 0; i < kPoints; ++i) {
        const Vector n = get(block.normal, i);
        const float squared = dot(n, n);
        set(block.normal, i, n * (1.0f / std::sqrt(squared > kLeast ? squared : kLeast)));
    }
    const Vector right{lens(0), lens(1), lens(2)}, up{lens(3), lens(4), lens(5)};
    const Vector back{lens(6), lens(7), lens(8)};
    const float per_column = 1.0f / lens(9), per_row = 1.0f / lens(10), cx = lens(11), cy = lens(12);
    for (int i = 0; i < kPoints; ++i) {
        const Vector v = back - right * ((block.x[i] - cx) * per_column) - up * ((cy - block.y[i]) * per_row);
        const float length = std::sqrt(dot(v, v));
        set(block.view, i, v * (1.0f / length));
        block.distance[i] = block.depth[i] * length;
    }
}

}  // namespace nlens

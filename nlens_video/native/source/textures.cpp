// Sampling of textures as OpenGL 4 defines it (section 8.14): `render/software/textures.py`.
//
// Addresses and weights are computed for many points at once (vectorised); a loop of its own then
// reads the texels, so that no point waits for the memory accesses of the previous one.
#include "textures.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "module.h"
#include "vectors.h"

namespace nlens {
namespace {

// OpenGL's codes, as glTF stores them.
constexpr int kClamp = 33071, kMirror = 33648, kLinear = 9729;
constexpr int kNearestOfNearest = 9984, kLinearOfNearest = 9985, kNearestOfTwo = 9986;
// Columns of the atlas' table: first level, levels, filters for enlarging and shrinking, wrapping.
enum { kFirst, kCount, kMag, kMin, kWrapS, kWrapT };
constexpr float kFar = 1e6f;

// How a texture is filtered.
struct Rule {
    float width, height, last;  // columns and rows, the last level
    float edge;                 // the square of the change from which on it is shrunk
    bool enlarged_smooth, shrunk_smooth, single_level;
};

// What the points of a run read: on both levels the texel within its level, the distance to the one
// below, and the shares of those beside and below.
struct Chosen {
    Block::Numbers u, v;  // in [0, 1]
    Block::Numbers level, next, smooth;
    Block::Numbers across[2], down[2];
    Block::Integers texel[2], stride[2];
};

// Of a positive number, to 1e-6: the C library's takes one number at a time.
inline float log2_of(float value) {
    constexpr float kRoot = 1.41421356237f, kOfOdd = 2.88539008178f;
    const auto bits = std::bit_cast<std::int32_t>(value);
    const float exponent = static_cast<float>((bits >> 23) - 127);
    float part = std::bit_cast<float>((bits & 0x7FFFFF) | (127 << 23));
    const bool large = part > kRoot;
    part = large ? part * 0.5f : part;
    const float odd = (part - 1.0f) / (part + 1.0f);  // of the series of the inverse hyperbolic tangent
    const float square = odd * odd;
    const float series = 1.0f + square * (1.0f / 3.0f + square * (1.0f / 5.0f + square * (1.0f / 7.0f)));
    return exponent + (large ? 1.0f : 0.0f) + kOfOdd * odd * series;
}

// `0.5 ** power` of a whole number from 0 to 126.
inline float half_power(float power) {
    return std::bit_cast<float>((127 - static_cast<std::int32_t>(power)) << 23);
}

// Coordinates as ones in [0, 1]; 0 where they are too large to have a fraction.
void wrap(const Block::Numbers& from, Run run, std::int64_t way, Block::Numbers& to) {
    const auto near = [](float u) { return std::fabs(u) < kFar ? u : 0.0f; };
    const auto to_one = [](float u) { return u < 1.0f ? u : 1.0f; };
    if (way == kClamp) {
        for (int i = run.first; i < run.last; ++i) {
            const float u = near(from[i]);
            to[i] = to_one(u > 0.0f ? u : 0.0f);
        }
    } else if (way == kMirror) {
        for (int i = run.first; i < run.last; ++i) {
            const float u = near(from[i]);
            to[i] = to_one(std::fabs(u - 2.0f * std::floor(u * 0.5f + 0.5f)));
        }
    } else {
        for (int i = run.first; i < run.last; ++i) {
            const float u = near(from[i]);
            to[i] = u - std::floor(u);
        }
    }
}

// Which level each point of a run reads, and the share of the next.
void choose_levels(const Block::Numbers (&uv)[3][2], Run run, Rule rule, Chosen& chosen) {
    const float enlarged = rule.enlarged_smooth ? 1.0f : 0.0f, shrinking = rule.shrunk_smooth ? 1.0f : 0.0f;
    const float *u_across = uv[1][0], *v_across = uv[1][1], *u_down = uv[2][0], *v_down = uv[2][1];
    for (int i = run.first; i < run.last; ++i) {
        const float ux = u_across[i] * rule.width, vx = v_across[i] * rule.height;
        const float uy = u_down[i] * rule.width, vy = v_down[i] * rule.height;
        const float across = ux * ux + vx * vx, down = uy * uy + vy * vy;
        const float squared = across > down ? across : down;
        const bool shrunk = squared > rule.edge;
        float lod = 0.5f * log2_of(shrunk ? squared : 1.0f);
        lod = lod < rule.last ? lod : rule.last;
        chosen.level[i] = lod > 0.0f ? lod : 0.0f;
        chosen.smooth[i] = shrunk ? shrinking : enlarged;
    }
    if (rule.single_level) {
        for (int i = run.first; i < run.last; ++i) {
            const float lod = chosen.level[i], near = std::floor(lod + 0.5f);
            const float level = near < lod + 0.5f ? near : near - 1.0f;  // a half goes to the larger picture
            chosen.level[i] = level > 0.0f ? level : 0.0f;
            chosen.next[i] = 0.0f;
        }
    } else {
        for (int i = run.first; i < run.last; ++i) {
            const float lod = chosen.level[i], level = std::floor(lod);
            chosen.level[i] = level;
            chosen.next[i] = lod - level;
        }
    }
}

// The texels of a level of each point, 0 for its own and 1 for the next.
void choose_texels(Run run, Rule rule, int k, Chosen& chosen) {
    const float further = static_cast<float>(k);
    for (int i = run.first; i < run.last; ++i) {
        float level = chosen.level[i] + further;
        level = level < rule.last ? level : rule.last;
        const float scale = half_power(level), smooth = chosen.smooth[i];
        float columns = std::floor(rule.width * scale), rows = std::floor(rule.height * scale);
        columns = columns > 1.0f ? columns : 1.0f;
        rows = rows > 1.0f ? rows : 1.0f;
        const float x = chosen.u[i] * columns - 0.5f * smooth, y = chosen.v[i] * rows - 0.5f * smooth;
        float left = std::floor(x), top = std::floor(y);
        chosen.across[k][i] = (x - left) * smooth;
        chosen.down[k][i] = (y - top) * smooth;
        const float last_column = columns - 1.0f, last_row = rows - 1.0f;
        left = left < last_column + smooth ? left : last_column;
        top = top < last_row + smooth ? top : last_row;
        const auto stride = static_cast<std::int32_t>(columns) + 2;
        chosen.texel[k][i] = static_cast<std::int32_t>(top) * stride + static_cast<std::int32_t>(left);
        chosen.stride[k][i] = stride;
    }
}

using Codes = std::uint16_t __attribute__((vector_size(16)));
using Int8 = std::int32_t __attribute__((vector_size(32)));

// A texel and the one to its right.
inline Float8 pair(const std::uint16_t* texels, std::int64_t texel) {
    const auto codes = load<Codes>(texels + 4 * texel);
    return __builtin_convertvector(__builtin_convertvector(codes, Int8), Float8);
}

// RGBA between four texels, in codes.
inline Float4 mixed(const std::uint16_t* texels, std::int64_t start, const Chosen& chosen, int k, int i) {
    const std::int64_t here = start + chosen.texel[k][i];
    const Float8 upper = pair(texels, here);
    const Float8 lower = pair(texels, here + chosen.stride[k][i]);
    const Float8 both = upper + (lower - upper) * chosen.down[k][i];
    const Float4 left = __builtin_shufflevector(both, both, 0, 1, 2, 3);
    const Float4 right = __builtin_shufflevector(both, both, 4, 5, 6, 7);
    return left + (right - left) * chosen.across[k][i];
}

// `first` and `last` are the texture's levels.
void read(const Atlas& atlas, int first, int last, const Chosen& chosen, Run run,
          Block::Numbers (&texel)[4]) {
    const std::uint16_t* texels = atlas.texels.data;
    float found[kPoints][4];
    for (int i = run.first; i < run.last; ++i) {
        const int level = first + static_cast<int>(chosen.level[i]);
        Float4 rgba = mixed(texels, atlas.levels(level, 0), chosen, 0, i);
        if (chosen.next[i] > 0.0f) {
            const Float4 coarser = mixed(texels, atlas.levels(std::min(level + 1, last), 0), chosen, 1, i);
            rgba = rgba + (coarser - rgba) * chosen.next[i];
        }
        store(found[i], rgba * (1.0f / 65535.0f));
    }
    for (int c = 0; c < 4; ++c) {
        for (int i = run.first; i < run.last; ++i) texel[c][i] = found[i][c];
    }
}

Rule rule_of(const Atlas& atlas, const std::int64_t* row) {
    const auto mag = row[kMag], least = row[kMin];
    const bool sharper = mag == kLinear && (least == kNearestOfNearest || least == kNearestOfTwo);
    return {
        .width = static_cast<float>(atlas.levels(row[kFirst], 1)),
        .height = static_cast<float>(atlas.levels(row[kFirst], 2)),
        .last = static_cast<float>(row[kCount] - 1),
        .edge = sharper ? 2.0f : 1.0f,
        .enlarged_smooth = mag == kLinear,
        .shrunk_smooth = least == kLinear || least == kLinearOfNearest || least > kNearestOfTwo,
        .single_level = least == kNearestOfNearest || least == kLinearOfNearest,
    };
}

// `sample_texture` for as many points as there are columns; `uv` (6, n) are coordinates and their
// changes by a column and by a row, `out` (4, n).
void sample_points(Array<const float, 2> uv, const Atlas& atlas, int texture, Array<float, 2> out) {
    Block block{};
    for (int start = 0; start < out.shape[1]; start += kPoints) {
        const int count = std::min(kPoints, out.shape[1] - start);
        for (int k = 0; k < 6; ++k) std::copy_n(uv.at(k, start), count, block.uv[k / 2][k % 2]);
        sample_texture(block, {0, count}, atlas, texture);
        for (int c = 0; c < 4; ++c) std::copy_n(block.texel[c], count, out.at(c, start));
    }
}

}  // namespace

void sample_texture(Block& block, Run run, const Atlas& atlas, int texture) {
    const std::int64_t* row = atlas.table.at(texture);
    const Rule rule = rule_of(atlas, row);
    Chosen chosen;
    choose_levels(block.uv, run, rule, chosen);
    wrap(block.uv[0][0], run, row[kWrapS], chosen.u);
    wrap(block.uv[0][1], run, row[kWrapT], chosen.v);
    choose_texels(run, rule, 0, chosen);
    const auto mixes = [](float share) { return share > 0.0f; };
    if (std::any_of(chosen.next + run.first, chosen.next + run.last, mixes))
        choose_texels(run, rule, 1, chosen);
    const int first = static_cast<int>(row[kFirst]);
    read(atlas, first, first + static_cast<int>(row[kCount]) - 1, chosen, run, block.texel);
}

void bind_textures(nanobind::module_& module) {
    module.def("sample_texture", &sample_points, Unlocked());
}

}  // namespace nlens

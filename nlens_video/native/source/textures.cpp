// Sampling of textures as OpenGL 4 defines it (section 8.14): `render/software/textures.py`.
//
// A pixel's footprint on a texture is an ellipse. The level is that of its shorter axis, and several
// probes lie along the longer one, as in McCormack et al., "Feline: Fast Elliptical Lines for Anisotropic
// Texture Mapping" (1999).
//
// Addresses and weights are computed for many probes at once (vectorised); a loop of its own then
// reads the texels, so that no probe waits for the memory accesses of the previous one.
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
constexpr float kMostProbes = 16.0f;
constexpr float kRound = 1.5f;  // square of the ratio of a footprint's axes that are taken for equal

// How a texture is filtered.
struct Rule {
    float width, height, last;  // columns and rows, the last level
    float edge;                 // square of the shorter axis from which on it is shrunk
    bool enlarged_smooth, shrunk_smooth, single_level;
};

// Of each point: level of detail, 1 where neighbouring texels are mixed, number of probes, and
// coordinates from one to the next.
struct Footprints {
    Block::Numbers lod, smooth, probes, step_u, step_v;
};

// Probes that are read together: of which point, and its share of that point's colour; on both levels
// the texel within its level, the distance to the one below, and the shares of those beside and below.
struct Probes {
    Block::Integers point;
    Block::Numbers share;
    Block::Numbers u, v;  // in [0, 1] once they are wrapped
    Block::Numbers level, next, smooth;
    Block::Numbers across[2], down[2];
    Block::Integers texel[2], stride[2];
    int count = 0;

    void add(int of, float part, float at_u, float at_v, float lod, float mixed) {
        point[count] = of, share[count] = part, u[count] = at_u, v[count] = at_v;
        level[count] = lod, smooth[count] = mixed;
        ++count;
    }
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

// Makes coordinates ones in [0, 1]; 0 where they are too large to have a fraction.
void wrap(Block::Numbers& field, int count, std::int64_t way) {
    const auto near = [](float u) { return std::fabs(u) < kFar ? u : 0.0f; };
    const auto to_one = [](float u) { return u < 1.0f ? u : 1.0f; };
    if (way == kClamp) {
        for (int i = 0; i < count; ++i) {
            const float u = near(field[i]);
            field[i] = to_one(u > 0.0f ? u : 0.0f);
        }
    } else if (way == kMirror) {
        for (int i = 0; i < count; ++i) {
            const float u = near(field[i]);
            field[i] = to_one(std::fabs(u - 2.0f * std::floor(u * 0.5f + 0.5f)));
        }
    } else {
        for (int i = 0; i < count; ++i) {
            const float u = near(field[i]);
            field[i] = u - std::floor(u);
        }
    }
}

// Footprints of the points of a run: the ellipses that a circle of a pixel's width becomes. Whatever
// the number of probes, their variance is the difference of the variances of two even rows as long as
// the axes, so that no seam shows where it changes.
void measure(const Block::Numbers (&uv)[3][2], Run run, Rule rule, Footprints& found) {
    const float enlarged = rule.enlarged_smooth ? 1.0f : 0.0f, shrinking = rule.shrunk_smooth ? 1.0f : 0.0f;
    const float *u_across = uv[1][0], *v_across = uv[1][1], *u_down = uv[2][0], *v_down = uv[2][1];
    for (int i = run.first; i < run.last; ++i) {
        const float ux = u_across[i] * rule.width, vx = v_across[i] * rule.height;
        const float uy = u_down[i] * rule.width, vy = v_down[i] * rule.height;
        const float of_u = ux * ux + uy * uy, of_v = vx * vx + vy * vy, of_both = ux * vx + uy * vy;
        const float half = 0.5f * (of_u - of_v), root = std::sqrt(half * half + of_both * of_both);
        const float longer = 0.5f * (of_u + of_v) + root;  // squares of the axes [texel^2]
        const float area = ux * vy - uy * vx;
        float shorter = area * area / (longer > 1.0f ? longer : 1.0f);
        shorter = shorter > 1.0f ? shorter : 1.0f;
        const float least = longer * (1.0f / (kMostProbes * kMostProbes));
        shorter = shorter > least ? shorter : least;
        const float ratio = longer / shorter;
        const bool is_long = ratio > kRound;
        const float wanted = std::floor(std::sqrt(is_long ? ratio : 1.0f) + 0.5f);
        const float several = wanted > 2.0f ? wanted : 2.0f;
        const float spread = (longer - shorter) / (several * several - 1.0f);  // square of a step
        const bool wide = of_u >= of_v;
        const float u = wide ? half + root : of_both, v = wide ? of_both : root - half;
        const float length = u * u + v * v;
        const float step = is_long ? std::sqrt(spread / length) : 0.0f;
        const float lod = 0.5f * log2_of(shorter > rule.edge ? shorter : 1.0f);
        found.lod[i] = lod < rule.last ? lod : rule.last;
        found.smooth[i] = shorter > rule.edge ? shrinking : enlarged;
        found.probes[i] = is_long ? several : 1.0f;
        found.step_u[i] = is_long ? u * step / rule.width : 0.0f;
        found.step_v[i] = is_long ? v * step / rule.height : 0.0f;
    }
}

// Makes the level of detail of each probe a level, and the share of the next.
void choose_levels(Rule rule, Probes& probes) {
    if (rule.single_level) {
        for (int i = 0; i < probes.count; ++i) {
            const float lod = probes.level[i], near = std::floor(lod + 0.5f);
            const float level = near < lod + 0.5f ? near : near - 1.0f;  // a half goes to the larger picture
            probes.level[i] = level > 0.0f ? level : 0.0f;
            probes.next[i] = 0.0f;
        }
    } else {
        for (int i = 0; i < probes.count; ++i) {
            const float lod = probes.level[i], level = std::floor(lod);
            probes.level[i] = level;
            probes.next[i] = lod - level;
        }
    }
}

// The texels of a level of each probe, 0 for its own and 1 for the next.
void choose_texels(Rule rule, int k, Probes& probes) {
    const float further = static_cast<float>(k);
    for (int i = 0; i < probes.count; ++i) {
        float level = probes.level[i] + further;
        level = level < rule.last ? level : rule.last;
        const float scale = half_power(level), smooth = probes.smooth[i];
        float columns = std::floor(rule.width * scale), rows = std::floor(rule.height * scale);
        columns = columns > 1.0f ? columns : 1.0f;
        rows = rows > 1.0f ? rows : 1.0f;
        const float x = probes.u[i] * columns - 0.5f * smooth, y = probes.v[i] * rows - 0.5f * smooth;
        float left = std::floor(x), top = std::floor(y);
        probes.across[k][i] = (x - left) * smooth;
        probes.down[k][i] = (y - top) * smooth;
        const float last_column = columns - 1.0f, last_row = rows - 1.0f;
        left = left < last_column + smooth ? left : last_column;
        top = top < last_row + smooth ? top : last_row;
        const auto stride = static_cast<std::int32_t>(columns) + 2;
        probes.texel[k][i] = static_cast<std::int32_t>(top) * stride + static_cast<std::int32_t>(left);
        probes.stride[k][i] = stride;
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
inline Float4 mixed(const std::uint16_t* texels, std::int64_t start, const Probes& probes, int k, int i) {
    const std::int64_t here = start + probes.texel[k][i];
    const Float8 upper = pair(texels, here);
    const Float8 lower = pair(texels, here + probes.stride[k][i]);
    const Float8 both = upper + (lower - upper) * probes.down[k][i];
    const Float4 left = __builtin_shufflevector(both, both, 0, 1, 2, 3);
    const Float4 right = __builtin_shufflevector(both, both, 4, 5, 6, 7);
    return left + (right - left) * probes.across[k][i];
}

// Adds the colours of the probes to those of their points (kPoints, RGBA), and forgets the probes.
void read(const Atlas& atlas, int texture, Rule rule, Probes& probes, float (*sums)[4]) {
    const std::int64_t* row = atlas.table.at(texture);
    const int first = static_cast<int>(row[kFirst]), last = first + static_cast<int>(row[kCount]) - 1;
    choose_levels(rule, probes);
    wrap(probes.u, probes.count, row[kWrapS]);
    wrap(probes.v, probes.count, row[kWrapT]);
    choose_texels(rule, 0, probes);
    const auto mixes = [](float share) { return share > 0.0f; };
    if (std::any_of(probes.next, probes.next + probes.count, mixes)) choose_texels(rule, 1, probes);
    const std::uint16_t* texels = atlas.texels.data;
    for (int i = 0; i < probes.count; ++i) {
        const int level = first + static_cast<int>(probes.level[i]);
        Float4 rgba = mixed(texels, atlas.levels(level, 0), probes, 0, i);
        if (probes.next[i] > 0.0f) {
            const Float4 coarser = mixed(texels, atlas.levels(std::min(level + 1, last), 0), probes, 1, i);
            rgba = rgba + (coarser - rgba) * probes.next[i];
        }
        float* sum = sums[probes.point[i]];
        store(sum, load<Float4>(sum) + rgba * (probes.share[i] * (1.0f / 65535.0f)));
    }
    probes.count = 0;
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
    const Rule rule = rule_of(atlas, atlas.table.at(texture));
    const auto& [u, v] = block.uv[0];
    Footprints found;
    measure(block.uv, run, rule, found);
    float sums[kPoints][4]{};
    Probes probes;
    for (int i = run.first; i < run.last; ++i) {
        const float count = found.probes[i], share = 1.0f / count;
        for (float k = 0.5f - 0.5f * count; k < 0.5f * count; k += 1.0f) {  // from the middle, in steps
            probes.add(i, share, u[i] + k * found.step_u[i], v[i] + k * found.step_v[i], found.lod[i],
                       found.smooth[i]);
            if (probes.count == kPoints) read(atlas, texture, rule, probes, sums);
        }
    }
    read(atlas, texture, rule, probes, sums);
    for (int c = 0; c < 4; ++c) {
        for (int i = run.first; i < run.last; ++i) block.texel[c][i] = sums[i][c];
    }
}

void bind_textures(nanobind::module_& module) {
    module.def("sample_texture", &sample_points, Unlocked());
}

}  // namespace nlens

// Spans and stamps of one level, added to rows of the result: `kernels/scatter/scatter_rows.py`.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "vectors.h"

namespace nlens {
// Compiled once for each kind of processor: nothing here may be shared between them.
namespace {

enum Number { RADIUS, AXIS, SPAN, STAMP, ALONG, DOWN, STAMP_RADIUS, BARREL_X, BARREL_Y, NUMBERS };

// Tables of one aperture, see `disc.Discs`.
struct Discs {
    const float* stamps;  // (rows, columns, entries)
    int stamp_rows, stamp_columns, stamp_entries;
    const float* spans;  // (rows, 2, entries)
    int span_rows, span_entries;
    float stamp_step, span_step;  // entries per pixel of radius
    std::uint32_t stamp_turned, span_turned;
    float aspect, outer;
};

// What the pixels of a level spread, see `levels.Light` and `levels.Level.rows`.
struct Light {
    const float* rgba;     // (height, width, 4)
    const float* numbers;  // (height, NUMBERS, width)
    const std::int32_t* rows;  // (7, height)
    int height, width;
};

// The next coarser level's sums (rows, columns, 5), and where they start.
struct Coarse {
    const float* sums;
    int rows, columns, row, column;
};

struct Columns {
    int first, last;
};

inline void look_up(const float* numbers, int count, const float* table, float scale,
                    std::uint32_t behind, float* out) {
    for (int x = 0; x < count; ++x) {
        const float place = std::fabs(numbers[x]) * scale;
        const auto whole = static_cast<std::int32_t>(place);
        const float part = place - static_cast<float>(whole);
        const std::int32_t entry = whole + (numbers[x] > 0.0f ? static_cast<std::int32_t>(behind) : 0);
        const float low = table[entry];
        out[x] = low + part * (table[entry + 1] - low);
    }
}

struct Ends {
    float *start, *stop, *weight;
};

inline void cut_spans(Ends ends, const float* of_row, int width, Columns columns, int dy, float rim,
                      float aspect) {
    for (int x = columns.first; x <= columns.last; ++x) {
        const float axis = std::max(of_row[AXIS * width + x], 1e-6f);
        const float off = (static_cast<float>(dy) - of_row[BARREL_Y * width + x]) / (axis * aspect);
        const float half = std::sqrt(std::max(rim * rim - off * off, 0.0f));
        const float across = of_row[BARREL_X * width + x] / axis;
        const float low = std::max(ends.start[x] - ends.stop[x], across - half);
        const float high = std::min(ends.start[x] + ends.stop[x], across + half);
        ends.start[x] = 0.5f * (low + high);
        ends.stop[x] = std::max(0.5f * (high - low), 0.0f);
    }
}

[[gnu::noinline]] void place_spans(Ends ends, const float* of_row, int width, const Discs& discs,
                        Columns columns, int dy, float skew, float rim) {
    const float* table = discs.spans + (dy + discs.span_rows / 2) * 2 * discs.span_entries;
    const int begin = columns.first, count = columns.last + 1 - begin;
    const float* radii = of_row + RADIUS * width + begin;
    const float* axes = of_row + AXIS * width + begin;
    const float* along = of_row + ALONG * width + begin;
    const float* down = of_row + DOWN * width + begin;
    const float* size = of_row + SPAN * width + begin;
    float* __restrict starts = ends.start + begin;
    float* __restrict stops = ends.stop + begin;
    float* __restrict weights = ends.weight + begin;
    const float rows = static_cast<float>(dy);
    look_up(radii, count, table + discs.span_entries, discs.span_step, discs.span_turned, stops);
    if (discs.outer == 1.0f) {  // round: all spans lie in the middle
        std::fill_n(starts, std::max(count, 0), 0.0f);
    } else {
        look_up(radii, count, table, discs.span_step, discs.span_turned, starts);
    }
    if (rim > 0.0f) cut_spans(ends, of_row, width, columns, dy, rim, discs.aspect);
    for (int x = 0; x < count; ++x) {
        const float middle = axes[x] * starts[x], half = axes[x] * stops[x];
        const float even = 1.0f + rows * down[x] + along[x] * middle;
        // the light of a span grows along it: an even one of the same light lies off a little
        const float first = 0.5f + middle + skew * along[x] * half * half * (1.0f / 3.0f) - half;
        starts[x] = first;
        stops[x] = first + half + half;
        weights[x] = half > 0.0f ? size[x] * even : 0.0f;
    }
}

// One end of a span, between two columns of the difference buffer; the upper half of a column's
// sixteen counts one column on, so that neighbours do not wait for each other's sums.
inline void add_span_end(float* at, Float8 light, float here, float further) {
    store(at, load<Float8>(at) + here * light);
    store(at + 8, load<Float8>(at + 8) + further * light);
}

[[gnu::noinline]] void add_spans(float* sums, Ends ends, const float* rgba, Columns columns, int edge) {
    for (int x = columns.first; x <= columns.last; ++x) {
        const float weight = ends.weight[x];
        if (weight == 0.0f) continue;
        const float* pixel = rgba + 4 * x;
        const Float8 light = {pixel[0], pixel[1], pixel[2], pixel[3], 1.0f, 0.0f, 0.0f, 0.0f};
        const float start = ends.start[x], stop = ends.stop[x];
        const float first = std::floor(start), last = std::floor(stop);
        float further = weight * (start - first);
        add_span_end(sums + 16 * (x + edge + static_cast<int>(first)), light, weight - further, further);
        further = weight * (stop - last);
        add_span_end(sums + 16 * (x + edge + static_cast<int>(last)), light, further - weight, -further);
    }
}

// The running sum of a row, in double precision.
[[gnu::noinline]] void finish(const float* spans, int start, float* sums, int width) {
    if (start == 0) {
        std::fill_n(sums, 5 * width, 0.0f);
        return;
    }
    Double4 light = {};
    double weight = 0.0;
    for (int i = 1; i < start + width; ++i) {
        const float *here = spans + 16 * i, *before = here - 8;
        light += __builtin_convertvector(load<Float4>(here), Double4) +
                 __builtin_convertvector(load<Float4>(before), Double4);
        weight += static_cast<double>(here[4]) + static_cast<double>(before[4]);
        if (i >= start) {
            store(sums, __builtin_convertvector(light, Float4));
            sums[4] = static_cast<float>(weight);
            sums += 5;
        }
    }
}

// Interpolated between the coarser level's pixels.
[[gnu::noinline]] void add_coarse(const Coarse& coarse, float* line, int y, float* sums, int width) {
    const int row = y - coarse.row, near = row >> 1, far = row & 1 ? near + 1 : near - 1;
    const int count = 5 * coarse.columns;
    const float *one = coarse.sums + near * count, *other = coarse.sums + far * count;
    for (int i = 0; i < count; ++i) line[i] = 0.25f * (0.75f * one[i] + 0.25f * other[i]);
    for (int x = 0; x < width; ++x) {
        const int column = x - coarse.column, here = column >> 1;
        const int beside = column & 1 ? here + 1 : here - 1;
        float* sum = sums + 5 * x;
        for (int c = 0; c < 5; ++c) {
            sum[c] = sum[c] + 0.75f * line[5 * here + c] + 0.25f * line[5 * beside + c];
        }
    }
}

struct Spots {
    float* planes;  // (5, length)
    int length;
};

[[gnu::noinline]] void add_stamps(Spots spots, const float* rgba, const float* of_row, int width,
                       const Discs& discs, Columns columns, int reach, int dy, float* scratch) {
    const int row = dy + discs.stamp_rows / 2, middle = discs.stamp_columns / 2;
    const int begin = columns.first, count = columns.last + 1 - begin;
    const int edge = (spots.length - width) / 2 + begin;
    const bool round = discs.outer == 1.0f;
    const float* along = of_row + ALONG * width + begin;
    const float* down = of_row + DOWN * width + begin;
    const float* size = of_row + STAMP * width + begin;
    float* __restrict weights = scratch + 4 * width;
    float* __restrict tables = scratch + 5 * width;
    const float rows = static_cast<float>(dy);
    for (int c = 0; c < 4; ++c) {
        float* __restrict plane = scratch + c * width;
        for (int x = 0; x < count; ++x) plane[x] = rgba[4 * (begin + x) + c];
    }
    for (int dx = round ? 0 : -reach; dx <= reach; ++dx) {
        const float* table =
            discs.stamps + (row * discs.stamp_columns + middle + dx) * discs.stamp_entries;
        look_up(of_row + STAMP_RADIUS * width + begin, count, table, discs.stamp_step,
                discs.stamp_turned, tables);
        for (int side = 0; side < (dx > 0 && round ? 2 : 1); ++side) {
            const int column = side ? -dx : dx;
            const float across = static_cast<float>(column);
            for (int x = 0; x < count; ++x) {
                const float even = 1.0f + across * along[x] + rows * down[x];
                weights[x] = std::max(tables[x] * size[x] * even, 0.0f);
            }
            float* spot = spots.planes + edge + column;
            for (int c = 0; c < 4; ++c, spot += spots.length) {
                const float* __restrict plane = scratch + c * width;
                float* __restrict to = spot;
                for (int x = 0; x < count; ++x) to[x] += weights[x] * plane[x];
            }
            float* __restrict to = spot;
            for (int x = 0; x < count; ++x) to[x] += weights[x];
        }
    }
}

[[gnu::noinline]] void add_to_sums(Spots spots, int start, float* sums, int width) {
    for (int x = 0; x < width; ++x) {
        for (int c = 0; c < 5; ++c) sums[5 * x + c] += spots.planes[c * spots.length + start + x];
    }
}

// Rows [begin, end) of a level's sums, whose rows lie `stride` numbers apart.
inline void scatter_rows(const Light& light, const Discs& discs, const double* first_column,
                         const double* last_column, const Coarse& coarse, double largest, float rim,
                         float* sums, std::ptrdiff_t stride, int out_width, int origin_row,
                         int origin_column, int begin, int end) {
    const int width = light.width, height = light.height;
    const int span_rows = discs.span_rows / 2, stamp_rows = discs.stamp_rows / 2;
    const std::int32_t* rows = light.rows;
    std::int32_t furthest = -1;
    for (int y = 0; y < height; ++y) {
        furthest = std::max({furthest, rows[y], rows[3 * height + y]});
    }
    const double across =
        std::max(largest * static_cast<double>(discs.outer) * 1.2, discs.stamp_columns / 2 + 0.0) + 2.0;
    const int edge = static_cast<int>(std::ceil(across)) + 1, length = width + 2 * edge;
    std::vector<float> ends_of_row(16 * static_cast<std::size_t>(length));
    std::vector<float> planes(5 * static_cast<std::size_t>(length));
    std::vector<float> room(9 * static_cast<std::size_t>(width)), line(5 * coarse.columns);
    const Ends ends{room.data(), room.data() + width, room.data() + 2 * width};
    float* for_stamps = room.data() + 3 * width;
    const Spots spots{planes.data(), length};
    for (int y = begin; y < end; ++y) {
        const int here = y + origin_row;
        float* sum = sums + y * stride;
        if (first_column[here] > last_column[here]) {
            std::fill_n(sum, 5 * out_width, 0.0f);
            continue;
        }
        bool with_spans = false, with_stamps = false;
        const int least = static_cast<int>(first_column[here] - across);
        const int most = static_cast<int>(last_column[here] + across) + 1;
        const int stop = std::min(height, here + furthest + 1);
        for (int source = std::max(0, here - furthest); source < stop; ++source) {
            const int dy = here - source;
            const float* of_row = light.numbers + static_cast<std::ptrdiff_t>(source) * NUMBERS * width;
            const float* rgba = light.rgba + static_cast<std::ptrdiff_t>(source) * 4 * width;
            const auto reach = [&](int k) { return rows[k * height + source]; };
            if (std::abs(dy) <= std::min(reach(0), span_rows)) {
                if (!with_spans) std::fill(ends_of_row.begin(), ends_of_row.end(), 0.0f);
                with_spans = true;
                const Columns part{std::max(reach(1), least), std::min(reach(2), most)};
                place_spans(ends, of_row, width, discs, part, dy, 1.0f, rim);
                add_spans(ends_of_row.data(), ends, rgba, part, edge);
            }
            if (std::abs(dy) <= std::min(reach(3), stamp_rows)) {
                if (!with_stamps) std::fill(planes.begin(), planes.end(), 0.0f);
                with_stamps = true;
                const Columns part{std::max(reach(5), least), std::min(reach(6), most)};
                add_stamps(spots, rgba, of_row, width, discs, part,
                           std::min(reach(4), discs.stamp_columns / 2), dy, for_stamps);
            }
        }
        const int first = edge + origin_column;
        finish(ends_of_row.data(), with_spans ? first : 0, sum, out_width);
        if (with_stamps) add_to_sums(spots, first, sum, out_width);
        if (!line.empty()) add_coarse(coarse, line.data(), y, sum, out_width);
    }
}

}  // namespace
}  // namespace nlens

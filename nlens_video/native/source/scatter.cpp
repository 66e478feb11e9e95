// Spans and stamps of one level, added to rows of the result: `kernels/scatter/scatter.py`.
//
// A span is a row of a disc. A stamp is a small disc, spread pixel by pixel: a column of stamps along
// a whole row at a time. Loops over a row are functions of their own: inlined, GCC no longer knows that
// their arrays lie apart, and takes one pixel at a time.
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include "module.h"
#include "scatter_discs.h"
#include "vectors.h"

namespace nlens {
namespace {

// What a level's pixels spread, see `levels.Light`.
struct Light {
    Array<const float, 3> rgba, numbers;
    static constexpr auto fields = std::tuple{&Light::rgba, &Light::numbers};
};

// First and last column of each row that the object can reach.
struct Reached {
    Array<const double, 1> first, last;
    static constexpr auto fields = std::tuple{&Reached::first, &Reached::last};
};

// The next coarser level's sums (rows, columns, 5), and where they start, in pixels of this level.
struct Coarse {
    Array<const float, 3> sums;
    int row, column;
    static constexpr auto fields = std::tuple{&Coarse::sums, &Coarse::row, &Coarse::column};
};

// Makes starts and stops [px] of middles and halves of a row's spans [half axis], and weights.
[[gnu::noinline]] void lengthen(Ends& ends, Array<const float, 2> numbers, Part columns, int dy) {
    float *__restrict starts = ends.start.data(), *__restrict stops = ends.stop.data(),
                     *__restrict weights = ends.weight.data();
    const float *axes = numbers.at(kAxis, columns.first), *along = numbers.at(kAlong, columns.first),
                *down = numbers.at(kDown, columns.first), *sizes = numbers.at(kSpan, columns.first);
    const float rows = static_cast<float>(dy);
    for (int x = 0; x < columns.count(); ++x) {
        const float middle = axes[x] * starts[x], half = axes[x] * stops[x];
        const float even = 1.0f + rows * down[x] + along[x] * middle;
        // the light of a span grows along it: an even one of the same light lies off a little
        const float first = 0.5f + middle + along[x] * half * half * (1.0f / 3.0f) - half;
        const float weight = sizes[x] * even;
        starts[x] = first;
        stops[x] = first + half + half;
        weights[x] = half > 0.0f ? weight : 0.0f;
    }
}

// Red, green, blue, alpha and weight of a column, as differences to the one before: a running sum makes
// light of them. What counts one column on lies apart, so that neighbours do not wait for each other's sums.
struct alignas(64) Difference {
    Float8 here, further;
};

// One end of each span of a row: its column in the buffer of differences, and how much of it falls on the
// next.
struct Split {
    std::vector<int> columns;
    std::vector<float> parts;

    explicit Split(int width) : columns(width), parts(width) {}

    void take(const float* __restrict ends, const float* __restrict weights, int first, int count) {
        int* __restrict column = columns.data();
        float* __restrict part = parts.data();
        for (int x = 0; x < count; ++x) {
            const float whole = std::floor(ends[x]);
            column[x] = first + x + static_cast<int>(whole);
            part[x] = weights[x] * (ends[x] - whole);
        }
    }
};

// Adds spans of a row to differences, in which the row's first column lies at `edge`.
[[gnu::noinline]] void add_spans(Difference* sums, const Ends& ends, const float* rgba, Part columns,
                                 int edge, Split& starts, Split& stops) {
    const int count = columns.count();
    starts.take(ends.start.data(), ends.weight.data(), edge + columns.first, count);
    stops.take(ends.stop.data(), ends.weight.data(), edge + columns.first, count);
    const float* __restrict weights = ends.weight.data();
    const int* __restrict first = starts.columns.data(), * __restrict last = stops.columns.data();
    const float* __restrict past_first = starts.parts.data(), * __restrict past_last = stops.parts.data();
    const float* __restrict pixels = rgba + 4 * columns.first;
    for (int i = 0; i < count; ++i) {
        if (weights[i] == 0.0f) continue;
        const Float8 light =
            __builtin_shufflevector(load<Float4>(pixels + 4 * i), Float4{1.0f}, 0, 1, 2, 3, 4, 5, 6, 7);
        sums[first[i]].here += (weights[i] - past_first[i]) * light;
        sums[first[i]].further += past_first[i] * light;
        sums[last[i]].here -= (weights[i] - past_last[i]) * light;
        sums[last[i]].further -= past_last[i] * light;
    }
}

// Runs the sums of a row, in double precision, into `sums` (width, 5), `start` in the buffer.
[[gnu::noinline]] void finish(const Difference* ends, int start, float* sums, int width) {
    Double4 light{};
    double weight = 0.0;
    for (int i = 1; i < start + width; ++i) {
        const auto here = load<Float4>(&ends[i].here), before = load<Float4>(&ends[i - 1].further);
        light += __builtin_convertvector(here, Double4) + __builtin_convertvector(before, Double4);
        weight += static_cast<double>(ends[i].here[4]) + static_cast<double>(ends[i - 1].further[4]);
        if (i >= start) {
            store(sums, __builtin_convertvector(light, Float4));
            sums[4] = static_cast<float>(weight);
            sums += 5;
        }
    }
}

// Adds a row of the next coarser level, interpolated between its pixels, to `sums` (width, 5); `y` is the
// row from the start of the sums, `line` scratch (columns, 5).
[[gnu::noinline]] void add_coarse(const Coarse& coarse, float* __restrict line, int y, float* __restrict sums,
                                  int width) {
    const int row = y - coarse.row, near = row >> 1, far = row & 1 ? near + 1 : near - 1;
    const float *one = coarse.sums.at(near), *other = coarse.sums.at(far);
    for (int i = 0; i < 5 * coarse.sums.shape[1]; ++i) line[i] = 0.25f * (0.75f * one[i] + 0.25f * other[i]);
    for (int x = 0; x < width; ++x) {
        const int column = x - coarse.column, here = column >> 1;
        const int beside = column & 1 ? here + 1 : here - 1;
        const float *first = line + 5 * here, *second = line + 5 * beside;
        float* to = sums + 5 * x;
        const float weight = to[4] + 0.75f * first[4] + 0.25f * second[4];
        store(to, load<Float4>(to) + 0.75f * load<Float4>(first) + 0.25f * load<Float4>(second));
        to[4] = weight;
    }
}

// Sums of a row's stamps: five planes, `edge` columns on either side.
struct Spots {
    std::vector<float> planes;
    int length, edge;

    Spots(int width, int edge)
        : planes(5 * (width + 2 * std::size_t(edge))), length(width + 2 * edge), edge(edge) {}
};

// Room for a row of pixels that are stamped: a plane for each colour, alpha, weights, what tables give.
struct Stamped {
    std::vector<float> colours[4], weights, tables;

    explicit Stamped(int width) : weights(width), tables(width) {
        for (auto& plane : colours) plane.resize(width);
    }
};

[[gnu::noinline]] void weigh_stamps(const float* __restrict tables, Array<const float, 2> numbers,
                                    Part columns, float across, float rows, float* __restrict weights) {
    const float *along = numbers.at(kAlong, columns.first), *down = numbers.at(kDown, columns.first),
                *size = numbers.at(kStamp, columns.first);
    for (int x = 0; x < columns.count(); ++x) {
        const float even = 1.0f + across * along[x] + rows * down[x];
        weights[x] = std::max(tables[x] * size[x] * even, 0.0f);
    }
}

[[gnu::noinline]] void add_product(float* __restrict sums, const float* __restrict one,
                                   const float* __restrict other, int count) {
    for (int x = 0; x < count; ++x) sums[x] += one[x] * other[x];
}

// Adds what stamps of a row, which reach `reach` columns, give to the row of the result `dy` rows below.
void add_stamps(Spots& spots, const float* rgba, Array<const float, 2> numbers, const Discs& discs,
                Part columns, int reach, int dy, Stamped& room) {
    const int begin = columns.first, count = columns.count();
    for (int c = 0; c < 4; ++c) {
        for (int x = 0; x < count; ++x) room.colours[c][x] = rgba[4 * (begin + x) + c];
    }
    for (int dx = discs.round() ? 0 : -reach; dx <= reach; ++dx) {  // round: as far to either side
        look_up(numbers.at(kStampRadius, begin), count, discs.stamp(dy, dx), room.tables.data());
        for (int side = 0; side < (dx > 0 && discs.round() ? 2 : 1); ++side) {
            const int column = side ? -dx : dx;
            weigh_stamps(room.tables.data(), numbers, columns, static_cast<float>(column),
                         static_cast<float>(dy), room.weights.data());
            float* spot = spots.planes.data() + spots.edge + begin + column;
            for (const auto& plane : room.colours) {
                add_product(spot, room.weights.data(), plane.data(), count);
                spot += spots.length;
            }
            for (int x = 0; x < count; ++x) spot[x] += room.weights[x];
        }
    }
}

// Adds the sums of a row's stamps to `sums` (width, 5), `start` in the buffer.
[[gnu::noinline]] void add_to_sums(const Spots& spots, int start, float* __restrict sums, int width) {
    for (int x = 0; x < width; ++x) {
        const float* spot = spots.planes.data() + start + x;
        for (int c = 0; c < 5; ++c, spot += spots.length) sums[5 * x + c] += *spot;
    }
}

// How far each row of a level's pixels reaches, see `levels.Level.rows`.
struct Rows {
    Array<const std::int32_t, 2> numbers;

    int reach(int row) const { return numbers(0, row); }
    Part columns(int row) const { return {numbers(1, row), numbers(2, row)}; }
    int stamp_reach(int row) const { return numbers(3, row); }
    int stamp_width(int row) const { return numbers(4, row); }
    Part stamp_columns(int row) const { return {numbers(5, row), numbers(6, row)}; }

    int furthest() const {
        int most = -1;
        for (int row = 0; row < numbers.shape[1]; ++row)
            most = std::max({most, reach(row), stamp_reach(row)});
        return most;
    }
};

Part within(Part one, Part other) {
    return {std::max(one.first, other.first), std::min(one.last, other.last)};
}

// `largest` is no less than any span's half axis [px]; `origin` is where in the light `sums` start, whose
// rows may lie apart.
void scatter_rows(Light light, Array<const std::int32_t, 2> of_rows, const Discs& discs, Reached reached,
                  Coarse coarse, double largest, float rim, Strided<float, 3> sums, Place origin, Band band) {
    const Rows rows{of_rows};
    const int height = light.rgba.shape[0], width = light.rgba.shape[1], out_width = sums.shape[1];
    const int stamp_columns = discs.stamp_columns(), furthest = rows.furthest();
    const double across = std::max(largest * discs.outer * 1.2, static_cast<double>(stamp_columns)) + 2.0;
    const int edge = static_cast<int>(std::ceil(across)) + 1;
    std::vector<Difference> differences(width + 2 * static_cast<std::size_t>(edge));
    Split starts(width), stops(width);
    Spots spots(width, edge);
    Ends ends(width);
    Stamped room(width);
    std::vector<float> line(5 * static_cast<std::size_t>(coarse.sums.shape[1]));
    for (int y = band.begin; y < band.end; ++y) {
        const int here = y + origin.row;
        float* sum = sums.at(y);
        if (reached.first(here) > reached.last(here)) {
            std::fill_n(sum, 5 * out_width, 0.0f);
            continue;
        }
        const Part near{static_cast<int>(reached.first(here) - across),
                        static_cast<int>(reached.last(here) + across) + 1};
        bool with_spans = false, with_stamps = false;
        const int stop = std::min(height, here + furthest + 1);
        for (int source = std::max(0, here - furthest); source < stop; ++source) {
            const int dy = here - source;
            const Array<const float, 2> numbers{light.numbers.at(source), {light.numbers.shape[1], width}};
            const float* rgba = light.rgba.at(source);
            const Part part = within(rows.columns(source), near);
            const Part stamped = within(rows.stamp_columns(source), near);
            if (part.count() > 0 && std::abs(dy) <= std::min(rows.reach(source), discs.span_rows())) {
                if (!with_spans) std::fill(differences.begin(), differences.end(), Difference{});
                with_spans = true;
                look_spans_up(ends, numbers, discs, part, dy);
                if (rim > 0.0f) cut_spans(ends, numbers, part, dy, rim, static_cast<float>(discs.aspect));
                lengthen(ends, numbers, part, dy);
                add_spans(differences.data(), ends, rgba, part, edge, starts, stops);
            }
            if (stamped.count() > 0 &&
                std::abs(dy) <= std::min(rows.stamp_reach(source), discs.stamp_rows())) {
                if (!with_stamps) std::fill(spots.planes.begin(), spots.planes.end(), 0.0f);
                with_stamps = true;
                add_stamps(spots, rgba, numbers, discs, stamped,
                           std::min(rows.stamp_width(source), stamp_columns), dy, room);
            }
        }
        const int first = edge + origin.column;
        if (with_spans) {
            finish(differences.data(), first, sum, out_width);
        } else {
            std::fill_n(sum, 5 * out_width, 0.0f);
        }
        if (with_stamps) add_to_sums(spots, first, sum, out_width);
        if (!line.empty()) add_coarse(coarse, line.data(), y, sum, out_width);
    }
}

}  // namespace

void bind_scatter(nanobind::module_& module) {
    module.def("scatter_rows", &scatter_rows, Unlocked());
}

}  // namespace nlens

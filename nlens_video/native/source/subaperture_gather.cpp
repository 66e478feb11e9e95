// Gather blur of one aperture view, in depth order: `kernels/scatter/subaperture_gather.py`.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "module.h"
#include "vectors.h"

namespace nlens {
namespace {

enum PlaneOf { kLight, kRadius = 4, kShare, kCoc, kPlanes };

constexpr int kTile = 16;  // columns that share a bound, more than any disc reaches across [px]
constexpr int kLanes = sizeof(Floats) / sizeof(float);  // columns that are gathered at a time
constexpr float kNowhere = -1e9f;                       // CoC of what is not there: behind everything

// Where the planes start in the view, and how many columns discs reach.
struct Start {
    int row, column, across;
    static constexpr auto fields = std::tuple{&Start::row, &Start::column, &Start::across};
};

// How many rows and columns discs reach.
struct Reach {
    int down, across;
    static constexpr auto fields = std::tuple{&Reach::down, &Reach::across};
};

float look_up(Array<const float, 2> table, int row, int entry, float part) {
    const float low = table(row, entry);
    return low + part * (table(row, entry + 1) - low);
}

// Fills in the planes (h, 7, w) around the target: light, radius, share of the sum, CoC. Where
// nothing is, it spreads nothing. `widest` gets the largest radius of each tile of a row (h, tiles + 2),
// one more on each side; `steps` are entries of the table per pixel of radius.
void lay_out(Array<const float, 3> light, Array<const bool, 2> covered, Array<const float, 2> coc_px,
             Array<const float, 2> table, float steps, const Start& start, Array<float, 3> planes,
             Array<float, 2> widest) {
    const int width = planes.shape[2];
    for (int y = 0; y < planes.shape[0]; ++y) {
        const int row = y + start.row;
        float* of_row = planes.at(y);
        std::fill_n(of_row, kCoc * width, 0.0f);
        std::fill_n(of_row + kCoc * width, width, kNowhere);
        std::fill_n(widest.at(y), widest.shape[1], 0.0f);
        if (row < 0 || row >= covered.shape[0]) continue;
        const int last = std::min(width, covered.shape[1] - start.column);
        for (int x = std::max(0, -start.column); x < last; ++x) {
            const int column = x + start.column;
            if (!covered(row, column)) continue;
            const float* from = light.at(row, column);
            for (int k = 0; k < 4; ++k) of_row[k * width + x] = from[k];
            const float coc = coc_px(row, column), place = std::fabs(coc) * (0.5f * steps);
            const int entry = static_cast<int>(place);
            const float part = place - static_cast<float>(entry), radius = look_up(table, 0, entry, part);
            of_row[kRadius * width + x] = radius;
            of_row[kShare * width + x] = look_up(table, 1, entry, part);
            of_row[kCoc * width + x] = coc;
            float& most = widest(y, (x - start.across + kTile) / kTile);
            most = std::max(most, radius);
        }
    }
}

// How far discs reach that may touch a tile, 0 where there are none [px].
float rim_of(Array<const float, 2> widest, int y, int rows, int tile) {
    float found = 0.0f;
    for (int row = y; row < y + rows; ++row) {
        const float* beside = widest.at(row, tile);
        found = std::max({found, beside[0], beside[1], beside[2]});
    }
    return found > 0.0f ? found + 0.5f : 0.0f;
}

// Light and its weight.
struct Sum {
    Floats r{}, g{}, b{}, a{}, weight{};
};

// Neighbours, the nearest first: by how many numbers of the planes they are away, and how far.
struct Neighbours {
    std::vector<std::ptrdiff_t> offsets;
    const float* distances;

    Neighbours(Array<const std::int32_t, 2> places, Array<const float, 1> distances, int stride)
        : offsets(places.shape[0]), distances(distances.data) {
        for (int k = 0; k < places.shape[0]; ++k) offsets[k] = places(k, 0) * kPlanes * stride + places(k, 1);
    }
};

// Pixels beside each other, as planes of four channels.
void gather_lanes(const float* here, int stride, const Neighbours& around, float rim, float* out) {
    const Floats zero{}, one = zero + 1.0f;
    const Floats mine = load<Floats>(here + kCoc * stride);
    const Floats my_radius = load<Floats>(here + kRadius * stride) + 0.5f;
    const Floats my_share = load<Floats>(here + kShare * stride);
    Sum all, before;  // of them what lies before a pixel
    const std::size_t count = around.offsets.size();
    for (std::size_t k = 0; k < count && around.distances[k] < rim; ++k) {
        const float* there = here + around.offsets[k];
        const auto nearer = load<Floats>(there + kCoc * stride) > mine;
        const Floats radius = nearer ? load<Floats>(there + kRadius * stride) + 0.5f : my_radius;
        const Floats share = nearer ? load<Floats>(there + kShare * stride) : my_share;
        Floats covered = radius - around.distances[k];
        covered = covered > zero ? covered : zero;
        covered = covered < one ? covered : one;
        const Floats weight = covered * share;
        const auto add = [&](Floats& sum, Floats& front, Floats value) {
            sum += value;
            front = nearer ? front + value : front;
        };
        add(all.r, before.r, weight * load<Floats>(there));
        add(all.g, before.g, weight * load<Floats>(there + stride));
        add(all.b, before.b, weight * load<Floats>(there + 2 * stride));
        add(all.a, before.a, weight * load<Floats>(there + 3 * stride));
        add(all.weight, before.weight, weight);
    }
    // What lies before is laid over the rest, seen as far as that leaves room.
    const Floats room = one > before.weight ? one - before.weight : zero, rest = all.weight - before.weight;
    Floats behind = rest > zero ? room / rest : zero;
    behind = mine > kNowhere ? behind : zero;
    const Floats scale = one / (before.weight > one ? before.weight : one);
    store(out, scale * before.r + behind * (all.r - before.r));
    store(out + kTile, scale * before.g + behind * (all.g - before.g));
    store(out + 2 * kTile, scale * before.b + behind * (all.b - before.b));
    store(out + 3 * kTile, scale * before.a + behind * (all.a - before.a));
}

// Fills in the target (H, W, 4) from planes that are larger by `reach` on each side.
void gather(Array<const float, 3> planes, Array<const float, 2> widest, const Reach& reach,
            Array<const std::int32_t, 2> places, Array<const float, 1> distances, Array<float, 3> out) {
    const Neighbours around(places, distances, planes.shape[2]);
    const int width = out.shape[1];
    float of_tile[4 * kTile];
    for (int y = 0; y < out.shape[0]; ++y) {
        for (int first = 0; first < width; first += kTile) {
            const float rim = rim_of(widest, y, 2 * reach.down + 1, first / kTile);
            const float* here = planes.at(y + reach.down, 0, first + reach.across);
            for (int lane = 0; lane < kTile; lane += kLanes)
                gather_lanes(here + lane, planes.shape[2], around, rim, of_tile + lane);
            for (int x = 0; x < std::min(kTile, width - first); ++x) {
                float* to = out.at(y, first + x);
                for (int c = 0; c < 4; ++c) to[c] = of_tile[c * kTile + x];
            }
        }
    }
}

}  // namespace

void bind_subaperture_gather(nanobind::module_& module) {
    module.attr("GATHERED_COLUMNS") = kTile;
    module.attr("GATHERED_PLANES") = static_cast<int>(kPlanes);
    module.def("lay_out", &lay_out, Unlocked());
    module.def("gather", &gather, Unlocked());
}

}  // namespace nlens

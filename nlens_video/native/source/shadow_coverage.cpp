// Coverage of the screen by triangles, eight projections at a time: `effects/shadow/coverage.py`.
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "module.h"
#include "shadow_triangles.h"
#include "vectors.h"

namespace nlens {
namespace {

constexpr int kLanes = 8;             // projections at a time
constexpr int kPerPixel = 256;        // subpixel positions [1 / px]
constexpr double kFarthest = 0x1p15;  // from the first pixel: beyond that products are not exact [px]
constexpr double kNowhere = 0x1p16;   // column of a vertex that is behind the camera or farther [px]
constexpr std::int32_t kNowhereSubpixel = static_cast<std::int32_t>(kNowhere) * kPerPixel;
constexpr int kBandNumbers = 1 << 16;  // of the buffer of layers, which stays in the cache

using Int4 = std::int32_t __attribute__((vector_size(16)));
using Int8 = std::int32_t __attribute__((vector_size(32)));
using Long4 = std::int64_t __attribute__((vector_size(32)));
using Byte4 = std::int8_t __attribute__((vector_size(4)));
using Byte8 = std::int8_t __attribute__((vector_size(8)));

struct Mesh {
    Array<const double, 2> vertices;  // (V, 3 or more)
    Array<const std::int32_t, 2> faces, edges;
    static constexpr auto fields = std::tuple{&Mesh::vertices, &Mesh::faces, &Mesh::edges};
};

// The bits (n,) that projections set, their matrices (n, 3, 4) and places of samples (n, 2).
struct Projections {
    Array<const std::uint8_t, 1> marks;
    Array<const double, 3> matrices;
    Array<const double, 2> at;
    static constexpr auto fields = std::tuple{&Projections::marks, &Projections::matrices, &Projections::at};

    SamplePlace place(int lane) const { return {at(lane, 0), at(lane, 1)}; }

    Homogeneous project(int lane, const double* vertex) const {
        const auto row = [&](int k) {
            const double* m = matrices.at(lane, k);
            return (m[0] * vertex[0] + m[1] * vertex[1] + m[2] * vertex[2]) + m[3];
        };
        return {row(0), row(1), row(2)};
    }
};

// Buffers: columns and rows of the vertices (V, 2, 8) [subpixel], and how triangles are wound (T + 1, 8).
struct Room {
    Array<std::int32_t, 3> places;
    Array<std::int8_t, 2> signs;
    static constexpr auto fields = std::tuple{&Room::places, &Room::signs};
};

// Half of the lanes of a matrix.
struct Matrices {
    Double4 rows[3][4], column, row;

    Matrices(const Projections& projections, int first) {
        for (int lane = 0; lane < 4; ++lane) {
            const int number = std::min(first + lane, projections.marks.shape[0] - 1);
            for (int i = 0; i < 12; ++i)
                rows[i / 4][i % 4][lane] = projections.matrices(number, i / 4, i % 4);
            column[lane] = projections.at(number, 0);
            row[lane] = projections.at(number, 1);
        }
    }

    Double4 product(int k, const double* vertex) const {
        return (rows[k][0] * vertex[0] + rows[k][1] * vertex[1] + rows[k][2] * vertex[2]) + rows[k][3];
    }
};

// `floor(value * kPerPixel + 0.5)`.
inline Int4 to_subpixels(Double4 value) {
    const Double4 exact = value * static_cast<double>(kPerPixel) + 0.5;
    const Int4 whole = __builtin_convertvector(exact, Int4);
    const Long4 beyond = __builtin_convertvector(whole, Double4) > exact;  // -1 where it is the one above
    return whole + __builtin_convertvector(beyond, Int4);
}

// Projects vertices for the first one or two halves of the lanes; whether all of them lie before the
// camera and not too far away.
template <int Halves>
[[gnu::noinline]] bool place(const Mesh& mesh, const Projections& projections,
                             Array<std::int32_t, 3> places) {
    const Matrices halves[] = {{projections, 0}, {projections, 4}};
    Long4 all = Long4{} - 1;
    for (int v = 0; v < mesh.vertices.shape[0]; ++v) {
        const double* vertex = mesh.vertices.at(v);
        std::int32_t* to = places.at(v);
        for (int half = 0; half < Halves; ++half) {
            const Matrices& matrix = halves[half];
            const Double4 w = matrix.product(2, vertex), scale = 1.0 / w;
            const Double4 x = matrix.product(0, vertex) * scale - matrix.column;
            const Double4 y = matrix.product(1, vertex) * scale - matrix.row;
            const Long4 seen =
                (w > 0.0) & (x < kFarthest) & (x > -kFarthest) & (y < kFarthest) & (y > -kFarthest);
            all &= seen;
            store(to + 4 * half, to_subpixels(seen ? x : Double4{} + kNowhere));
            store(to + kLanes + 4 * half, to_subpixels(seen ? y : Double4{}));
        }
    }
    return (all[0] & all[1] & all[2] & all[3]) != 0;
}

// How triangles are wound in each projection, 0 without area and in lanes that are not used.
template <int Halves>
[[gnu::noinline]] void turn(const Mesh& mesh, const Room& room) {
    for (int t = 0; t < mesh.faces.shape[0]; ++t) {
        const std::int32_t* face = mesh.faces.at(t);
        const std::int32_t *a = room.places.at(face[0]), *b = room.places.at(face[1]),
                           *c = room.places.at(face[2]);
        if (Halves == 1) store(room.signs.at(t, 4), Byte4{});
        for (int half = 0; half < Halves; ++half, a += 4, b += 4, c += 4) {
            const Int4 x = load<Int4>(a), y = load<Int4>(a + kLanes);
            const auto from = [](Int4 start, const std::int32_t* end) {
                return __builtin_convertvector(load<Int4>(end) - start, Double4);
            };
            // exact: the products are integers below 2^53
            const Double4 area = from(x, b) * from(y, c + kLanes) - from(y, b + kLanes) * from(x, c);
            const Float4 sign = __builtin_convertvector(area, Float4);
            const Int4 found = (sign < 0.0f) - (sign > 0.0f);
            store(room.signs.at(t, 4 * half), __builtin_convertvector(found, Byte4));
        }
    }
}

// An edge that crosses rows of samples, downwards, in one projection [subpixel].
struct Crossing {
    std::int32_t x, y, across, down;
    std::int8_t weight, lane;

    // The first row of samples not above a subpixel row.
    static int row_at(int y) { return (y + kPerPixel - 1) >> 8; }
};

// Collects edges that change the number of layers: those that are no edge between two triangles
// wound alike, and that cross a row of samples; only in lanes with a mark.
[[gnu::noinline]] std::vector<Crossing> crossings(const Mesh& mesh, const Room& room, Byte8 marks,
                                                  int height) {
    std::vector<Crossing> found;
    const int none = mesh.faces.shape[0];
    const Int8 last = Int8{} + height;
    const auto rows_of = [&](const std::int32_t* place) {
        const Int8 row = (load<Int8>(place + kLanes) + (kPerPixel - 1)) >> 8;
        const Int8 below = row > 0 ? row : Int8{};
        return below < last ? below : last;
    };
    for (int e = 0; e < mesh.edges.shape[0]; ++e) {
        const std::int32_t* edge = mesh.edges.at(e);
        const std::int8_t* one = room.signs.at(edge[2]);
        const std::int8_t* other = room.signs.at(edge[3] >= 0 ? edge[3] : none);
        if (load<std::uint64_t>(one) == load<std::uint64_t>(other)) continue;
        const std::int32_t *start = room.places.at(edge[0]), *end = room.places.at(edge[1]);
        const Int8 crosses = rows_of(start) != rows_of(end);
        const Byte8 weight = load<Byte8>(one) - load<Byte8>(other);
        const Byte8 drawn = __builtin_convertvector(crosses, Byte8) & (weight != 0) & (marks != 0);
        for (auto left = std::bit_cast<std::uint64_t>(drawn); left != 0;) {
            const int lane = std::countr_zero(left) / 8;
            left &= ~(std::uint64_t{0xFF} << (8 * lane));
            const std::int32_t *upper = start + lane, *lower = end + lane;
            std::int8_t sign = weight[lane];
            if (upper[kLanes] > lower[kLanes]) {
                std::swap(upper, lower);
                sign = static_cast<std::int8_t>(-sign);
            }
            found.push_back({upper[0], upper[kLanes], lower[0] - upper[0], lower[kLanes] - upper[kLanes],
                             sign, static_cast<std::int8_t>(lane)});
        }
    }
    return found;
}

// The change of the number of layers (rows, width + 1, 8) from column to column in some rows.
struct Layers {
    int first, last, width;  // rows, the last one not included
    std::vector<std::int32_t> changes;
    std::vector<std::uint64_t> changed;  // a bit for each column with a change (rows, words)

    Layers(int rows, int columns)
        : first(0),
          last(0),
          width(columns),
          changes(static_cast<std::size_t>(rows) * (columns + 1) * kLanes),
          changed(static_cast<std::size_t>(rows) * words()) {}

    int words() const { return width / 64 + 1; }

    std::int32_t* at(int row, int column) {
        return &changes[(static_cast<std::size_t>(row - first) * (width + 1) + column) * kLanes];
    }

    std::uint64_t* changed_in(int row) { return &changed[static_cast<std::size_t>(row - first) * words()]; }
};

[[gnu::noinline]] void draw(const Crossing& edge, Layers& layers) {
    const int first = std::max(layers.first, Crossing::row_at(edge.y));
    const int last = std::min(layers.last, Crossing::row_at(edge.y + edge.down));
    const auto x = static_cast<std::int64_t>(edge.x), down = static_cast<std::int64_t>(edge.down);
    for (int row = first; row < last; ++row) {
        // the quotient of integers as small as these is never rounded up to an integer
        const std::int64_t below = static_cast<std::int64_t>(row) * kPerPixel - edge.y;
        const double place =
            static_cast<double>(x * down + edge.across * below) / static_cast<double>(down * kPerPixel);
        const int column =
            static_cast<int>(std::min(std::max(std::ceil(place), 0.0), static_cast<double>(layers.width)));
        layers.at(row, column)[edge.lane] -= edge.weight;
        layers.changed_in(row)[column / 64] |= std::uint64_t{1} << (column % 64);
    }
}

// Marks pixels with at least one layer, run by run between changes, and clears the changes.
[[gnu::noinline]] void sum(Array<std::uint8_t, 2> bits, Byte8 marks, Layers& layers) {
    for (int row = layers.first; row < layers.last; ++row) {
        Int8 count{};
        std::uint8_t covering = 0;  // marks of the run
        int start = 0;
        std::uint64_t* words = layers.changed_in(row);
        for (int word = 0; word < layers.words(); ++word) {
            for (std::uint64_t left = std::exchange(words[word], 0); left != 0; left &= left - 1) {
                const int column = 64 * word + std::countr_zero(left);
                if (covering != 0)
                    for (std::uint8_t *at = bits.at(row) + start, *end = bits.at(row) + column; at < end;
                         ++at)
                        *at |= covering;
                std::int32_t* at = layers.at(row, column);
                count += load<Int8>(at);
                store(at, Int8{});
                auto found = std::bit_cast<std::uint64_t>(__builtin_convertvector(count > 0, Byte8) & marks);
                found |= found >> 32, found |= found >> 16, found |= found >> 8;
                covering = static_cast<std::uint8_t>(found);
                start = column;
            }
        }
    }
}

// Marks the coverage of a triangle as far as it lies before the camera.
void fill_crossing(Array<std::uint8_t, 2> bits, std::uint8_t mark, const std::array<Homogeneous, 3>& corners,
                   SamplePlace at) {
    const Extent inside = extent(corners, bits.shape[0], bits.shape[1], at);
    EdgeFunctions edges;
    if (inside.empty() || !edge_functions(corners, edges)) return;
    for (int y = inside.top; y <= inside.bottom; ++y) {
        const auto [first, last] = edges.inside({inside.left, inside.right}, y + at.row, at);
        for (int x = first; x <= last; ++x) bits(y, x) |= mark;
    }
}

// Fills triangles that reach behind the camera one by one; their edges are not drawn.
void fill_those_behind(Array<std::uint8_t, 2> bits, const Mesh& mesh, const Projections& projections,
                       const Room& room) {
    for (int t = 0; t < mesh.faces.shape[0]; ++t) {
        const std::int32_t* face = mesh.faces.at(t);
        for (int lane = 0; lane < projections.marks.shape[0]; ++lane) {
            const auto unseen = [&](int corner) {
                return room.places(face[corner], 0, lane) == kNowhereSubpixel;
            };
            if (!unseen(0) && !unseen(1) && !unseen(2)) continue;
            room.signs(t, lane) = 0;
            const auto corner = [&](int k) { return projections.project(lane, mesh.vertices.at(face[k])); };
            fill_crossing(bits, projections.marks(lane), {corner(0), corner(1), corner(2)},
                          projections.place(lane));
        }
    }
}

void mark_covered(Array<std::uint8_t, 2> bits, const Mesh& mesh, const Projections& projections,
                  const Room& room) {
    const int height = bits.shape[0], width = bits.shape[1];
    const bool few = projections.marks.shape[0] <= kLanes / 2;
    const bool all = (few ? place<1> : place<2>)(mesh, projections, room.places);
    (few ? turn<1> : turn<2>)(mesh, room);
    std::fill_n(room.signs.at(mesh.faces.shape[0]), kLanes, std::int8_t{0});
    if (!all) fill_those_behind(bits, mesh, projections, room);
    Byte8 marks{};
    for (int lane = 0; lane < projections.marks.shape[0]; ++lane)
        marks[lane] = static_cast<std::int8_t>(projections.marks(lane));
    const std::vector<Crossing> edges = crossings(mesh, room, marks, height);
    if (edges.empty()) return;
    const int rows = std::clamp(kBandNumbers / (kLanes * (width + 1)), 1, height);
    Layers layers(rows, width);
    for (int first = 0; first < height; first += rows) {
        layers.first = first, layers.last = std::min(first + rows, height);
        for (const Crossing& edge : edges) draw(edge, layers);
        sum(bits, marks, layers);
    }
}

}  // namespace

void bind_shadow_coverage(nanobind::module_& module) {
    module.attr("PER_PIXEL") = kPerPixel;
    module.attr("PROJECTIONS") = kLanes;
    module.def("mark_covered", &mark_covered, Unlocked());
}

}  // namespace nlens

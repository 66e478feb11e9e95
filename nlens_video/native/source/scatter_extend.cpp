// The scatter's source layer: `kernels/scatter/extend.py`.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include "module.h"
#include "scatter.h"
#include "vectors.h"

namespace nlens {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
constexpr std::int32_t kInfinity = 0x7f800000;  // bits of a size from which on it is not finite

// Fills rows of a silhouette; a value that is not finite makes `largest` NaN.
void survey_layer(Array<const float, 3> rgba, Array<const float, 2> coc_px, Array<std::int32_t, 1> first,
                  Array<std::int32_t, 1> last, Array<float, 1> largest, Band band) {
    const int width = rgba.shape[1];
    for (int y = band.begin; y < band.end; ++y) {
        const float *colours = rgba.at(y), *cocs = coc_px.at(y);
        std::int32_t most_light = 0;
        for (int i = 0; i < 4 * width; ++i) most_light = std::max(most_light, bits_of_size(colours[i]));
        Taken covered;
        for (int x = 0; x < width; ++x)
            covered.take(colours[4 * x + 3] > 0.0f, bits_of_size(cocs[x]), x, width);
        first(y) = covered.first(width), last(y) = covered.last();
        const bool finite = std::max(most_light, covered.most) < kInfinity;
        largest(y) = finite ? size_of_bits(covered.most) : kNan;
    }
}

// Cuts rows of a box at `corner` out: the CoC, NaN where the object is not; `away`: 1 there.
void cut_layer(Array<const float, 3> rgba, Array<const float, 2> coc_px, Place corner, Array<float, 2> coc,
               Array<std::uint8_t, 2> away, Band band) {
    const int width = away.shape[1];
    for (int y = band.begin; y < band.end; ++y) {
        std::fill_n(coc.at(y), width, kNan);
        std::fill_n(away.at(y), width, std::uint8_t{1});
        const int row = y + corner.row;
        if (row < 0 || row >= rgba.shape[0]) continue;
        const int begin = std::max(0, -corner.column), end = std::min(width, rgba.shape[1] - corner.column);
        if (begin >= end) continue;
        const float* colours = rgba.at(row, begin + corner.column);
        const float* cocs = coc_px.at(row, begin + corner.column);
        float* __restrict cut = coc.at(y, begin);
        std::uint8_t* __restrict off = away.at(y, begin);
        for (int i = 0; i < end - begin; ++i) {
            const bool covered = colours[4 * i + 3] > 0.0f;
            cut[i] = covered ? cocs[i] : kNan;
            off[i] = covered ? 0 : 1;
        }
    }
}

// The first covered column of a row of `away` from `x` on, `width` where there is none.
int next_covered(const std::uint8_t* away, int x, int width) {
    const void* found = x < width ? std::memchr(away + x, 0, width - x) : nullptr;
    return found ? static_cast<int>(static_cast<const std::uint8_t*>(found) - away) : width;
}

// Finds row and column (n, 2) of the covered pixel of each label.
void find_places(Array<const std::uint8_t, 2> away, Array<const std::int32_t, 2> labels,
                 Array<std::int32_t, 2> places) {
    const int width = away.shape[1];
    for (int y = 0; y < away.shape[0]; ++y) {
        const std::uint8_t* off = away.at(y);
        for (int x = next_covered(off, 0, width); x < width; x = next_covered(off, x, width)) {
            for (; x < width && off[x] == 0; ++x) {
                std::int32_t* place = places.at(labels(y, x));
                place[0] = y, place[1] = x;
            }
        }
    }
}

// The smaller of the steps to both neighbours, 0 where they disagree; NaN: no neighbour.
float step(float before, float here, float after) {
    const float rise = after - here, fall = here - before;
    const float smaller = std::fabs(rise) < std::fabs(fall) ? rise : fall;
    const float both = rise * fall <= 0.0f ? 0.0f : smaller;
    const float one = std::isnan(fall) ? 0.0f : fall;
    return std::isnan(rise) ? one : std::isnan(fall) ? rise : both;
}

// What becomes a source layer: colours, signed radii and skews.
struct Made {
    Array<float, 3> colours;
    Array<float, 2> radii;
    Array<float, 3> skews;
    static constexpr auto fields = std::tuple{&Made::colours, &Made::radii, &Made::skews};
};

// The largest distance that takes part, the largest radius, and the CoC at which the skew of a disc is half
// in force [px].
struct Limits {
    float distance, radius, fade;
    static constexpr auto fields = std::tuple{&Limits::distance, &Limits::radius, &Limits::fade};
};

// Fills in radii and skews of `count` pixels of a row from their CoCs and those around them; of no meaning
// where the object is not.
[[gnu::noinline]] void lay_out_row(const float* __restrict above, const float* __restrict cocs,
                                   const float* __restrict below, int count, Limits limits,
                                   float* __restrict radii, float* __restrict along_columns,
                                   float* __restrict along_rows) {
    const float fade = limits.fade * limits.fade;
    for (int x = 0; x < count; ++x) {
        const float here = cocs[x];
        radii[x] = std::min(std::max(0.5f * here, -limits.radius), limits.radius);
        const float along = step(cocs[x - 1], here, cocs[x + 1]), down = step(above[x], here, below[x]);
        const float damped =
            here / (here * here + fade) / std::max(1.0f, std::sqrt(along * along + down * down));
        along_columns[x] = along * damped;
        along_rows[x] = down * damped;
    }
}

// Fills in the covered pixels of rows of a source layer. `coc` and `away` are those of `cut_layer`, for a box
// at `corner` whose border no covered pixel touches.
void lay_out_object(Array<const float, 3> rgba, Array<const float, 2> coc, Array<const std::uint8_t, 2> away,
                    const Made& made, Place corner, Limits limits, Band band) {
    const int width = away.shape[1];
    for (int y = band.begin; y < band.end; ++y) {
        std::fill_n(made.colours.at(y), 4 * width, 0.0f);
        const std::uint8_t* off = away.at(y);
        const int begin = next_covered(off, 0, width);
        if (begin == width) continue;
        int end = width;
        while (off[end - 1] != 0) --end;
        const float* colours = rgba.at(y + corner.row, begin + corner.column);
        float* to = made.colours.at(y, begin);
        for (int i = 0; i < end - begin; ++i) {
            if (off[begin + i] == 0) store(to + 4 * i, load<Float4>(colours + 4 * i));
        }
        lay_out_row(coc.at(y - 1, begin), coc.at(y, begin), coc.at(y + 1, begin), end - begin, limits,
                    made.radii.at(y, begin), made.skews.at(0, y, begin), made.skews.at(1, y, begin));
    }
}

// Each pixel's label, the labels' places and the distance to them.
struct Nearest {
    Array<const std::int32_t, 2> labels, places;
    Array<const float, 2> distance;
    static constexpr auto fields = std::tuple{&Nearest::labels, &Nearest::places, &Nearest::distance};
};

// Fills in the other pixels: each spreads as the nearest covered one, once those are filled in.
void lay_out_background(Array<const float, 3> rgba, const Nearest& nearest, Array<const std::uint8_t, 2> away,
                        const Made& made, Place corner, Limits limits, Band band) {
    const int last_row = rgba.shape[0] - 1, last_column = rgba.shape[1] - 1;
    for (int y = band.begin; y < band.end; ++y) {
        const int row = y + corner.row, inner_row = std::clamp(row, 0, last_row);
        const float *colours = rgba.at(inner_row), *distance = nearest.distance.at(y);
        const std::uint8_t* off = away.at(y);
        const std::int32_t* labels = nearest.labels.at(y);
        float *radii = made.radii.at(y), *along = made.skews.at(0, y), *down = made.skews.at(1, y);
        for (int x = 0; x < away.shape[1]; ++x) {
            if (off[x] == 0) continue;
            const int column = x + corner.column, inner_column = std::clamp(column, 0, last_column);
            const bool inside = inner_row == row && inner_column == column;
            const bool hidden = !inside && colours[4 * inner_column + 3] > 0.0f;
            along[x] = down[x] = 0.0f;  // the CoC is extended as a constant
            radii[x] = kNan;
            if (hidden || distance[x] > limits.distance) continue;
            const std::int32_t* place = nearest.places.at(labels[x]);
            radii[x] = made.radii(place[0], place[1]);
        }
    }
}

}  // namespace

void bind_scatter_extend(nanobind::module_& module) {
    module.def("survey_layer", &survey_layer, Unlocked());
    module.def("cut_layer", &cut_layer, Unlocked());
    module.def("find_places", &find_places, Unlocked());
    module.def("lay_out_object", &lay_out_object, Unlocked());
    module.def("lay_out_background", &lay_out_background, Unlocked());
}

}  // namespace nlens

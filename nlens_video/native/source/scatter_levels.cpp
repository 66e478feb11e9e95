// Levels of the scatter's source: `kernels/scatter/levels.py`.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include "module.h"
#include "scatter.h"
#include "vectors.h"

namespace nlens {
namespace {

// Sums of a coarse pixel: premultiplied colour and alpha, mass, radius, signed radius, skew along columns
// and rows; the rest is 0.
constexpr int kSums = 12;

// Radius from which discs go over to the second level [px], and the share of it over which they do.
struct Starts {
    float first, fade;
    static constexpr auto fields = std::tuple{&Starts::first, &Starts::fade};
};

// How discs are split in spans and stamps, see `levels.Rule`.
struct Rule {
    float stamps_px, spans_px;
    double outer;
    float surplus, aspect;
    static constexpr auto fields =
        std::tuple{&Rule::stamps_px, &Rule::spans_px, &Rule::outer, &Rule::surplus, &Rule::aspect};
};

float clamped(float share) {
    return std::min(std::max(share, 0.0f), 1.0f);
}

// How much of a disc is drawn at levels that start at a radius.
float above(float radius, float start, float fade) {
    return clamped((radius - start) / (fade * start));
}

// Colours, signed radii and skews of a layer.
struct Layer {
    Array<const float, 3> rgba;
    Array<const float, 2> radii;
    Array<const float, 3> skews;
    static constexpr auto fields = std::tuple{&Layer::rgba, &Layer::radii, &Layer::skews};
};

// Where the sums of a level lie: the first pixel, columns, column and row at which it starts, and the rows
// from `begin` to before `end` that a band fills.
struct Sums {
    float* first;
    std::int64_t columns, left, top, begin, end;

    float* row(std::int64_t y) const { return first + kSums * columns * (y - top); }
    float* at(std::int64_t y, std::int64_t x) const { return row(y) + kSums * (x - left); }
};

// The pixel of a level before or at the middle of a pixel of the frame, and how far that lies towards the
// next.
struct Between {
    std::int64_t before;
    float part;

    Between(std::int64_t at, int level) {
        const std::int64_t size = std::int64_t{1} << level, twice = 2 * at + 1 - size;  // of half pixels
        before = twice >> (level + 1);
        part = static_cast<float>(twice & (2 * size - 1)) / static_cast<float>(2 * size);
    }
};

void add(float* sums, float share, Float4 light, Float4 disc, Float4 skew) {
    store(sums, load<Float4>(sums) + share * light);
    store(sums + 4, load<Float4>(sums + 4) + share * disc);
    store(sums + 8, load<Float4>(sums + 8) + share * skew);
}

// Adds rows of a layer to the sums (n, kSums) of the coarser levels that its discs belong to. `places` is of
// each level the first pixel, columns, rows, column and row at which it starts; `corner` where the layer lies
// in the frame. A pixel's light is shared by the four of a level around it, so that its mean place is kept
// and a highlight that moves does not jump. Bands begin at rows of the coarsest level.
void gather_levels(Layer layer, Array<float, 2> all, Array<const std::int64_t, 2> places, Place corner,
                   Starts starts, Band band) {
    const int last = places.shape[0], height = layer.radii.shape[0];
    std::vector<Sums> sums(last + 1);  // by level, none of the finest
    for (int level = 1; level <= last; ++level) {
        const std::int64_t *place = places.at(level - 1), top = place[4];
        const std::int64_t begin = band.begin == 0 ? top : (band.begin + corner.row) >> level;
        const std::int64_t end = band.end == height ? top + place[2] : (band.end + corner.row) >> level;
        sums[level] = {all.data + kSums * place[0], place[1], place[3], top, begin, end};
        std::fill(sums[level].row(begin), sums[level].row(end), 0.0f);
    }
    const int beside =
        1 << (last - 1);  // rows of other bands that reach into the coarsest level's of this one
    for (int y = std::max(band.begin - beside, 0); y < std::min(band.end + beside, height); ++y) {
        for (int x = 0; x < layer.radii.shape[1]; ++x) {
            const float signed_radius = layer.radii(y, x), radius = std::fabs(signed_radius);
            if (!(radius > starts.first)) continue;
            int level = 1;
            float begun = starts.first;
            for (; level < last && radius > begun + begun; ++level) begun += begun;
            const float part = above(radius, begun, starts.fade);
            const Float4 light = load<Float4>(layer.rgba.at(y, x));
            const Float4 disc{1.0f, radius, signed_radius, layer.skews(0, y, x)};
            const Float4 skew{layer.skews(1, y, x), 0.0f, 0.0f, 0.0f};
            const auto share = [&](int n, float amount) {
                const Sums& of_level = sums[n];
                const Between down(y + corner.row, n), across(x + corner.column, n);
                const float shares[2] = {amount * (1.0f - down.part), amount * down.part};
                for (int below = 0; below < 2; ++below) {
                    const std::int64_t row = down.before + below;
                    if (row < of_level.begin || row >= of_level.end) continue;
                    float* here = of_level.at(row, across.before);
                    add(here, shares[below] * (1.0f - across.part), light, disc, skew);
                    add(here + kSums, shares[below] * across.part, light, disc, skew);
                }
            };
            share(level, part);
            if (level > 1 && part < 1.0f) share(level - 1, 1.0f - part);
        }
    }
}

// Which pixels of a row are drawn with weights that are not 0.
[[gnu::noinline]] Taken find_drawn(const float* weights, const float* radii, int width) {
    Taken drawn;
    for (int x = 0; x < width; ++x) drawn.take(weights[x] != 0.0f, bits_of_size(radii[x]), x, width);
    return drawn;
}

constexpr float kLeast = 1e-6f;  // square of a fitted half axis [px^2]

// Splits masses of a row's discs, which are in `spans`, in spans and stamps by their radius.
[[gnu::noinline]] void split(const float* __restrict radii, int width, const Rule& rule,
                             float* __restrict axes, float* __restrict spans, float* __restrict stamps) {
    const float start = rule.stamps_px, fade = rule.spans_px - rule.stamps_px;
    const float surplus = rule.surplus, aspect = rule.aspect;
    for (int x = 0; x < width; ++x) {
        const float mass = spans[x], radius = std::fabs(radii[x]), upright = radius * aspect;
        const float as_span = clamped((radius - start) / fade);
        // no branches, and no roots of less than nothing where the disc is a stamp alone
        const float across = std::sqrt(std::max(radius * radius - surplus, kLeast));
        const float down = std::sqrt(std::max(upright * upright - surplus, kLeast));
        axes[x] = as_span > 0.0f ? across : 0.0f;
        spans[x] = mass * as_span / (std::numbers::pi_v<float> * across * down);
        stamps[x] = mass * (1.0f - as_span);
    }
}

int reach(double half_axis) {
    return static_cast<int>(std::ceil(half_axis - 0.5));
}

// Splits the mass of a row's pixels, which is in `kSpan`, in span and stamp, and finds how far they reach.
void weigh(Array<float, 3> of_level, Array<std::int32_t, 2> rows, int y, const Rule& rule) {
    const int width = of_level.shape[2];
    const float* radii = of_level.at(y, kRadius);
    float *spans = of_level.at(y, kSpan), *stamps = of_level.at(y, kStamp);
    std::copy_n(radii, width, of_level.at(y, kStampRadius));
    split(radii, width, rule, of_level.at(y, kAxis), spans, stamps);
    const Taken with_spans = find_drawn(spans, radii, width), with_stamps = find_drawn(stamps, radii, width);
    const float most = size_of_bits(with_spans.most), most_stamp = size_of_bits(with_stamps.most);
    rows(0, y) = with_spans.last() >= 0 ? reach(most * rule.outer * rule.aspect) : -1;
    rows(1, y) = with_spans.first(width), rows(2, y) = with_spans.last();
    const int least = most_stamp == 0.0f ? 0 : 1;
    // a small disc is larger than its radius, by `disc.fitted_radii`
    float stamp = std::max(most_stamp, 0.5f + 0.25f * most_stamp);
    // and a picture's is drawn between tables an eighth of a pixel apart
    if (rule.outer > 1.0) stamp += 0.125f;
    rows(3, y) = with_stamps.last() >= 0 ? std::max(least, reach(stamp * rule.outer * rule.aspect)) : -1;
    rows(4, y) = std::max(least, reach(stamp * rule.outer));
    rows(5, y) = with_stamps.first(width), rows(6, y) = with_stamps.last();
}

// Fills rows of the first level from a layer's signed radii and skews.
void fill_fine_level(Array<const float, 2> radii, Array<const float, 3> skews, Array<float, 3> numbers,
                     Array<std::int32_t, 2> rows, const Rule& rule, Starts starts, Band band) {
    const int width = radii.shape[1];
    for (int y = band.begin; y < band.end; ++y) {
        const float* of_row = radii.at(y);
        float* __restrict masses = numbers.at(y, kSpan);
        float* __restrict drawn = numbers.at(y, kRadius);
        for (int x = 0; x < width; ++x) {
            const float radius = of_row[x];
            const float mass =
                std::isnan(radius) ? 0.0f : 1.0f - above(std::fabs(radius), starts.first, starts.fade);
            masses[x] = mass;
            drawn[x] = mass > 0.0f ? radius : 0.0f;
        }
        std::copy_n(skews.at(0, y), width, numbers.at(y, kAlong));
        std::copy_n(skews.at(1, y), width, numbers.at(y, kDown));
        weigh(numbers, rows, y, rule);
    }
}

// Fills rows of a level of pixels `size` times as large, from its sums (h, w, kSums).
void fill_coarse_level(Array<const float, 3> sums, Array<float, 3> rgba, Array<float, 3> numbers,
                       Array<std::int32_t, 2> rows, const Rule& rule, int size, Band band) {
    // sharing light between pixels, and interpolating between them, spreads it already: by a variance of
    // (1 + 1 / (2 size^2)) / 6 and of (1 - 1 / size^2) / 4 along each axis, a disc's being radius^2 / 4
    const float spread = static_cast<float>(5.0 / 3.0 - 2.0 / 3.0 / (double(size) * size));
    const float scale = static_cast<float>(size);
    for (int y = band.begin; y < band.end; ++y) {
        for (int x = 0; x < rgba.shape[1]; ++x) {
            const float* here = sums.at(y, x);
            const float whole = std::max(here[4], 1e-30f);
            store(rgba.at(y, x), load<Float4>(here) / whole);
            float mean = here[5] / (whole * scale);
            mean = std::sqrt(std::max(mean * mean - spread, 0.0f));
            numbers(y, kRadius, x) = here[6] >= 0.0f ? mean : -mean;
            numbers(y, kSpan, x) = here[4];
            numbers(y, kAlong, x) = scale * here[7] / whole;
            numbers(y, kDown, x) = scale * here[8] / whole;
        }
        weigh(numbers, rows, y, rule);
    }
}

}  // namespace

void bind_scatter_levels(nanobind::module_& module) {
    module.def("gather_levels", &gather_levels, Unlocked());
    module.def("fill_fine_level", &fill_fine_level, Unlocked());
    module.def("fill_coarse_level", &fill_coarse_level, Unlocked());
}

}  // namespace nlens

// Discs of confusion by their radius, and what the lens barrel leaves of them: `kernels/scatter/scatter.py`.
//
// Tables are read in loops apart from arithmetic, over rows of one number each: only so does the compiler
// take several pixels at once.
#include "scatter_discs.h"

#include <numbers>

#include "module.h"

namespace nlens {

void look_up(const float* __restrict radii, int count, Table table, float* __restrict out) {
    constexpr int kBlock = 64;
    int entries[kBlock];
    float parts[kBlock];
    for (int begin = 0; begin < count; begin += kBlock) {
        const int some = std::min(kBlock, count - begin);
        for (int i = 0; i < some; ++i) {
            const float radius = radii[begin + i];
            const float place = std::min(table.end, std::fabs(radius) * table.per_px);
            const int whole = static_cast<int>(place);
            entries[i] = whole + (radius > 0.0f ? table.turned : 0);
            parts[i] = place - static_cast<float>(whole);
        }
        for (int i = 0; i < some; ++i) {
            const float low = table.entries[entries[i]], high = table.entries[entries[i] + 1];
            out[begin + i] = low + parts[i] * (high - low);
        }
    }
}

void look_spans_up(Ends& ends, Array<const float, 2> numbers, const Discs& discs, Part columns, int dy) {
    const float* radii = numbers.at(kRadius, columns.first);
    look_up(radii, columns.count(), discs.half(dy), ends.stop.data());
    if (discs.round()) {  // all spans lie in the middle
        std::fill_n(ends.start.data(), columns.count(), 0.0f);
    } else {
        look_up(radii, columns.count(), discs.middle(dy), ends.start.data());
    }
}

void cut_spans(Ends& ends, Array<const float, 2> numbers, Part columns, int dy, float rim, float aspect) {
    float* __restrict middles = ends.start.data(), * __restrict halves = ends.stop.data();
    const float *axes = numbers.at(kAxis, columns.first), *barrel_x = numbers.at(kBarrelX, columns.first),
                *barrel_y = numbers.at(kBarrelY, columns.first);
    const float row = static_cast<float>(dy);
    for (int x = 0; x < columns.count(); ++x) {
        const float axis = std::max(axes[x], 1e-6f);
        const float off = (row - barrel_y[x]) / (axis * aspect);
        const float half = std::sqrt(std::max(rim * rim - off * off, 0.0f));
        const float across = barrel_x[x] / axis;
        const float low = std::max(middles[x] - halves[x], across - half);
        const float high = std::min(middles[x] + halves[x], across + half);
        middles[x] = 0.5f * (low + high);
        halves[x] = std::max(0.5f * (high - low), 0.0f);
    }
}

namespace {

// Where a level lies: column and row of its corner from the middle of the frame, and the size of its
// pixels [px].
struct Corner {
    double x, y, pixel;
    static constexpr auto fields = std::tuple{&Corner::x, &Corner::y, &Corner::pixel};
};

// The barrel's centre by distance from the middle [radius / px of the frame's height], and the width of a
// pixel by its height.
struct Barrel {
    double per_px, aspect;
    static constexpr auto fields = std::tuple{&Barrel::per_px, &Barrel::aspect};
};

// Fills in the barrel's centre and the radius of the stamp, which stays round and shrinks to the area that
// the barrel leaves; returns the largest half axis of the row.
float place_barrel(Array<float, 2> numbers, int y, Corner corner, Barrel barrel, double outer) {
    const double down = (corner.y + (y + 0.5) * corner.pixel) * barrel.per_px;
    float furthest = 0.0f;
    for (int x = 0; x < numbers.shape[1]; ++x) {
        const double across = (corner.x + (x + 0.5) * corner.pixel) * barrel.per_px * barrel.aspect;
        const float axis = numbers(kAxis, x), radius = numbers(kRadius, x);
        const double side = radius <= 0.0f ? axis : -axis;
        numbers(kBarrelX, x) = static_cast<float>(side * across);
        numbers(kBarrelY, x) = static_cast<float>(side * down * barrel.aspect);
        const double off = std::min(std::sqrt(across * across + down * down) / outer, 2.0);
        const double area = 2.0 * std::acos(0.5 * off) - 0.5 * off * std::sqrt(4.0 - off * off);
        const double left = std::max(area, 0.0) / std::numbers::pi;  // rounding may leave less than 0
        numbers(kStampRadius, x) = static_cast<float>(radius * std::sqrt(left));
        furthest = std::max(furthest, axis);
    }
    return furthest;
}

// Adds the areas of a row's spans to `areas`.
[[gnu::noinline]] void add_areas(const Ends& ends, Array<const float, 2> numbers, float* __restrict areas) {
    const float* __restrict axes = numbers.at(kAxis), * __restrict halves = ends.stop.data();
    for (int x = 0; x < numbers.shape[1]; ++x) areas[x] += 2.0f * axes[x] * halves[x];
}

// Computes the barrel's centre for rows of a level, and compensates the light that it blocks: weights of
// spans grow.
void vignette_discs(Array<float, 3> of_level, const Discs& discs, Corner corner, Barrel barrel, Band band) {
    const int width = of_level.shape[2];
    const Part all{0, width - 1};
    const float outer = static_cast<float>(discs.outer);
    std::vector<float> whole(width), left(width);
    Ends ends(width);
    for (int y = band.begin; y < band.end; ++y) {
        const Array<float, 2> row{of_level.at(y), {of_level.shape[1], width}};
        const Array<const float, 2> numbers{row.data, {row.shape[0], width}};
        const double furthest = place_barrel(row, y, corner, barrel, discs.outer);
        if (furthest == 0.0) continue;
        std::fill(whole.begin(), whole.end(), 0.0f);
        std::fill(left.begin(), left.end(), 0.0f);
        const int rows =
            std::min(discs.span_rows(), static_cast<int>(std::ceil(furthest * discs.outer * barrel.aspect)));
        for (int dy = -rows; dy <= rows; ++dy) {
            look_spans_up(ends, numbers, discs, all, dy);
            add_areas(ends, numbers, whole.data());
            cut_spans(ends, numbers, all, dy, outer, static_cast<float>(discs.aspect));
            add_areas(ends, numbers, left.data());
        }
        for (int x = 0; x < width; ++x) {
            if (row(kSpan, x) > 0.0f) row(kSpan, x) *= whole[x] / std::max(left[x], 1e-6f);
        }
    }
}

}  // namespace

void bind_scatter_discs(nanobind::module_& module) {
    module.def("vignette_discs", &vignette_discs, Unlocked());
}

}  // namespace nlens

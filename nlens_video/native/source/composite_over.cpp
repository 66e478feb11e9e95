// A layer over samples, in light: `video/pixels/blend.py`.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <tuple>
#include <type_traits>

#include "layer_rows.h"
#include "light_codes.h"
#include "module.h"

namespace nlens {
namespace {

// What the kernel needs to know of the samples' coding.
struct Tables {
    Array<const float, 1> to_linear, to_coded;
    Matrix rgb_from_codes, codes_from_rgb, from_bt709, to_bt709;
    static constexpr auto fields =
        std::tuple{&Tables::to_linear,      &Tables::to_coded,   &Tables::rgb_from_codes,
                   &Tables::codes_from_rgb, &Tables::from_bt709, &Tables::to_bt709};
};

struct Flags {
    bool associated, of_plate;
    static constexpr auto fields = std::tuple{&Flags::associated, &Flags::of_plate};
};

template <class Sample>
Sample sample(float value, float peak) {
    if constexpr (std::is_integral_v<Sample>)
        value = std::floor(std::min(std::max(value, 0.0f), peak) + 0.5f);
    return static_cast<Sample>(value);
}

// Replaces the samples of a row from a column on by values, where they are to be.
template <class Sample>
void put_row(Plane<Sample> plane, int y, int x, const float* __restrict values,
             const std::uint8_t* __restrict replaced, int count, float peak) {
    Sample* __restrict samples = plane.at(y, x);
    const std::ptrdiff_t step = plane.strides[1];
    if (step == 1) {
        for (int k = 0; k < count; ++k)
            samples[k] = replaced[k] ? sample<Sample>(values[k], peak) : samples[k];
    } else {
        for (int k = 0; k < count; ++k) {
            if (replaced[k]) samples[k * step] = sample<Sample>(values[k], peak);
        }
    }
}

// The multiples of `step` from `low` to before `high`, of the first `count`.
Pair lanes(int low, int high, int step, int count) {
    const auto first_from = [step](int x) { return x > 0 ? (x + step - 1) / step : 0; };
    return {first_from(low), std::min(first_from(high), count)};
}

// Light of a row in other primaries.
inline void convert_rows(Matrix matrix, float* const* rows, int count) {
    if (!is_identity(matrix)) apply_rows(matrix, rows, count);
}

constexpr int kBlock = 64;  // coarse samples of a row that are composited at once
using Lane = float[kBlock];

// Pixels under the same tap of the coarse samples of a block.
struct Pixels {
    Lane own[3], alpha;  // the layer
    Lane luma;           // the first component of the plate
    Lane plate[3];       // codes, then coded red, green and blue
    Lane plate_alpha, behind[3];
    std::uint8_t drawn[kBlock];  // where the layer is not empty
    int count;
};

// Adds the plate's light behind the layer to the layer's. The plate's coded red, green and blue are
// given; the light becomes that of the plate's own primaries.
void add_behind(const Tables& tables, Flags flags, Pixels& pixels) {
    const int count = pixels.count;
    Lane free, gain;
    for (int k = 0; k < count; ++k) free[k] = 1.0f - pixels.alpha[k], gain[k] = 1.0f;
    if (!flags.associated) {
        for (int k = 0; k < count; ++k) {
            free[k] *= pixels.plate_alpha[k];
            const float covered = pixels.alpha[k] + free[k];
            gain[k] = covered > 0.0f ? 1.0f / covered : 1.0f;
        }
    }
    float* const own[3] = {pixels.own[0], pixels.own[1], pixels.own[2]};
    for (int c = 0; c < 3; ++c) {
        std::copy_n(pixels.plate[c], count, pixels.behind[c]);
        look_up_row(tables.to_linear, pixels.behind[c], count);
    }
    if (flags.of_plate) {
        Lane light[3];
        float* const rows[3] = {light[0], light[1], light[2]};
        for (int c = 0; c < 3; ++c) std::copy_n(pixels.behind[c], count, light[c]);
        convert_rows(tables.to_bt709, rows, count);
        for (int c = 0; c < 3; ++c) {
            for (int k = 0; k < count; ++k) own[c][k] *= light[c][k];
        }
    }
    convert_rows(tables.from_bt709, own, count);
    for (int c = 0; c < 3; ++c) {
        const float* behind = pixels.behind[c];
        for (int k = 0; k < count; ++k) own[c][k] = (own[c][k] + free[k] * behind[k]) * gain[k];
    }
}

// Replaces the layer's colours by the change of the plate's coded red, green and blue.
void find_changes(const Tables& tables, Flags flags, float peak, Pixels& pixels) {
    const int count = pixels.count;
    float* const plate[3] = {pixels.plate[0], pixels.plate[1], pixels.plate[2]};
    float* const own[3] = {pixels.own[0], pixels.own[1], pixels.own[2]};
    apply_rows(tables.rgb_from_codes, plate, count);
    add_behind(tables, flags, pixels);
    for (int c = 0; c < 3; ++c) {
        float *made = own[c], *was = plate[c];
        look_up_row(tables.to_coded, made, count);
        if (peak > 0.0f) {
            for (int k = 0; k < count; ++k)
                made[k] = std::min(std::max(made[k], std::min(was[k], 0.0f)), std::max(was[k], 1.0f));
        }
        for (int k = 0; k < count; ++k) made[k] -= was[k];
    }
}

// Composites one layer. `kStep`: of the chroma across, where it is known at compile time, else 0.
template <class Sample, int kStep>
class Compositor {
public:
    Compositor(Planes<Sample> planes, Plane<Sample> alpha, Flags flags,
               std::tuple<Array<const Sample, 2>, Array<const Sample, 2>> before, std::tuple<Axis, Axis> axes,
               Pair corner, Array<const float, 3> rgba, const Tables& tables, float peak)
        : planes_(planes),
          alpha_(alpha),
          flags_(flags),
          luma_before_(std::get<0>(before)),
          alpha_before_(std::get<1>(before)),
          across_(std::get<0>(axes)),
          down_(std::get<1>(axes)),
          y0_(std::get<0>(corner)),
          x0_(std::get<1>(corner)),
          rgba_(rgba),
          tables_(tables),
          peak_(peak),
          has_alpha_(alpha.shape[0] > 0),
          taps_(across_.weights.shape[0]),
          row_((kBlock - 1) * step() + std::max(taps_, step()) + std::abs(across_.first)),
          drawn_(rgba, 2 * step() + taps_ + std::abs(across_.first), negligible(flags, peak)) {
        for (int i = 0; i < 3; ++i) std::copy_n(tables.codes_from_rgb.at(i), 3, codes_from_rgb_[i]);
    }

    // Composites rows of coarse samples, which do not depend on each other.
    void run(int from, int to) {
        const auto first_of = [this](int row) { return row * down_.step - down_.phase - y0_; };
        const int reach = std::max(down_.weights.shape[0], down_.step) + std::abs(down_.first);
        drawn_.look_at(first_of(from) - reach, first_of(to) + reach);
        for (int row = from; row < to; ++row) {
            const int top = row * down_.step - down_.phase;
            const auto [first, end] = drawn_.ends(top - y0_, top - y0_ + down_.step);
            if (first >= end) continue;
            const int columns = across_.of(x0_ + end - 1) + 1;
            for (int begin = across_.of(x0_ + first); begin < columns; begin += kBlock)
                composite_block(row, top, begin, std::min(kBlock, columns - begin));
        }
    }

private:
    // The most of the plate's light, as a share of it, of which the codes change by less than half.
    static float negligible(Flags flags, float peak) {
        return flags.of_plate && peak > 0.0f ? 0.5f / peak : 0.0f;
    }

    int step() const { return kStep ? kStep : across_.step; }

    // The coarse samples of a row from `begin` on; `top`: first row of their cells.
    void composite_block(int row, int top, int begin, int count) {
        const auto& [first, second, third] = planes_;
        const int height = first.shape[0], width = first.shape[1], x1 = x0_ + rgba_.shape[1];
        const int left = begin * step() - across_.phase;  // first column of their cells
        if (!find_touched(top, left, count)) return;
        for (int k = 0; k < count; ++k) {
            total_[k] = change_b_[k] = change_c_[k] = 0.0f;
            chroma_b_[k] = number(second(row, begin + k));
            chroma_c_[k] = number(third(row, begin + k));
        }
        pixels_.count = count;
        for (int p = 0; p < down_.weights.shape[0]; ++p) {
            const int y = top + down_.first + p;
            if (y < 0 || y >= height) continue;
            const bool in_box = y0_ <= y && y < y0_ + rgba_.shape[0];
            const bool own_row = top <= y && y < top + down_.step;
            if (in_box) load_row(y, left, count);
            for (int q = 0; q < taps_; ++q) {
                const float weight = down_.weights(p) * across_.weights(q);
                const int tap = across_.first + q, start = left + tap;
                const auto [in_first, in_end] = lanes(-start, width - start, step(), count);
                for (int k = in_first; k < in_end; ++k) total_[k] += weight;
                const auto [k0, k1] = lanes(x0_ - start, x1 - start, step(), count);
                if (in_box && k0 < k1) add_tap(y, q, start, weight, own_row && tap >= 0 && tap < step());
            }
            if (in_box && own_row) write_row(y, left, count);
        }
        for (int k = 0; k < count; ++k) {
            chroma_b_[k] += change_b_[k] / total_[k];
            chroma_c_[k] += change_c_[k] / total_[k];
        }
        put_row(second, row, begin, chroma_b_, touched_, count, peak_);
        put_row(third, row, begin, chroma_c_, touched_, count, peak_);
    }

    // Whether the layer is not empty at any pixel of each coarse sample's cell, and of any cell.
    bool find_touched(int top, int left, int count) {
        std::fill_n(touched_, count, std::uint8_t{0});
        for (int y = std::max(top - y0_, 0); y < std::min(top - y0_ + down_.step, rgba_.shape[0]); ++y) {
            const std::uint8_t* drawn = drawn_.row(y) + (left - x0_);
            for (int s = 0; s < step(); ++s) {
                for (int k = 0; k < count; ++k) touched_[k] |= drawn[k * step() + s];
            }
        }
        return std::find(touched_, touched_ + count, 1) != touched_ + count;
    }

    // The pixels of a row from the first tap of the block on; zero beyond the layer's sides.
    void load_row(int y, int left, int count) {
        const int start = left + across_.first, end = start + (count - 1) * step() + taps_;
        const int from = std::max(start, x0_), to = std::min(end, x0_ + rgba_.shape[1]);
        row_.clear();
        const float* layer = rgba_.at(y - y0_) + 4 * (from - x0_);
        const Sample* luma = luma_before_.at(y - y0_) + (from - x0_);
        float *const red = row_.own(0) + (from - start), *const green = row_.own(1) + (from - start),
                     *const blue = row_.own(2) + (from - start), *const alpha = row_.alpha() + (from - start),
                     *const plate = row_.luma() + (from - start);
        for (int x = 0; x < to - from; ++x) {
            red[x] = layer[4 * x], green[x] = layer[4 * x + 1], blue[x] = layer[4 * x + 2];
            alpha[x] = layer[4 * x + 3];
        }
        for (int x = 0; x < to - from; ++x) plate[x] = number(luma[x]);
        float* const plate_alpha = row_.plate_alpha() + (from - start);
        if (has_alpha_) {
            const Sample* given = alpha_before_.at(y - y0_) + (from - x0_);
            for (int x = 0; x < to - from; ++x) plate_alpha[x] = number(given[x]) / full();
        } else {
            std::fill_n(plate_alpha, std::max(to - from, 0), 1.0f);
        }
    }

    // Adds the changes of the pixels under a tap; `own`: they lie in the coarse samples' cells.
    void add_tap(int y, int q, int start, float weight, bool own) {
        const int count = pixels_.count, each = step();
        const std::uint8_t* drawn = drawn_.row(y - y0_) + (start - x0_);
        std::uint8_t any = 0;
        for (int k = 0; k < count; ++k) any |= pixels_.drawn[k] = drawn[k * each] & touched_[k];
        if (!any) return;
        const auto take = [&](float* lane, const float* row) {
            for (int k = 0; k < count; ++k) lane[k] = row[k * each + q];
        };
        for (int c = 0; c < 3; ++c) take(pixels_.own[c], row_.own(c));
        take(pixels_.alpha, row_.alpha());
        take(pixels_.luma, row_.luma());
        if (!flags_.associated) take(pixels_.plate_alpha, row_.plate_alpha());
        std::copy_n(pixels_.luma, count, pixels_.plate[0]);
        std::copy_n(chroma_b_, count, pixels_.plate[1]);
        std::copy_n(chroma_c_, count, pixels_.plate[2]);
        find_changes(tables_, flags_, peak_, pixels_);
        const float *red = pixels_.own[0], *green = pixels_.own[1], *blue = pixels_.own[2];
        const auto of_change = [&](int component, int k) {
            const float* m = codes_from_rgb_[component];
            return m[0] * red[k] + m[1] * green[k] + m[2] * blue[k];
        };
        for (int k = 0; k < count; ++k) {
            const float with_b = change_b_[k] + weight * of_change(1, k);
            const float with_c = change_c_[k] + weight * of_change(2, k);
            change_b_[k] = pixels_.drawn[k] ? with_b : change_b_[k];
            change_c_[k] = pixels_.drawn[k] ? with_c : change_c_[k];
        }
        if (!own) return;
        float* const made = row_.made();
        for (int k = 0; k < count; ++k) made[k * each + q] = pixels_.luma[k] + of_change(0, k);
    }

    // The first component and alpha of the cells' pixels in a row, where the layer is not empty.
    void write_row(int y, int left, int count) {
        const auto first = std::get<0>(planes_);
        const int from = std::max(left, x0_);
        const int to = std::min(left + count * step(), x0_ + rgba_.shape[1]);
        const int start = left + across_.first, width = to - from;
        if (width <= 0) return;
        const std::uint8_t* drawn = drawn_.row(y - y0_) + (from - x0_);
        put_row(first, y, from, row_.made() + (from - start), drawn, width, peak_);
        if (!has_alpha_) return;
        const float* alpha = row_.alpha() + (from - start);
        float* const becomes = row_.plate_alpha() + (from - start);
        for (int x = 0; x < width; ++x)
            becomes[x] = (1.0f - (1.0f - alpha[x]) * (1.0f - becomes[x])) * full();
        put_row(alpha_, y, from, becomes, drawn, width, peak_);
    }

    float full() const { return peak_ > 0.0f ? peak_ : 1.0f; }

    Planes<Sample> planes_;
    Plane<Sample> alpha_;
    Flags flags_;
    Array<const Sample, 2> luma_before_, alpha_before_;  // of the box, as they were
    Axis across_, down_;
    int y0_, x0_;
    Array<const float, 3> rgba_;
    const Tables& tables_;
    float peak_;
    bool has_alpha_;
    int taps_;
    Row row_;
    Drawn drawn_;
    float codes_from_rgb_[3][3];
    Pixels pixels_{};
    std::uint8_t touched_[kBlock];
    Lane total_, change_b_, change_c_, chroma_b_, chroma_c_;
};

// `before` holds the first component and alpha (height, width) of the box as they were; `rows`: the
// first row of coarse samples and the one past the last.
template <class Sample>
void composite_over(Planes<Sample> planes, Plane<Sample> alpha, Flags flags,
                    std::tuple<Array<const Sample, 2>, Array<const Sample, 2>> before,
                    std::tuple<Axis, Axis> axes, Pair corner, Array<const float, 3> rgba,
                    const Tables& tables, float peak, Pair rows) {
    const auto composited = [&]<int kStep>() {
        Compositor<Sample, kStep>(planes, alpha, flags, before, axes, corner, rgba, tables, peak)
            .run(std::get<0>(rows), std::get<1>(rows));
    };
    switch (std::get<0>(axes).step) {
        case 1:
            return composited.template operator()<1>();
        case 2:
            return composited.template operator()<2>();
        default:
            return composited.template operator()<0>();
    }
}

}  // namespace

void bind_composite_over(nanobind::module_& module) {
    module.def("composite_over", &composite_over<std::uint8_t>, Unlocked());
    module.def("composite_over", &composite_over<std::uint16_t>, Unlocked());
    module.def("composite_over", &composite_over<float>, Unlocked());
}

}  // namespace nlens

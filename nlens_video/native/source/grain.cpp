// White noise, and noise added to a layer: `effects/camera/grain.py` and `grain_restore.py`.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <vector>

#include "module.h"

namespace nlens {
namespace {

// A run of one channel, and what its noise is made of.
struct Channel {
    std::vector<float> own, left, noise, change;  // light, the share of it that is left, its noise
    std::vector<float> light, first, second;      // room for the steps between

    explicit Channel(std::size_t width)
        : own(width), left(width), noise(width), change(width), light(width), first(width), second(width) {}
};

// The runs of red, green and blue, and what they share.
struct Pixels {
    Channel red, green, blue;
    std::vector<float> missing, share;  // share of the noise that is missing, share of the change to add

    explicit Pixels(std::size_t width)
        : red(width), green(width), blue(width), missing(width), share(width) {}

    void take_noise(const float* __restrict noise, int count) {
        float* __restrict r = red.noise.data(), * __restrict g = green.noise.data();
        float* __restrict b = blue.noise.data();
        for (int x = 0; x < count; ++x) r[x] = noise[3 * x], g[x] = noise[3 * x + 1], b[x] = noise[3 * x + 2];
    }

    // Adds the share of the changes to the colours of a layer's pixels.
    void add_changes(float* __restrict row, int count) const {
        const float* __restrict r = red.change.data(), * __restrict g = green.change.data();
        const float* __restrict b = blue.change.data(), * __restrict part = share.data();
        for (int x = 0; x < count; ++x) {
            row[4 * x] += part[x] * r[x];
            row[4 * x + 1] += part[x] * g[x];
            row[4 * x + 2] += part[x] * b[x];
            row[4 * x + 3] += 0.0f;  // all four are read and written together
        }
    }
};

// Light in [0, 1]; 0 for what is no number.
inline float within_white(float light) {
    return light > 0.0f ? (light < 1.0f ? light : 1.0f) : 0.0f;
}

// Between two entries of a table over [0, 1], of which the last begins at `last`. Both are read together,
// which takes half as many reads.
inline float look_up(const float* table, int last, float at) {
    static_assert(std::endian::native == std::endian::little);
    const float place = at * static_cast<float>(last + 1);
    const int low = std::min(static_cast<int>(place), last);
    const float part = place - static_cast<float>(low);
    std::uint64_t both;
    std::memcpy(&both, table + low, sizeof(both));
    const float here = std::bit_cast<float>(static_cast<std::uint32_t>(both));
    const float next = std::bit_cast<float>(static_cast<std::uint32_t>(both >> 32));
    return here + part * (next - here);
}

// Replaces the values of a row by what a table gives. A loop of nothing else is compiled for several
// values at once.
void look_up_row(const float* __restrict table, int last, float* __restrict row, int count) {
    for (int x = 0; x < count; ++x) row[x] = look_up(table, last, row[x]);
}

// Finds the change of the light by the noise, of which some is missing. `levels`: the deviation at 256
// levels.
void find_change(Channel& channel, int count, const float* __restrict missing, const float* levels,
                 Array<const float, 1> codes, Array<const float, 1> to_light) {
    const float* __restrict own = channel.own.data(), * __restrict noise = channel.noise.data();
    float* __restrict light = channel.light.data(), * __restrict change = channel.change.data();
    float* __restrict code = channel.first.data(), * __restrict spread = channel.second.data();
    for (int x = 0; x < count; ++x) {
        light[x] = within_white(own[x]);
        code[x] = std::sqrt(light[x]);
    }
    look_up_row(codes.data, codes.shape[0] - 2, code, count);
    std::copy_n(code, count, spread);
    look_up_row(levels, 254, spread, count);
    for (int x = 0; x < count; ++x)
        change[x] = std::min(std::max(0.0f, code[x] + missing[x] * spread[x] * noise[x]), 1.0f);
    look_up_row(to_light.data, to_light.shape[0] - 2, change, count);
    // light beyond white stays, and what is no number
    for (int x = 0; x < count; ++x) change[x] = own[x] < 1.0f ? change[x] - light[x] : 0.0f;
}

constexpr int kGap = 16;  // undrawn pixels that are not worth a new run

// Calls `work` with the first pixel and the number of pixels of each run of a row in which there is more
// alpha than the least; shorter gaps belong to a run.
template <class Work>
void for_drawn_runs(const float* row, int width, float least, Work&& work) {
    for (int x = 0, first = -1, end = 0; x <= width; ++x) {
        const bool drawn = x < width && row[4 * x + 3] > least;
        if (first >= 0 && (x == width || (drawn && x - end >= kGap))) {
            work(first, end - first);
            first = -1;
        }
        if (drawn) first = first < 0 ? x : first, end = x + 1;
    }
}

void regrain(Array<float, 3> rgba, Array<const float, 3> plate, Array<const float, 3> noise,
             Array<const float, 2> deviation, Array<const float, 1> codes, Array<const float, 1> lights) {
    Pixels pixels(rgba.shape[1]);
    float* __restrict r = pixels.red.own.data(), * __restrict g = pixels.green.own.data();
    float* __restrict b = pixels.blue.own.data();
    float* __restrict missing = pixels.missing.data(), * __restrict share = pixels.share.data();
    const auto add = [&](int y, int first, int count) {
        float* row = rgba.at(y, first);
        const float* behind = plate.at(y, first);
        for (int x = 0; x < count; ++x) {
            const float free = 1.0f - std::min(row[4 * x + 3], 1.0f);
            missing[x] = std::sqrt(1.0f - free * free);
            share[x] = row[4 * x + 3] > 0.0f ? 1.0f : 0.0f;
            r[x] = row[4 * x] + free * behind[3 * x];
            g[x] = row[4 * x + 1] + free * behind[3 * x + 1];
            b[x] = row[4 * x + 2] + free * behind[3 * x + 2];
        }
        pixels.take_noise(noise.at(y, first), count);
        find_change(pixels.red, count, missing, deviation.at(0), codes, lights);
        find_change(pixels.green, count, missing, deviation.at(1), codes, lights);
        find_change(pixels.blue, count, missing, deviation.at(2), codes, lights);
        pixels.add_changes(row, count);
    };
    for (int y = 0; y < rgba.shape[0]; ++y)
        for_drawn_runs(rgba.at(y), rgba.shape[1], 0.0f, [&](int first, int count) { add(y, first, count); });
}

// Finds the noise of a run that a darkened plate misses, as a share of its light. `levels`: deviation at
// even steps of the root of the light, of which the last begins at `last`.
void find_missing(Channel& channel, int count, const float* levels, int last) {
    const float* __restrict own = channel.own.data(), * __restrict noise = channel.noise.data();
    const float* __restrict left = channel.left.data();
    float* __restrict light = channel.light.data(), * __restrict change = channel.change.data();
    float* __restrict held = channel.first.data(), * __restrict wanted = channel.second.data();
    for (int x = 0; x < count; ++x) {
        light[x] = within_white(own[x]);
        held[x] = std::sqrt(light[x]);
        wanted[x] = std::sqrt(left[x] > 0.0f ? std::min(left[x] * light[x], 1.0f) : 0.0f);
    }
    look_up_row(levels, last, held, count);
    look_up_row(levels, last, wanted, count);
    for (int x = 0; x < count; ++x) {
        const float own_part = left[x] * held[x];
        const float lacks = std::sqrt(std::max(wanted[x] * wanted[x] - own_part * own_part, 0.0f));
        // noise is no larger than the light
        change[x] = std::min(lacks / std::max(light[x], 1e-6f), 1.0f) * noise[x];
    }
}

// `rgba`: pixels of a row lie beside each other, rows anywhere.
void restore_grain(Strided<float, 3> rgba, Array<const float, 3> plate, Array<const float, 3> noise,
                   Array<const float, 2> deviation, float least_loss, float full_loss) {
    Pixels pixels(rgba.shape[1]);
    Channel* const channels[3] = {&pixels.red, &pixels.green, &pixels.blue};
    float* __restrict share = pixels.share.data();
    const float slope = 1.0f / (full_loss - least_loss);
    const auto add = [&](int y, int first, int count) {
        float* row = rgba.at(y, first);
        const float* behind = plate.at(y, first);
        for (int x = 0; x < count; ++x)
            share[x] = std::max(std::min((row[4 * x + 3] - least_loss) * slope, 1.0f), 0.0f);
        pixels.take_noise(noise.at(y, first), count);
        for (int c = 0; c < 3; ++c) {
            float* __restrict own = channels[c]->own.data(), * __restrict left = channels[c]->left.data();
            for (int x = 0; x < count; ++x) {
                own[x] = behind[3 * x + c];
                left[x] = 1.0f - row[4 * x + 3] + row[4 * x + c];
            }
            find_missing(*channels[c], count, deviation.at(c), deviation.shape[1] - 2);
        }
        pixels.add_changes(row, count);
    };
    for (int y = 0; y < rgba.shape[0]; ++y)
        for_drawn_runs(rgba.at(y), rgba.shape[1], least_loss,
                       [&](int first, int count) { add(y, first, count); });
}

// A number whose bits all depend on all bits of another (the finaliser `lowbias32`).
std::uint32_t mixed(std::uint32_t value) {
    value = (value ^ (value >> 16)) * 0x7FEB352Du;
    value = (value ^ (value >> 15)) * 0x846CA68Bu;
    return value ^ (value >> 16);
}

// The sum of the four bytes of a number, each uniform, is near to normal (Irwin-Hall), within 4
// deviations of `deviation` = 1 / `scale`.
void white_noise(Array<float, 2> out, std::tuple<std::int64_t, std::int64_t> corner, std::uint32_t moment,
                 std::uint32_t seed, float scale) {
    const auto top = static_cast<std::uint32_t>(std::get<0>(corner));
    const auto left = static_cast<std::uint32_t>(std::get<1>(corner));
    const std::uint32_t start = mixed(seed ^ mixed(moment + 0x9E3779B9u));
    for (int i = 0; i < out.shape[0]; ++i) {
        const std::uint32_t of_row = mixed(start ^ (top + static_cast<std::uint32_t>(i)));
        float* row = out.at(i);
        for (int j = 0; j < out.shape[1]; ++j) {
            const std::uint32_t bits = mixed(of_row + (left + static_cast<std::uint32_t>(j)) * 0x9E3779B1u);
            const auto total = static_cast<std::int32_t>((bits & 255) + (bits >> 8 & 255) +
                                                         (bits >> 16 & 255) + (bits >> 24));
            row[j] = (static_cast<float>(total) - 510.0f) * scale;
        }
    }
}

// Fills in the weighted sum of a tile that is laid on the plane again and again from several places.
// `corners`: places on it of the first pixel, row and column of any sign.
void add_tiles(Array<float, 3> out, Array<const float, 3> tile, Array<const std::int64_t, 2> corners,
               Array<const float, 1> shares) {
    const std::int64_t size = tile.shape[0], width = out.shape[1];
    const auto on_tile = [size](std::int64_t place) { return (place % size + size) % size; };
    for (int y = 0; y < out.shape[0]; ++y) {
        std::fill_n(out.at(y), 3 * width, 0.0f);
        for (int number = 0; number < shares.shape[0]; ++number) {
            const float share = shares(number);
            const float* row = tile.at(on_tile(corners(number, 0) + y));
            for (std::int64_t x = 0, at = on_tile(corners(number, 1)); x < width; at = 0) {
                const std::int64_t count = std::min(size - at, width - x);
                const float* __restrict given = row + 3 * at;
                float* __restrict sum = out.at(y) + 3 * x;
                for (std::int64_t i = 0; i < 3 * count; ++i) sum[i] += share * given[i];
                x += count;
            }
        }
    }
}

}  // namespace

void bind_grain(nanobind::module_& module) {
    module.def("regrain", &regrain, Unlocked());
    module.def("restore_grain", &restore_grain, Unlocked());
    module.def("white_noise", &white_noise, Unlocked());
    module.def("add_tiles", &add_tiles, Unlocked());
}

}  // namespace nlens

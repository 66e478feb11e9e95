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

// A row of one channel, and what its noise is made of.
struct Channel {
    std::vector<float> own, noise, missing, change;  // `own`: the light of the composite

    explicit Channel(std::size_t width) : own(width), noise(width), missing(width), change(width) {}
};

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

// Finds the change of the light by the noise. `levels`: the deviation at 256 levels.
void find_change(Channel& channel, int count, const float* __restrict levels, Array<const float, 1> codes,
                 Array<const float, 1> to_light) {
    const float* __restrict own = channel.own.data(), * __restrict noise = channel.noise.data();
    const float* __restrict missing = channel.missing.data();
    const float* __restrict code_of = codes.data, * __restrict light_of = to_light.data;
    float* __restrict change = channel.change.data();
    const int last_code = codes.shape[0] - 2, last_light = to_light.shape[0] - 2;
    for (int x = 0; x < count; ++x) {
        const float light = own[x] > 0.0f ? (own[x] < 1.0f ? own[x] : 1.0f) : 0.0f;
        const float code = look_up(code_of, last_code, std::sqrt(light));
        const float spread = look_up(levels, 254, code);
        const float grained = std::min(std::max(0.0f, code + missing[x] * spread * noise[x]), 1.0f);
        const float made = look_up(light_of, last_light, grained) - light;
        change[x] = own[x] < 1.0f ? made : 0.0f;  // light beyond white stays, and what is no number
    }
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
    Channel channel(rgba.shape[1]);
    float *own = channel.own.data(), *missing = channel.missing.data(), *added = channel.noise.data();
    const auto add = [&](int y, int first, int count) {
        float* row = rgba.at(y, first);
        const float *behind = plate.at(y, first), *given = noise.at(y, first);
        for (int x = 0; x < count; ++x) {
            const float free = 1.0f - std::min(row[4 * x + 3], 1.0f);
            missing[x] = std::sqrt(1.0f - free * free);
        }
        for (int c = 0; c < 3; ++c) {
            for (int x = 0; x < count; ++x) {
                const float free = 1.0f - std::min(row[4 * x + 3], 1.0f);
                own[x] = row[4 * x + c] + free * behind[3 * x + c];
                added[x] = given[3 * x + c];
            }
            find_change(channel, count, deviation.at(c), codes, lights);
            const float* change = channel.change.data();
            for (int x = 0; x < count; ++x) row[4 * x + c] += row[4 * x + 3] > 0.0f ? change[x] : 0.0f;
        }
    };
    for (int y = 0; y < rgba.shape[0]; ++y)
        for_drawn_runs(rgba.at(y), rgba.shape[1], 0.0f, [&](int first, int count) { add(y, first, count); });
}

// Finds the noise of a row that a darkened plate misses, as a share of its light. `channel`: the light
// in `own`, the share of it that is left in `missing`. `levels`: deviation at even steps of its root.
void find_missing(Channel& channel, int count, const float* __restrict levels, int last) {
    const float* __restrict own = channel.own.data(), * __restrict left = channel.missing.data();
    const float* __restrict noise = channel.noise.data();
    float* __restrict change = channel.change.data();
    for (int x = 0; x < count; ++x) {
        const float light = own[x] > 0.0f ? (own[x] < 1.0f ? own[x] : 1.0f) : 0.0f;
        const float dark = left[x] > 0.0f ? std::min(left[x] * light, 1.0f) : 0.0f;
        const float held = left[x] * look_up(levels, last, std::sqrt(light));
        const float wanted = look_up(levels, last, std::sqrt(dark));
        const float lacks = std::sqrt(std::max(wanted * wanted - held * held, 0.0f));
        // noise is no larger than the light
        change[x] = std::min(lacks / std::max(light, 1e-6f), 1.0f) * noise[x];
    }
}

// `rgba`: pixels of a row lie beside each other, rows anywhere.
void restore_grain(Strided<float, 3> rgba, Array<const float, 3> plate, Array<const float, 3> noise,
                   Array<const float, 2> deviation, float least_loss, float full_loss) {
    Channel channel(rgba.shape[1]);
    float *own = channel.own.data(), *left = channel.missing.data(), *given = channel.noise.data();
    const float slope = 1.0f / (full_loss - least_loss);
    const auto add = [&](int y, int first, int count) {
        float* row = rgba.at(y, first);
        const float *behind = plate.at(y, first), *drawn = noise.at(y, first);
        for (int c = 0; c < 3; ++c) {
            for (int x = 0; x < count; ++x) {
                own[x] = behind[3 * x + c];
                left[x] = 1.0f - row[4 * x + 3] + row[4 * x + c];
                given[x] = drawn[3 * x + c];
            }
            find_missing(channel, count, deviation.at(c), deviation.shape[1] - 2);
            const float* change = channel.change.data();
            for (int x = 0; x < count; ++x) {
                const float share = std::min((row[4 * x + 3] - least_loss) * slope, 1.0f);
                row[4 * x + c] += share > 0.0f ? share * change[x] : 0.0f;
            }
        }
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

// White noise, and noise added to a layer: `effects/camera/grain.py`.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <vector>

#include "module.h"

namespace nlens {
namespace {

// What adds up to noise: how much of the deviation is missing, at which light of which value.
struct Parts {
    std::vector<int> places, channels;  // in a row of the layer
    std::vector<float> lights, missing, noises;

    explicit Parts(std::size_t size)
        : places(size), channels(size), lights(size), missing(size), noises(size) {}
};

int collect(const float* rgba, const float* plate, const float* noise, int width, Parts& parts) {
    int count = 0;
    for (int x = 0; x < width; ++x, rgba += 4, plate += 3, noise += 3) {
        const float alpha = std::min(rgba[3], 1.0f);
        if (alpha <= 0.0f) continue;
        const float free = 1.0f - alpha, missing = std::sqrt(1.0f - free * free);
        for (int c = 0; c < 3; ++c) {
            const float light = rgba[c] + free * plate[c];
            parts.places[count] = 4 * x + c;
            parts.channels[count] = c;
            parts.lights[count] = std::max(0.0f, light);
            parts.missing[count] = missing;
            parts.noises[count] = noise[c];
            count += light < 1.0f;
        }
    }
    return count;
}

// Between two entries of a table over [0, 1].
float look_up(Array<const float, 1> table, float at) {
    const float place = at * static_cast<float>(table.shape[0] - 1);
    const int low = std::min(static_cast<int>(place), table.shape[0] - 2);
    const float part = place - static_cast<float>(low);
    return table(low) + part * (table(low + 1) - table(low));
}

// The change of the light by the noise, instead of `lights`.
void add_noise(Parts& parts, int count, Array<const float, 2> deviation, Array<const float, 1> codes,
               Array<const float, 1> to_light) {
    const int* __restrict channels = parts.channels.data();
    const float* __restrict missing = parts.missing.data(), * __restrict noises = parts.noises.data();
    float* __restrict lights = parts.lights.data();
    const float* levels = deviation.data;  // at 256 levels, of three channels
    for (int i = 0; i < count; ++i) {
        const float code = look_up(codes, std::sqrt(lights[i])), level = 255.0f * code;
        const int low = std::min(static_cast<int>(level), 254);
        const float* here = levels + 3 * low + channels[i];
        const float spread = here[0] + (level - static_cast<float>(low)) * (here[3] - here[0]);
        const float grained = std::min(std::max(0.0f, code + missing[i] * spread * noises[i]), 1.0f);
        lights[i] = look_up(to_light, grained) - lights[i];
    }
}

void regrain(Array<float, 3> rgba, Array<const float, 3> plate, Array<const float, 3> noise,
             Array<const float, 2> deviation, Array<const float, 1> codes, Array<const float, 1> lights) {
    const int width = rgba.shape[1];
    Parts parts(3 * static_cast<std::size_t>(width) + 1);
    for (int y = 0; y < rgba.shape[0]; ++y) {
        float* row = rgba.at(y);
        const int count = collect(row, plate.at(y), noise.at(y), width, parts);
        add_noise(parts, count, deviation, codes, lights);
        for (int i = 0; i < count; ++i) row[parts.places[i]] += parts.lights[i];
    }
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

}  // namespace

void bind_grain(nanobind::module_& module) {
    module.def("regrain", &regrain, Unlocked());
    module.def("white_noise", &white_noise, Unlocked());
}

}  // namespace nlens

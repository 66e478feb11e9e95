// Diffuse light from patches of the object to the ground: `effects/shadow/bounce.py`.
#include <algorithm>
#include <limits>
#include <numbers>

#include "module.h"

namespace nlens {
namespace {

constexpr int kBlock = 256;  // points at a time

// Adds the irradiance of level ground at points (M, 3) by patches: point, normal, area, radiosity.
void gather_patches(Array<const float, 2> points, Array<const float, 2> patches, Array<float, 2> irradiance) {
    constexpr float pi = std::numbers::pi_v<float>, tiny = std::numeric_limits<float>::min();
    float x[kBlock], y[kBlock], z[kBlock], sums[3][kBlock];
    for (int first = 0; first < points.shape[0]; first += kBlock) {
        const int count = std::min(kBlock, points.shape[0] - first);
        for (int i = 0; i < count; ++i) {
            const float* point = points.at(first + i);
            x[i] = point[0], y[i] = point[1], z[i] = point[2];
        }
        for (auto& sum : sums) std::fill_n(sum, count, 0.0f);
        for (int number = 0; number < patches.shape[0]; ++number) {
            const float* patch = patches.at(number);
            const float px = patch[0], py = patch[1], pz = patch[2];
            const float nx = patch[3], ny = patch[4], nz = patch[5], area = patch[6];
            const float red = patch[7], green = patch[8], blue = patch[9];
            for (int i = 0; i < count; ++i) {
                const float ax = x[i] - px, ay = y[i] - py, az = z[i] - pz;
                const float squared = ax * ax + ay * ay + az * az;
                const float leaves = std::max(ax * nx + ay * ny + az * nz, 0.0f);
                const float arrives = std::max(-ay, 0.0f);
                const float below = std::max(squared * (pi * squared + area), tiny);
                const float factor = area * leaves * arrives / below;
                sums[0][i] += factor * red;
                sums[1][i] += factor * green;
                sums[2][i] += factor * blue;
            }
        }
        for (int i = 0; i < count; ++i)
            for (int k = 0; k < 3; ++k) irradiance(first + i, k) += sums[k][i];
    }
}

}  // namespace

void bind_bounce(nanobind::module_& module) {
    module.def("gather_patches", &gather_patches, Unlocked());
}

}  // namespace nlens

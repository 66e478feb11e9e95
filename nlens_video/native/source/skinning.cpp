// Vertices carried by the joints of a skin: `scene/posed.py`.
#include <cmath>
#include <cstdint>

#include "module.h"

namespace nlens {
namespace {

// Scales a vector to length 1, +Y where it has none, as `meshes.unit` does.
void normalise(float* vector) {
    const double x = vector[0], y = vector[1], z = vector[2];
    const double length = std::sqrt(x * x + y * y + z * z);
    const double scale = 1.0 / (length == 0.0 ? 1.0 : length);
    vector[0] = static_cast<float>(x * scale);
    vector[1] = length == 0.0 ? 1.0f : static_cast<float>(y * scale);
    vector[2] = static_cast<float>(z * scale);
}

// Each vertex by the mean of its joints' matrices.
//
// `joints` and `weights` (V, K) say which carry it, `matrices` (J, 12) are rows of 3 x 4;
// `placed` gets the positions, `turned` the directions (V, 3) without the matrices' last column, of
// length 1.
void skin(Array<const float, 2> positions, Array<const float, 2> directions,
          Array<const std::int32_t, 2> joints, Array<const float, 2> weights, Array<const float, 2> matrices,
          Array<float, 2> placed, Array<float, 2> turned) {
    for (int v = 0; v < positions.shape[0]; ++v) {
        float blended[12] = {};
        for (int k = 0; k < joints.shape[1]; ++k) {
            const float weight = weights(v, k);
            if (weight == 0.0f) continue;  // such a joint may point anywhere
            const float* matrix = matrices.at(joints(v, k));
            for (int i = 0; i < 12; ++i) blended[i] += weight * matrix[i];
        }
        const float *p = positions.at(v), *d = directions.at(v);
        for (int row = 0; row < 3; ++row) {
            const float* m = blended + 4 * row;
            placed(v, row) = m[0] * p[0] + m[1] * p[1] + m[2] * p[2] + m[3];
            turned(v, row) = m[0] * d[0] + m[1] * d[1] + m[2] * d[2];
        }
        normalise(turned.at(v));
    }
}

}  // namespace

void bind_skinning(nanobind::module_& module) {
    module.def("skin", &skin, Unlocked());
}

}  // namespace nlens

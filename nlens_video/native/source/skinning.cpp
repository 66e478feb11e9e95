// Vertices carried by a node or by the joints of a skin: `scene/posed.py`.
#include <cmath>
#include <cstdint>

#include "module.h"

namespace nlens {
namespace {

// A vector of length 1 along x, y, z, +Y where they have none, as `meshes.unit` does.
void normalise(double x, double y, double z, float* vector) {
    const double length = std::sqrt(x * x + y * y + z * z);
    const double scale = 1.0 / (length == 0.0 ? 1.0 : length);
    vector[0] = static_cast<float>(x * scale);
    vector[1] = length == 0.0 ? 1.0f : static_cast<float>(y * scale);
    vector[2] = static_cast<float>(z * scale);
}

// Turns a normal by rows of 3 x 4 as a surface turns: by the cofactor of their linear part, which
// is right under uneven scales too. It points out of a mirrored surface, as `normal_matrices` has it.
void turn(const double* m, const float* normal, float* turned) {
    double along[3];
    double determinant = 0.0;
    for (int row = 0; row < 3; ++row) {
        const double *next = m + 4 * ((row + 1) % 3), *last = m + 4 * ((row + 2) % 3);
        const double x = next[1] * last[2] - next[2] * last[1];
        const double y = next[2] * last[0] - next[0] * last[2];
        const double z = next[0] * last[1] - next[1] * last[0];
        along[row] = x * normal[0] + y * normal[1] + z * normal[2];
        if (row == 0) determinant = m[0] * x + m[1] * y + m[2] * z;
    }
    const double side = determinant < 0.0 ? -1.0 : 1.0;
    normalise(side * along[0], side * along[1], side * along[2], turned);
}

// A position by rows of 3 x 4.
void place(const double* m, const float* position, float* placed) {
    for (int row = 0; row < 3; ++row, m += 4)
        placed[row] = static_cast<float>(m[0] * position[0] + m[1] * position[1] + m[2] * position[2] + m[3]);
}

// All vertices by the matrix of one node.
//
// `carrier` (3, 4) moves the positions, `turner` (3, 3) turns the normals; `placed` gets the positions,
// `turned` the normals (V, 3), of length 1.
void carry(Array<const float, 2> positions, Array<const float, 2> normals, Array<const double, 2> carrier,
           Array<const double, 2> turner, Array<float, 2> placed, Array<float, 2> turned) {
    const double* t = turner.data;
    for (int v = 0; v < positions.shape[0]; ++v) {
        place(carrier.data, positions.at(v), placed.at(v));
        const float* n = normals.at(v);
        normalise(t[0] * n[0] + t[1] * n[1] + t[2] * n[2], t[3] * n[0] + t[4] * n[1] + t[5] * n[2],
                  t[6] * n[0] + t[7] * n[1] + t[8] * n[2], turned.at(v));
    }
}

// Each vertex by the mean of its joints' matrices.
//
// `joints` and `weights` (V, K) say which carry it, `matrices` (J, 12) are rows of 3 x 4;
// `placed` gets the positions, `turned` the normals (V, 3), of length 1.
void skin(Array<const float, 2> positions, Array<const float, 2> normals, Array<const std::int32_t, 2> joints,
          Array<const float, 2> weights, Array<const float, 2> matrices, Array<float, 2> placed,
          Array<float, 2> turned) {
    for (int v = 0; v < positions.shape[0]; ++v) {
        double blended[12] = {};
        for (int k = 0; k < joints.shape[1]; ++k) {
            const double weight = weights(v, k);
            if (weight == 0.0) continue;  // such a joint may point anywhere
            const float* matrix = matrices.at(joints(v, k));
            for (int i = 0; i < 12; ++i) blended[i] += weight * matrix[i];
        }
        place(blended, positions.at(v), placed.at(v));
        turn(blended, normals.at(v), turned.at(v));
    }
}

}  // namespace

void bind_skinning(nanobind::module_& module) {
    module.def("carry", &carry, Unlocked());
    module.def("skin", &skin, Unlocked());
}

}  // namespace nlens

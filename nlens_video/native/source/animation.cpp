// Keyframe tracks sampled, and world matrices composed: `scene/gltf/animation_kernels.py`.
#include <algorithm>
#include <cmath>
#include <cstdint>

#include "module.h"

namespace nlens {
namespace {

constexpr int kStep = 0, kCubic = 2;
constexpr double kStepLead = 1e-3;  // by which a value that steps comes before its key [s]
constexpr double kAlike = 1e-6;  // sine of the angle between rotations, below which their weights are linear

// A row of `tracks`, see `sample_tracks` in `animation_kernels.py`.
struct Track {
    std::int64_t row, column, width, kind, turns, times, values, count;
};

// The last of the sorted `times` at or before a time; -1 where there is none.
std::int64_t key_before(const double* times, std::int64_t count, double time_s) {
    return std::upper_bound(times, times + count, time_s) - times - 1;
}

// Of two neighbouring keys.
struct Weights {
    double left, right;
};

// Those of rotations lie along the shorter way on the sphere.
Weights linear_weights(const double* left, const double* right, double u, bool turns) {
    if (!turns) return {1.0 - u, u};
    double cosine = 0.0;
    for (int k = 0; k < 4; ++k) cosine += left[k] * right[k];
    const double sign = cosine < 0.0 ? -1.0 : 1.0;
    const double angle = std::acos(std::min(std::fabs(cosine), 1.0)), sine = std::sin(angle);
    if (sine < kAlike) return {1.0 - u, sign * u};
    return {std::sin((1.0 - u) * angle) / sine, sign * std::sin(u * angle) / sine};
}

// Makes a quaternion one of length 1; the identity where it has none.
void normalize(double* rotation) {
    double square = 0.0;
    for (int k = 0; k < 4; ++k) square += rotation[k] * rotation[k];
    const double length = std::sqrt(square);
    for (int k = 0; k < 4; ++k) {
        rotation[k] = length > 0.0 ? rotation[k] / length : (k == 3 ? 1.0 : 0.0);
    }
}

void sample_one(const Track& track, double time_s, const double* times, Array<const double, 3> values,
                double* target) {
    const auto key = key_before(times, track.count, track.kind == kStep ? time_s + kStepLead : time_s);
    double u = 0.0, span = 0.0;
    if (0 <= key && key < track.count - 1) {
        span = times[key + 1] - times[key];
        u = (time_s - times[key]) / span;
    }
    const auto place = track.values + std::max<std::int64_t>(key, 0);
    const double* left = values.at(place, 1);
    if (u == 0.0 || track.kind == kStep) {
        std::copy_n(left, track.width, target);
        return;
    }
    const double* right = values.at(place + 1, 1);
    if (track.kind != kCubic) {
        const auto [a, b] = linear_weights(left, right, u, track.turns != 0);
        for (int k = 0; k < track.width; ++k) target[k] = a * left[k] + b * right[k];
        return;
    }
    const double *leaving = values.at(place, 2), *arriving = values.at(place + 1, 0);
    const double u2 = u * u, u3 = u * u * u;
    const double a = 2.0 * u3 - 3.0 * u2 + 1.0, b = 3.0 * u2 - 2.0 * u3;
    const double c = (u3 - 2.0 * u2 + u) * span, d = (u3 - u2) * span;
    for (int k = 0; k < track.width; ++k) {
        target[k] = a * left[k] + b * right[k] + (c * leaving[k] + d * arriving[k]);
    }
}

void sample_tracks(double time_s, Array<const std::int64_t, 2> tracks, Array<const double, 1> times,
                   Array<const double, 3> values, Array<double, 2> out) {
    for (int t = 0; t < tracks.shape[0]; ++t) {
        const std::int64_t* n = tracks.at(t);
        const Track track{n[0], n[1], n[2], n[3], n[4], n[5], n[6], n[7]};
        double* target = out.at(track.row, track.column);
        sample_one(track, time_s, times.at(track.times), values, target);
        if (track.turns) normalize(target);
    }
}

// Fills in the matrix (4, 4) of translation * rotation * scale.
void compose(const double* local, double* matrix) {
    const double x = local[3], y = local[4], z = local[5], w = local[6];
    const double rotation[3][3] = {
        {1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)},
        {2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)},
        {2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)},
    };
    for (int row = 0; row < 3; ++row) {
        for (int column = 0; column < 3; ++column) {
            matrix[4 * row + column] = rotation[row][column] * local[7 + column];
        }
        matrix[4 * row + 3] = local[row];
        matrix[12 + row] = 0.0;
    }
    matrix[15] = 1.0;
}

void multiply_nodes(Array<const double, 2> local, Array<const std::int64_t, 2> order,
                    Array<const double, 3> matrices, Array<const bool, 1> has_matrix,
                    Array<double, 3> world) {
    for (int n = 0; n < order.shape[0]; ++n) {
        const std::int64_t node = order(n, 0), parent = order(n, 1);
        double* own = world.at(node);
        if (has_matrix(node)) {
            std::copy_n(matrices.at(node), 16, own);
        } else {
            compose(local.at(node), own);
        }
        if (parent < 0) continue;
        const double* above = world.at(parent);
        for (int column = 0; column < 4; ++column) {
            const double a = own[column], b = own[4 + column], c = own[8 + column], d = own[12 + column];
            for (int row = 0; row < 4; ++row) {
                const double* r = above + 4 * row;
                own[4 * row + column] = r[0] * a + r[1] * b + r[2] * c + r[3] * d;
            }
        }
    }
}

}  // namespace

void bind_animation(nanobind::module_& module) {
    module.attr("STEP_LEAD_S") = kStepLead;
    module.def("sample_tracks", &sample_tracks, Unlocked());
    module.def("multiply_nodes", &multiply_nodes, Unlocked());
}

}  // namespace nlens

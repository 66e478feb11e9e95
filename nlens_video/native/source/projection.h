// World positions as a pinhole camera sees them: `scene/screen_projection.py`.
#pragma once

#include "arrays.h"

namespace nlens {

// A camera as `pinhole_params` gives it: axes (right, up, back), place, fx, fy, cx, cy, near.
using Lens = Array<const double, 1>;

// Of a world position, by the camera's axes.
struct InCamera {
    double right, up, depth;
};

template <class Number>
inline InCamera in_camera(Number px, Number py, Number pz, const double* lens) {
    const double x = px - lens[9], y = py - lens[10], z = pz - lens[11];
    return {x * lens[0] + y * lens[1] + z * lens[2], x * lens[3] + y * lens[4] + z * lens[5],
            -(x * lens[6] + y * lens[7] + z * lens[8])};
}

}  // namespace nlens

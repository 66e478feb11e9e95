// Which samples a triangle covers: `render/software/raster.py`.
#pragma once

#include "triangles.h"

namespace nlens {

// Where in a pixel its samples lie [px].
constexpr double kSampleX[kSamples] = {0.375, 0.875, 0.125, 0.625};
constexpr double kSampleY[kSamples] = {0.125, 0.375, 0.625, 0.875};
constexpr int kNothing = -1;  // no triangle

// The row of the samples of a line.
inline double row_of(int line) { return 0.25 * line + 0.125; }

// Columns: the first, and one beyond the last.
struct Columns {
    int first, last;
};

// Columns of a line that a triangle covers.
Columns covered(const Shape& shape, int t, int line, int width);

}  // namespace nlens

// Depth of the object as its lights see it, and what of their light reaches a point:
// `render/base/light_depth.py`.
#pragma once

#include <tuple>

#include "arrays.h"
#include "shading_block.h"

namespace nlens {

// Maps of some lights, see `LightDepth`.
struct DepthMaps {
    Array<const float, 3> nearness;  // (K, side, side)
    Array<const float, 3> highest;   // of the cells around each cell (K, cells, cells)
    Array<const float, 2> views;     // (K, kViewNumbers), see `LightDepth.rows`
    static constexpr auto fields = std::tuple{&DepthMaps::nearness, &DepthMaps::highest, &DepthMaps::views};

    int count() const { return views.shape[0]; }
};

// Numbers of a view: a matrix (4, 4), one for planes (3, 4), then these.
constexpr int kPlanes4 = 16, kSoftness = 28, kLift = 29, kSoftest = 30, kViewNumbers = 32;

// The number of a lamp's map, from its row of numbers (16,); -1 without one.
inline int map_of(const float* lamp) {
    return static_cast<int>(lamp[14]) - 1;
}

// The share of a light that reaches a point. `place` is relative to the eye, `facet` the normal of its
// triangle, facing the eye, `toward` the direction to the light.
float visible(const DepthMaps& maps, int number, Vector place, Vector facet, Vector toward);

}  // namespace nlens

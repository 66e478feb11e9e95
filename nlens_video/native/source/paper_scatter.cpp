// The classical renderer of the paper's reblur: `kernels/scatter/paper_scatter.py`.
#include <algorithm>
#include <cmath>
#include <vector>

#include "module.h"
#include "scatter.h"
#include "vectors.h"

namespace nlens {
namespace {

constexpr double kRimPx = 2.0;  // tanh(8) is 1 to seven digits
constexpr int kSteps = 1024;    // of the rim's table a pixel

// Rows of the result that one thread makes: sums of red, green, blue and weight, the first row `top`.
struct Rows {
    std::vector<double> sums;
    int top, bottom, width;

    Rows(Band band, int width)
        : sums(4 * static_cast<std::size_t>(band.end - band.begin) * width),
          top(band.begin),
          bottom(band.end),
          width(width) {}

    double* at(int y, int x) { return &sums[4 * (static_cast<std::size_t>(y - top) * width + x)]; }
};

// Adds the disc of the pixel at row `sy` and column `sx`.
void spread(const float* colour, int sy, int sx, double r, Array<const float, 1> rim, Rows& rows,
            Array<float, 2> dilated) {
    // no picture is larger than a radius can say in whole numbers
    const int k = static_cast<int>(std::min(r, 1e8)) + 1;
    const double scale = 1.0 / (r * r + 0.2);
    const Double4 light{colour[0], colour[1], colour[2], 1.0};
    const int begin = std::max(0, sx - k), end = std::min(rows.width, sx + k + 1);
    for (int y = std::max(rows.top, sy - k); y < std::min(rows.bottom, sy + k + 1); ++y) {
        const double dy = y - sy;
        float* largest = dilated.at(y);
        for (int x = begin; x < end; ++x) {
            const double dx = x - sx, inside = r - std::sqrt(dx * dx + dy * dy);
            if (inside <= -kRimPx) continue;
            double weight = scale;
            if (inside < kRimPx) weight *= rim(static_cast<int>((inside + kRimPx) * kSteps + 0.5));
            if (inside >= 0.0) largest[x] = std::max(largest[x], static_cast<float>(r));
            double* sum = rows.at(y, x);
            store(sum, load<Double4>(sum) + weight * light);
        }
    }
}

// Rows of the result, and the largest radius whose disc covers each pixel; `rim` is the table of what a
// disc's edge gives, from `kRimPx` outside to as much inside.
void paper_scatter_rows(Array<const float, 3> light, Array<const float, 2> radius, Array<const float, 1> rim,
                        Array<float, 3> out, Array<float, 2> dilated, Band band) {
    const int height = radius.shape[0], width = radius.shape[1];
    float largest = 0.0f;
    for (int i = 0; i < height * width; ++i) largest = std::max(largest, radius.data[i]);
    const int reach = static_cast<int>(std::min(largest, 1e8f)) + 1;
    Rows rows(band, width);
    for (int y = std::max(0, band.begin - reach); y < std::min(height, band.end + reach); ++y) {
        for (int x = 0; x < width; ++x) spread(light.at(y, x), y, x, radius(y, x), rim, rows, dilated);
    }
    for (int y = band.begin; y < band.end; ++y) {
        for (int x = 0; x < width; ++x) {
            const double* sum = rows.at(y, x);
            for (int c = 0; c < 3; ++c) out(y, x, c) = static_cast<float>(sum[c] / sum[3]);
        }
    }
}

}  // namespace

void bind_paper_scatter(nanobind::module_& module) {
    module.attr("RIM_PX") = kRimPx;
    module.attr("RIM_STEPS") = kSteps;
    module.def("paper_scatter_rows", &paper_scatter_rows, Unlocked());
}

}  // namespace nlens

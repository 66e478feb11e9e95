// Rows of a layer that is composited over samples: where it is drawn, and its pixels.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <tuple>
#include <utility>
#include <vector>

#include "arrays.h"

namespace nlens {

// Where the layer is not empty, with columns beyond its sides that are, on the rows that were looked at.
// `negligible`: sum of the sizes of a pixel's components up to which it counts as empty.
class Drawn {
public:
    Drawn(Array<const float, 3> rgba, int margin, float negligible)
        : rgba_(rgba),
          margin_(margin),
          negligible_(negligible),
          stride_(rgba.shape[1] + 2 * margin),
          codes_(stride_ * rgba.shape[0]),
          ends_(rgba.shape[0]) {}

    // Looks at the rows from one to before another, as far as there are any.
    void look_at(int from, int to) {
        const int width = rgba_.shape[1];
        for (int y = std::max(from, 0); y < std::min(to, rgba_.shape[0]); ++y) {
            const float* layer = rgba_.at(y);
            std::uint8_t* drawn = codes_.data() + y * stride_ + margin_;
            for (int x = 0; x < width; ++x) {
                const float* v = layer + 4 * x;
                const float sum = std::fabs(v[0]) + std::fabs(v[1]) + std::fabs(v[2]) + std::fabs(v[3]);
                drawn[x] = !(sum <= negligible_);  // what is no number counts
            }
            const auto first = std::find(drawn, drawn + width, 1) - drawn;
            auto end = static_cast<std::ptrdiff_t>(width);
            while (end > first && !drawn[end - 1]) --end;
            ends_[y] = {static_cast<int>(first), static_cast<int>(end)};
        }
    }

    // 1 where the layer is drawn, at the columns of a row.
    const std::uint8_t* row(int y) const { return codes_.data() + y * stride_ + margin_; }

    // The first column that is drawn in some rows, and the one past the last.
    std::tuple<int, int> ends(int from, int to) const {
        int first = static_cast<int>(stride_), end = 0;
        for (int y = std::max(from, 0); y < std::min(to, static_cast<int>(ends_.size())); ++y) {
            if (ends_[y].first == ends_[y].second) continue;
            first = std::min(first, ends_[y].first), end = std::max(end, ends_[y].second);
        }
        return {first, end};
    }

private:
    Array<const float, 3> rgba_;
    std::ptrdiff_t margin_;
    float negligible_;
    std::ptrdiff_t stride_;
    std::vector<std::uint8_t> codes_;
    std::vector<std::pair<int, int>> ends_;
};

// The pixels of a row under the taps of a block, of the layer and of the plate.
class Row {
public:
    explicit Row(int length) : length_(length), values_(7 * static_cast<std::size_t>(length)) {}

    float* own(int component) { return at(component); }
    float* alpha() { return at(3); }
    float* luma() { return at(4); }  // the first component of the plate
    float* plate_alpha() { return at(5); }
    float* made() { return at(6); }  // what the first component becomes

    void clear() { std::fill(values_.begin(), values_.end(), 0.0f); }

private:
    float* at(int row) { return values_.data() + static_cast<std::size_t>(row) * length_; }

    int length_;
    std::vector<float> values_;
};

}  // namespace nlens

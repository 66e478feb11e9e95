// Discs of confusion as the scatter's kernels read them: `kernels/scatter/disc.py`.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "scatter.h"

namespace nlens {

// Of the tables of stamps and of spans.
struct Both {
    int stamps, spans;
    static constexpr auto fields = std::tuple{&Both::stamps, &Both::spans};
};

// A number of discs by their radius: of those behind the focus, and from `turned` on of those before it,
// if they differ.
struct Table {
    const float* entries;
    float per_px, end;  // entries per pixel of radius; no place lies beyond the end
    int turned;

    Table(const float* entries, int count, int steps, int turned)
        : entries(entries),
          per_px(static_cast<float>(steps)),
          end(std::nextafter(static_cast<float>((turned ? turned : count) - 1), 0.0f)),
          turned(turned) {}
};

// Tables of one aperture, see `disc.Discs`.
struct Discs {
    Array<const float, 3> stamps, spans;
    Both steps, turned;
    double aspect, outer;
    static constexpr auto fields = std::tuple{&Discs::stamps, &Discs::spans,  &Discs::steps,
                                              &Discs::turned, &Discs::aspect, &Discs::outer};

    bool round() const { return outer == 1.0; }
    int stamp_rows() const { return stamps.shape[0] / 2; }
    int stamp_columns() const { return stamps.shape[1] / 2; }
    int span_rows() const { return spans.shape[0] / 2; }

    // Weight of a pixel beside the middle.
    Table stamp(int dy, int dx) const {
        return {stamps.at(dy + stamp_rows(), dx + stamp_columns()), stamps.shape[2], steps.stamps,
                turned.stamps};
    }
    // Middle and half length of a row of the disc, as shares of its half axis.
    Table middle(int dy) const {
        return {spans.at(dy + span_rows(), 0), spans.shape[2], steps.spans, turned.spans};
    }
    Table half(int dy) const {
        return {spans.at(dy + span_rows(), 1), spans.shape[2], steps.spans, turned.spans};
    }
};

// First and last column that take part.
struct Part {
    int first, last;

    int count() const { return std::max(last + 1 - first, 0); }
};

// Start, stop and weight of each span of a row, from the first column that takes part; the ends count
// from their pixel.
struct Ends {
    std::vector<float> start, stop, weight;

    explicit Ends(int width) : start(width), stop(width), weight(width) {}
};

// Looks middles and halves of a row's spans up [half axis], `dy` rows from the pixels' own.
void look_spans_up(Ends& ends, Array<const float, 2> numbers, const Discs& discs, Part columns, int dy);

// Cuts middles and halves of a row's spans [half axis] to what the barrel leaves, whose rim has a radius
// of `rim`.
void cut_spans(Ends& ends, Array<const float, 2> numbers, Part columns, int dy, float rim, float aspect);

// Reads a table, which comes by value: so no number written can be part of it. Radii past its end, which
// have no weight, are taken for the last.
void look_up(const float* __restrict radii, int count, Table table, float* __restrict out);

}  // namespace nlens

// The kernels as a table of functions, one table for each kind of processor.
#pragma once

#include <cstddef>
#include <cstdint>

namespace nlens {

// Arguments as they come from Python: arrays by their first element, strides in elements.
struct ScatterArgs {
    const float *rgba, *numbers;
    const std::int32_t* rows;
    int height, width;
    const float* stamps;
    int stamp_rows, stamp_columns, stamp_entries;
    const float* spans;
    int span_rows, span_entries;
    float stamp_step, span_step;
    std::uint32_t stamp_turned, span_turned;
    float aspect, outer;
    const double *first_column, *last_column;
    const float* coarse;
    int coarse_rows, coarse_columns, coarse_row, coarse_column;
    double largest;
    float rim;
    float* sums;
    std::ptrdiff_t stride;
    int out_width, origin_row, origin_column, begin, end;
};

struct FillArgs {
    const std::int32_t* drawn;
    int count, first, last;
    const double* points;
    const float* positions;
    const std::int32_t* faces;
    const double* lens;
    const std::int32_t* spans;
    int width, stride;
    float* disparity;
    std::int32_t* ids;
};

struct PlaneArgs {
    void* values;
    std::ptrdiff_t row, column;
    int height, width;
};

struct AxisArgs {
    int step, phase, first;
    const float* weights;
    int count;
};

enum class Sample { u8, u16, f32 };

struct BlendArgs {
    Sample sample;
    PlaneArgs planes[4];
    bool associated, of_plate;
    const void *luma, *alpha;
    AxisArgs across, down;
    int y0, x0, height, width;
    const float* rgba;
    const float *to_linear, *to_coded;
    int linear_count, coded_count;
    const float *rgb_from_codes, *codes_from_rgb, *from_bt709, *to_bt709;
    float peak;
};

struct Kernels {
    void (*scatter_rows)(const ScatterArgs&);
    void (*fill)(const FillArgs&);
    void (*composite_over)(const BlendArgs&);
};

extern const Kernels baseline;
#if defined(__x86_64__)
extern const Kernels x86_64_v3;  // AVX2 and FMA
extern const Kernels x86_64_v4;  // AVX-512
#endif

}  // namespace nlens

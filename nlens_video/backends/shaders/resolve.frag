#version 330 core
// Samples to pixels: colour is their mean, depth that of the nearest surface, never a mean of two.
uniform sampler2DMS color_samples;
uniform sampler2DMS depth_samples;
uniform vec2 clip_range;  // near and far [scene unit]

layout(location = 0) out vec4 color;
layout(location = 1) out float depth;

float linear_depth(float window)
{
    return clip_range.x * clip_range.y / (clip_range.y - window * (clip_range.y - clip_range.x));
}

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    vec4 sum = vec4(0.0);
    float low = 1.0, high = 0.0, total = 0.0;
    for (int i = 0; i < 4; ++i) {
        sum += texelFetch(color_samples, at, i);
        float window = texelFetch(depth_samples, at, i).r;
        low = min(low, window);
        high = max(high, window);
        total += window;
    }
    color = sum * 0.25;
    float nearest = linear_depth(low);
    // All samples on one surface: their mean in window depth, which is affine across the screen,
    // is the depth at the pixel's centre.
    bool one_surface = high < 1.0 && linear_depth(high) < 1.005 * nearest;
    depth = low >= 1.0 ? uintBitsToFloat(0x7f800000u) : one_surface ? linear_depth(total * 0.25)
                                                                   : nearest;
}

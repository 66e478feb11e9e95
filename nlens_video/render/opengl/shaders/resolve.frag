#version 330 core
// Samples to pixels: colour is their mean, depth that of the nearest surface, never a mean of two.
uniform sampler2DMS color_samples;
uniform sampler2DMS depth_samples;
uniform vec2 clip_range;  // near and far [scene unit]
uniform ivec2 size;       // of the picture [px]

layout(location = 0) out vec4 color;
layout(location = 1) out float depth;

float linear_depth(float window)
{
    return clip_range.x * clip_range.y / (clip_range.y - window * (clip_range.y - clip_range.x));
}

vec3 low_high_mean(ivec2 at)
{
    float low = 1.0, high = 0.0, total = 0.0;
    for (int i = 0; i < 4; ++i) {
        float window = texelFetch(depth_samples, at, i).r;
        low = min(low, window);
        high = max(high, window);
        total += window;
    }
    return vec3(low, high, total * 0.25);
}

float spread(ivec2 at)
{
    vec3 found = low_high_mean(clamp(at, ivec2(0), size - 1));
    return found.y - found.x;
}

// Whether samples that differ lie on one steep surface and not on two. On a plane the neighbours'
// samples differ as much; across a step, those of the neighbours on either side do not.
bool steep(ivec2 at, float difference)
{
    float beside = min(spread(at - ivec2(1, 0)), spread(at + ivec2(1, 0)));
    float above = min(spread(at - ivec2(0, 1)), spread(at + ivec2(0, 1)));
    return difference < 1.5 * min(beside, above);
}

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    color = vec4(0.0);
    for (int i = 0; i < 4; ++i)
        color += 0.25 * texelFetch(color_samples, at, i);
    vec3 window = low_high_mean(at);
    float nearest = linear_depth(window.x);
    // All samples on one surface: their mean in window depth, which is affine across the screen,
    // is the depth at the pixel's centre.
    bool whole = window.y < 1.0
        && (linear_depth(window.y) < 1.005 * nearest || steep(at, window.y - window.x));
    if (window.x >= 1.0)
        depth = uintBitsToFloat(0x7f800000u);  // nothing here: infinitely far
    else
        depth = whole ? linear_depth(window.z) : nearest;
}

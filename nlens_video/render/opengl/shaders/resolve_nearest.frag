#version 330 core
// Samples to pixels, at half the cost of `resolve`: depth is that of the nearest sample everywhere,
// on steep surfaces up to half a pixel's worth too near.
uniform sampler2DMS color_samples;
uniform sampler2DMS depth_samples;
uniform vec2 clip_range;  // near and far [scene unit]

layout(location = 0) out vec4 color;
layout(location = 1) out float depth;

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy);
    float window = 1.0;
    color = vec4(0.0);
    for (int i = 0; i < 4; ++i) {
        color += 0.25 * texelFetch(color_samples, at, i);
        window = min(window, texelFetch(depth_samples, at, i).r);
    }
    depth = window >= 1.0 ? uintBitsToFloat(0x7f800000u)  // nothing here: infinitely far
        : clip_range.x * clip_range.y / (clip_range.y - window * (clip_range.y - clip_range.x));
}

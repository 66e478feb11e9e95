#version 330 core
// What the nearest surface alone gives to each pixel of a picture that was drawn before.
uniform sampler2DMS color_samples;
uniform sampler2DMS depth_samples;
uniform ivec2 corner;  // of this picture in that one [px]
uniform float reach;   // how far behind its nearest point a surface still counts [window depth]

layout(location = 0) out vec4 color;

void main()
{
    ivec2 at = ivec2(gl_FragCoord.xy) + corner;
    float window[4], nearest = 1.0;
    for (int i = 0; i < 4; ++i) {
        window[i] = texelFetch(depth_samples, at, i).r;
        nearest = min(nearest, window[i]);
    }
    color = vec4(0.0);
    for (int i = 0; i < 4; ++i)
        if (window[i] < nearest + reach)
            color += 0.25 * texelFetch(color_samples, at, i);
}

#version 330 core
// Positions arrive in world space and leave relative to the eye, where float32 is finest.
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 texcoords;
layout(location = 3) in vec4 vertex_color;

layout(std140, row_major) uniform FrameBlock {
    mat4 clip_from_relative;
    vec4 eye;
    vec4 ambient[9];
    vec4 lamps[LAMP_ROWS];
#ifdef DEPTH_MAPS
    vec4 views[8 * DEPTH_MAPS];
#endif
};

// Centroid: at an edge the pixel's centre may lie outside the triangle.
centroid out vec3 relative;
centroid out vec3 surface_normal;
centroid out vec4 uv;
centroid out vec4 tint;
// At the centre after all: differences of centroids are no derivatives.
out vec3 central_normal;
out vec3 place;
#ifdef USE_ANISOTROPY
out vec4 chart;
#endif

void main()
{
    relative = position - eye.xyz;
    surface_normal = normal;
    uv = texcoords;
    tint = vertex_color;
    central_normal = normal;
    place = relative;
#ifdef USE_ANISOTROPY
    chart = uv;
#endif
    gl_Position = clip_from_relative * vec4(relative, 1.0);
}

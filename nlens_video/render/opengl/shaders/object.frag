#version 400 core
// glTF 2.0 metallic-roughness (appendix B) under punctual lights; writes premultiplied
// scene-linear light. Loops have constant bounds: software rasterisers unroll them.
centroid in vec3 relative;
centroid in vec3 surface_normal;
centroid in vec4 uv;
centroid in vec4 tint;

layout(std140, row_major) uniform FrameBlock {
    mat4 clip_from_relative;
    vec4 eye;
    vec4 ambient[9];
    vec4 lamps[LAMP_ROWS];
};

layout(std140) uniform MaterialBlock {
    vec4 base_color;
    vec4 factors;      // metallic, roughness, specular weight, alpha cutoff
    vec4 emissive;
    vec4 dielectric;   // reflectance at normal incidence
    vec4 uv_rows[14];  // for each texture two rows: (a, b, c, uv set), (d, e, f, strength)
};

uniform sampler2D base_color_map;
uniform sampler2D metallic_roughness_map;
uniform sampler2D normal_map;
uniform sampler2D occlusion_map;
uniform sampler2D emissive_map;
uniform sampler2D specular_map;
uniform sampler2D specular_color_map;

#ifdef USE_BEHIND
uniform sampler2D limit;  // window depth of each pixel; what is nearer is left out
#endif

out vec4 radiance;

const float PI = 3.14159265358979;

// Of the dielectric: reflectance at normal incidence and at grazing incidence.
vec3 f0 = dielectric.rgb;
float f90 = factors.z;

vec2 map_uv(int slot)
{
    vec4 u = uv_rows[2 * slot];
    vec4 v = uv_rows[2 * slot + 1];
    vec3 at = vec3(u.w < 0.5 ? uv.xy : uv.zw, 1.0);
    return vec2(dot(u.xyz, at), dot(v.xyz, at));
}

vec3 shading_normal()
{
    vec3 n = normalize(surface_normal);
#ifdef USE_NORMAL_MAP
    // Tangents from derivatives: no attribute needed, right for mirrored coordinates too.
    vec2 at = map_uv(2);
    vec3 dp_x = dFdx(relative), dp_y = dFdy(relative);
    vec2 duv_x = dFdx(at), duv_y = dFdy(at);
    vec3 across_y = cross(dp_y, n), across_x = cross(n, dp_x);
    vec3 tangent = across_y * duv_x.x + across_x * duv_y.x;
    // v grows downwards in the picture, the map's green upwards.
    vec3 bitangent = -(across_y * duv_x.y + across_x * duv_y.y);
    float size = max(dot(tangent, tangent), dot(bitangent, bitangent));
    if (size > 0.0) {
        vec3 bump = texture(normal_map, at).xyz * 2.0 - 1.0;
        bump.xy *= uv_rows[5].w;
        // The frame's handedness follows the screen's: dp_x, dp_y turn about +-n.
        float side = dot(cross(dp_x, dp_y), n) < 0.0 ? -1.0 : 1.0;
        n = normalize(side * inversesqrt(size) * (tangent * bump.x + bitangent * bump.y)
                      + n * bump.z);
    }
#endif
    return gl_FrontFacing ? n : -n;
}

vec3 reflected(vec3 n, vec3 v, vec3 l, vec3 base, float metallic, float alpha)
{
    float nl = dot(n, l);
    if (nl <= 0.0) return vec3(0.0);
    float nv = max(abs(dot(n, v)), 1e-4);
    vec3 h = normalize(l + v);
    float nh = max(dot(n, h), 0.0);
    float grazing = pow(clamp(1.0 - dot(v, h), 0.0, 1.0), 5.0);
    float a2 = alpha * alpha;
    float spread = nh * nh * (a2 - 1.0) + 1.0;
    float lobe = a2 / (PI * spread * spread)
        * 0.5 / (nl * sqrt(nv * nv * (1.0 - a2) + a2) + nv * sqrt(nl * nl * (1.0 - a2) + a2));
    vec3 fresnel = mix(f0, vec3(f90), grazing);
    float kept = 1.0 - max(fresnel.r, max(fresnel.g, fresnel.b));
    vec3 plastic = kept * base / PI + lobe * fresnel;
    vec3 metal = lobe * mix(base, vec3(1.0), grazing);
    return nl * mix(plastic, metal, metallic);
}

#ifdef USE_AMBIENT
// Irradiance / pi of a normal: spherical harmonics of order 2, factors multiplied in.
vec3 from_around(vec3 n)
{
    vec3 sum = ambient[0].rgb + ambient[1].rgb * n.y + ambient[2].rgb * n.z + ambient[3].rgb * n.x
        + ambient[4].rgb * (n.x * n.y) + ambient[5].rgb * (n.y * n.z)
        + ambient[6].rgb * (3.0 * n.z * n.z - 1.0) + ambient[7].rgb * (n.x * n.z)
        + ambient[8].rgb * (n.x * n.x - n.y * n.y);
    return max(sum, vec3(0.0));
}

// Share of even light that a rough mirror of that colour reflects: Karis's fit (2014) with a power
// for its exponential, and what bounces between facets (Fdez-Aguera 2019).
vec3 mirrored(vec3 color, float edge, float nv, float roughness)
{
    float gloss = 1.0 - roughness, away = (1.0 - nv) * (1.0 - nv);
    float bend = min(gloss * gloss, away * away * away) * gloss + 0.0425 - 0.0275 * roughness;
    float scale = 1.04 - 0.572 * roughness - 1.04 * bend;
    float bias = 1.04 * bend - 0.04 + 0.022 * roughness;
    return (color * scale + edge * bias) * (1.0 + color * (1.0 / (scale + bias) - 1.0));
}
#endif

vec3 lit(vec3 base, float metallic, float roughness)
{
    vec3 n = shading_normal();
    vec3 v = -normalize(relative);
    float alpha = max(roughness * roughness, 0.002);
    vec3 sum = vec3(0.0);
    for (int i = 0; i < DIRECTIONAL_COUNT; ++i)
        sum += lamps[4 * i].rgb * reflected(n, v, lamps[4 * i + 2].xyz, base, metallic, alpha);
    for (int i = DIRECTIONAL_COUNT; i < LAMP_COUNT; ++i) {
        vec3 offset = lamps[4 * i + 1].xyz - relative;
        float distance_squared = max(dot(offset, offset), 1e-30);
        vec3 l = offset * inversesqrt(distance_squared);
        float beyond = distance_squared * lamps[4 * i + 1].w;
        float window = clamp(1.0 - beyond * beyond, 0.0, 1.0);
        // A point light has scale 0 and offset 1 here: full in all directions.
        vec4 cone = lamps[4 * i + 3];
        float spot = clamp(dot(lamps[4 * i + 2].xyz, l) * cone.x + cone.y, 0.0, 1.0);
        sum += lamps[4 * i].rgb * (window * spot * spot / distance_squared)
            * reflected(n, v, l, base, metallic, alpha);
    }
#ifdef USE_AMBIENT
    float occlusion = 1.0;
#ifdef USE_OCCLUSION_MAP
    occlusion = 1.0 + uv_rows[7].w * (texture(occlusion_map, map_uv(3)).r - 1.0);
#endif
    vec3 r = reflect(-v, n);
    vec3 around = from_around(n);
    vec3 ahead = mix(from_around(r), around, roughness);
    vec3 color = mix(f0, base, metallic);
    float nv = clamp(dot(n, v), 0.0, 1.0);
    sum += occlusion * (around * base * (1.0 - metallic)
                        + ahead * mirrored(color, mix(f90, 1.0, metallic), nv, roughness));
#endif
    return sum;
}

void main()
{
#ifdef USE_BEHIND
    if (gl_FragCoord.z < texelFetch(limit, ivec2(gl_FragCoord.xy), 0).r) discard;
#endif
    vec4 base = base_color * tint;
#ifdef USE_BASE_COLOR_MAP
    base *= texture(base_color_map, map_uv(0));
#endif
    float alpha = 1.0;
#ifdef USE_ALPHA_MASK
    // Coverage sharpened to one pixel around the cutoff: masked edges are as smooth as others.
    float slope = fwidth(base.a);
    float coverage = slope > 1e-4 ? clamp((base.a - factors.w) / slope + 0.5, 0.0, 1.0)
                                  : step(factors.w, base.a);
    int count = int(coverage * 4.0 + 0.5);
    if (count == 0) discard;
    gl_SampleMask[0] = count == 1 ? 1 : count == 2 ? 9 : count == 3 ? 11 : -1;
#endif
#ifdef USE_ALPHA_BLEND
    alpha = clamp(base.a, 0.0, 1.0);
    if (alpha <= 0.0) discard;
#endif
#ifdef USE_UNLIT
    vec3 color = base.rgb;
#else
    float metallic = factors.x;
    float roughness = factors.y;
#ifdef USE_METALLIC_ROUGHNESS_MAP
    vec4 sampled = texture(metallic_roughness_map, map_uv(1));
    metallic *= sampled.b;
    roughness *= sampled.g;
#endif
#ifdef USE_SPECULAR_MAP
    f90 *= texture(specular_map, map_uv(5)).a;
#endif
#ifdef USE_SPECULAR_COLOR_MAP
    f0 *= texture(specular_color_map, map_uv(6)).rgb;
#endif
#ifdef USE_TEXTURED_SPECULAR
    f0 = min(f0, vec3(1.0)) * f90;
#endif
    vec3 color = lit(base.rgb, clamp(metallic, 0.0, 1.0), clamp(roughness, 0.0, 1.0));
    vec3 glow = emissive.rgb;
#ifdef USE_EMISSIVE_MAP
    glow *= texture(emissive_map, map_uv(4)).rgb;
#endif
    color += glow;
#endif
    // The target holds half floats: an overflow to infinity would spread through the blur.
    radiance = vec4(min(color, vec3(60000.0)) * alpha, alpha);
}

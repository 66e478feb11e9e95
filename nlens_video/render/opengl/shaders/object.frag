#version 400 core
// glTF 2.0 metallic-roughness (appendix B) under punctual lights; writes premultiplied
// scene-linear light. Loops have constant bounds: software rasterisers unroll them.
centroid in vec3 relative;
centroid in vec3 surface_normal;
centroid in vec4 uv;
centroid in vec4 tint;
in vec3 central_normal;
in vec3 place;
#ifdef USE_ANISOTROPY
in vec4 chart;
#endif

layout(std140, row_major) uniform FrameBlock {
    mat4 clip_from_relative;
    vec4 eye;
    vec4 ambient[9];
    vec4 lamps[LAMP_ROWS];
#ifdef DEPTH_MAPS
    vec4 views[8 * DEPTH_MAPS];  // `LightDepth.rows`
#endif
};

layout(std140) uniform MaterialBlock {
    vec4 base_color;
    vec4 factors;      // metallic, roughness, specular weight, alpha cutoff
    vec4 emissive;     // and transmission
    vec4 dielectric;   // reflectance at normal incidence; direction of anisotropy
    vec4 layers;       // clear coat, its roughness, anisotropy, roughness of the sheen
    vec4 sheen;        // its colour; uv set of tangents
    vec4 volume;       // optical depth; how much roughness blurs what is behind
    vec4 uv_rows[30];  // for each texture two rows: (a, b, c, uv set), (d, e, f, strength)
};

uniform sampler2D base_color_map;
uniform sampler2D metallic_roughness_map;
uniform sampler2D normal_map;
uniform sampler2D occlusion_map;
uniform sampler2D emissive_map;
uniform sampler2D specular_map;
uniform sampler2D specular_color_map;
uniform sampler2D clearcoat_map;
uniform sampler2D clearcoat_roughness_map;
uniform sampler2D clearcoat_normal_map;
uniform sampler2D sheen_color_map;
uniform sampler2D sheen_roughness_map;
uniform sampler2D anisotropy_map;
uniform sampler2D transmission_map;
uniform sampler2D thickness_map;
#ifdef USE_SURROUND
uniform sampler2D surround_map;  // light from around, filtered: `Surround.levels` one below another
#endif

#ifdef DEPTH_MAPS
uniform sampler2D depth_maps;  // `LightDepth.nearness`, one map below another; below them `highest`
#endif

#ifdef USE_LIMIT
uniform sampler2D limit;  // window depth of each pixel, from which on a surface is behind
#endif

out vec4 radiance;

const float PI = 3.14159265358979;
const float MOST_PROBES = 16.0;  // of a texture
const float ROUND = 1.5;         // square of the ratio of a footprint's axes that are taken for equal

// Of the dielectric: reflectance at normal incidence and at grazing incidence.
vec3 f0 = dielectric.rgb;
float f90 = factors.z;
float through = 0.0;  // share of what enters that leaves on the other side
float shown = 0.0;    // share of the light from right behind that gets to the eye

vec2 map_uv(int slot)
{
    vec4 u = uv_rows[2 * slot];
    vec4 v = uv_rows[2 * slot + 1];
    vec3 at = vec3(u.w < 0.5 ? uv.xy : uv.zw, 1.0);
    return vec2(dot(u.xyz, at), dot(v.xyz, at));
}

// What a pixel sees of a texture, read as by the software rasteriser's `textures.cpp`: probes along the
// longer axis of the pixel's footprint, each as wide as the shorter one.
vec4 filtered(sampler2D map, vec2 at)
{
    vec2 size = vec2(textureSize(map, 0));
    vec2 across = dFdx(at) * size, down = dFdy(at) * size;
    float of_u = across.x * across.x + down.x * down.x, of_v = across.y * across.y + down.y * down.y;
    float of_both = across.x * across.y + down.x * down.y;
    float half_difference = 0.5 * (of_u - of_v), root = length(vec2(half_difference, of_both));
    float longer = 0.5 * (of_u + of_v) + root;  // squares of the axes [texel^2]
    float area = across.x * down.y - down.x * across.y;
    float shorter = max(area * area / max(longer, 1.0), max(longer / (MOST_PROBES * MOST_PROBES), 1.0));
    float count = 1.0;
    vec2 apart = vec2(0.0);
    if (longer > ROUND * shorter) {
        count = max(floor(sqrt(longer / shorter) + 0.5), 2.0);
        vec2 axis = of_u >= of_v ? vec2(half_difference + root, of_both) : vec2(of_both, root - half_difference);
        apart = axis * sqrt((longer - shorter) / ((count * count - 1.0) * dot(axis, axis))) / size;
    }
    vec2 right = vec2(sqrt(shorter) / size.x, 0.0), below = vec2(0.0, sqrt(shorter) / size.y);
    vec4 sum = vec4(0.0);
    for (float k = 0.5 - 0.5 * count; k < 0.5 * count; k += 1.0)
        sum += textureGrad(map, at + k * apart, right, below);
    return sum / count;
}

// Tangent and bitangent of texture coordinates on a unit normal, of unit length: MikkTSpace's. False
// where the coordinates do not change, or in one direction only. From derivatives: no attribute needed,
// right for mirrored coordinates too.
bool tangents(vec3 position, vec2 at, vec3 n, out vec3 tangent, out vec3 bitangent)
{
    vec3 dp_x = dFdx(position), dp_y = dFdy(position);
    vec2 duv_x = dFdx(at), duv_y = dFdy(at);
    vec3 across_y = cross(dp_y, n), across_x = cross(n, dp_x);
    // The handedness of gradients follows the screen's: dp_x, dp_y turn about +-n.
    float turn = dot(cross(dp_x, dp_y), n) < 0.0 ? -1.0 : 1.0;
    vec3 rightwards = turn * (across_y * duv_x.x + across_x * duv_y.x);
    // v grows downwards in the picture, the map's green upwards.
    vec3 upwards = -turn * (across_y * duv_x.y + across_x * duv_y.y);
    float width = dot(rightwards, rightwards), height = dot(upwards, upwards);
    if (!(min(width, height) > 1e-8 * max(width, height))) return false;
    bitangent = upwards * inversesqrt(height);
    tangent = cross(bitangent, n);
    tangent *= dot(tangent, rightwards) < 0.0 ? -1.0 : 1.0;
    return true;
}

vec3 tilted(vec3 n, sampler2D map, int slot)
{
    vec2 at = map_uv(slot);
    vec3 tangent, bitangent;
    if (!tangents(relative, at, n, tangent, bitangent)) return n;
    vec3 bump = filtered(map, at).xyz * 2.0 - 1.0;
    bump.xy *= uv_rows[2 * slot + 1].w;
    return normalize(tangent * bump.x + bitangent * bump.y + n * bump.z);
}

vec3 shading_normal()
{
    vec3 n = normalize(surface_normal);
#ifdef USE_NORMAL_MAP
    n = tilted(n, normal_map, 2);
#endif
    return gl_FrontFacing ? n : -n;
}

// How much the normal varies within the pixel, as what it adds to the square of alpha: Tokuyoshi and
// Kaplanyan, "Improved Geometric Specular Antialiasing" (2019), the isotropic one.
float normal_widening()
{
    vec3 n = normalize(central_normal);
    vec3 across = dFdx(n), down = dFdy(n);
    return min((dot(across, across) + dot(down, down)) / PI, 0.06);
}

// The square of alpha of a roughness, widened.
float widened(float roughness, float widening)
{
    float alpha = max(roughness * roughness, 0.002);
    return min(alpha * alpha + widening, 1.0);
}

// The roughness of that alpha, as the light around is looked up by.
float widened_roughness(float roughness, float widening)
{
    return widening > 0.0 ? sqrt(sqrt(widened(roughness, widening))) : roughness;
}

// Trowbridge and Reitz's microfacets with Smith's shadowing, over 4 times both cosines; `a2` is the
// square of alpha.
float glossy(float nh, float nl, float nv, float a2)
{
    float spread = nh * nh * (a2 - 1.0) + 1.0;
    return a2 / (PI * spread * spread)
        * 0.5 / (nl * sqrt(nv * nv * (1.0 - a2) + a2) + nv * sqrt(nl * nl * (1.0 - a2) + a2));
}

#ifdef USE_ANISOTROPY
// KHR_materials_anisotropy: unit vectors, of which highlights are stretched along the first, and
// alpha in that direction.
vec3 along, beside;
float stretched;

void find_stretch(float roughness, float widening)
{
    float alpha = max(roughness * roughness, 0.002);
    vec3 n = normalize(surface_normal), tangent, bitangent;
    float strength = layers.z;
    vec2 direction = vec2(cos(dielectric.w), sin(dielectric.w));
#ifdef USE_ANISOTROPY_MAP
    vec3 sampled = filtered(anisotropy_map, map_uv(12)).rgb;
    vec2 turned = normalize(sampled.rg * 2.0 - 1.0 + vec2(1e-6, 0.0));
    direction = mat2(direction, -direction.y, direction.x) * turned;
    strength *= sampled.b;
#endif
    if (!tangents(place, sheen.w < 0.5 ? chart.xy : chart.zw, n, tangent, bitangent)) {
        strength = 0.0;
        tangent = cross(n, abs(n.x) < 0.5 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0));
        bitangent = cross(n, tangent);
    }
    along = normalize(tangent * direction.x + bitangent * direction.y);
    beside = normalize(cross(n, along));
    stretched = mix(alpha, 1.0, strength * strength);
    stretched = sqrt(min(stretched * stretched + widening, 1.0));
}

// What facets do not hide from each other, by the product of the cosines to light and eye.
float unhidden(vec3 l, vec3 v, float nl, float nv, float alpha)
{
    float hidden = nl * length(vec3(stretched * dot(along, v), alpha * dot(beside, v), nv))
        + nv * length(vec3(stretched * dot(along, l), alpha * dot(beside, l), nl));
    return min(0.5 / hidden, 1.0);
}

float stretched_glossy(vec3 h, vec3 l, vec3 v, float nh, float nl, float nv, float narrow2)
{
    float alpha = sqrt(narrow2);
    float a2 = stretched * alpha;
    vec3 f = vec3(alpha * dot(along, h), stretched * dot(beside, h), a2 * nh);
    float w2 = a2 / dot(f, f);
    return a2 * w2 * w2 / PI * unhidden(l, v, nl, nv, alpha);
}
#endif

#ifdef USE_CLEARCOAT
vec3 coat_normal;
float coat_a2, coat_in_map;
vec3 coat = vec3(0.0);  // light that it reflects, but for its Fresnel term
#endif

#ifdef USE_SHEEN
// KHR_materials_sheen: fibres after Estevez and Kulla (2017).
vec3 fuzz = vec3(0.0);
vec3 fuzz_color;
float fuzz_roughness;

float fibre_fit(float x, float alpha)
{
    float s = (1.0 - alpha) * (1.0 - alpha);
    return mix(21.5473, 25.3245, s)
        / (1.0 + mix(3.82987, 3.32435, s) * pow(x, mix(0.19823, 0.16801, s)))
        + mix(-1.97760, -1.27393, s) * x + mix(-4.32054, -4.85967, s);
}

float fibre_shadow(float x, float alpha)
{
    return x < 0.5 ? exp(fibre_fit(x, alpha))
                   : exp(2.0 * fibre_fit(0.5, alpha) - fibre_fit(1.0 - x, alpha));
}

float fibres(vec3 n, vec3 v, vec3 l)
{
    float nl = min(dot(n, l), 1.0);
    if (nl <= 0.0) return 0.0;
    float nv = clamp(abs(dot(n, v)), 1e-4, 1.0);
    float nh = clamp(dot(n, normalize(l + v)), 0.0, 1.0);
    float alpha = fuzz_roughness * fuzz_roughness;
    float lobe = (2.0 + 1.0 / alpha) * pow(1.0 - nh * nh, 0.5 / alpha) / (2.0 * PI);
    float shadows = 1.0 + fibre_shadow(nv, alpha) + fibre_shadow(nl, alpha);
    return nl * lobe * min(1.0 / (shadows * 4.0 * nv * nl), 1.0);
}

// Share of even light that white fibres return: our fit to the integral of their lobe, to 0.01 rms.
float fibre_share(float nv)
{
    float r = max(fuzz_roughness, 0.1);
    vec3 c = vec3(0.1022, -0.6898, -1.5261) / r + vec3(-0.6472, -1.8652, 4.2535)
        + vec3(0.3144, 1.1422, -2.9285) * r;
    return min(exp(c.x + (c.y + c.z * nv) * nv), 1.0);
}
#endif

// The share of what a surface mirrors of the light around that the surround's map gives.
float share_of_map(float roughness)
{
#ifdef USE_SURROUND
    return clamp((0.6 - roughness) / 0.2, 0.0, 1.0);
#else
    return 0.0;
#endif
}

// What a lamp's light gives to layers above the base; `in_map` is 1 where the surround's map shows the
// lamp, which smooth layers then mirror there alone.
void light_layers(vec3 light, vec3 n, vec3 v, vec3 l, float in_map)
{
#ifdef USE_CLEARCOAT
    float nl = dot(coat_normal, l);
    if (nl > 0.0) {
        float nv = max(abs(dot(coat_normal, v)), 1e-4);
        float nh = max(dot(coat_normal, normalize(l + v)), 0.0);
        coat += light * nl * glossy(nh, nl, nv, coat_a2) * (1.0 - in_map * coat_in_map);
    }
#endif
#ifdef USE_SHEEN
    fuzz += light * fibres(n, v, l) * fuzz_color;
#endif
}

// `highlight`: share of what it mirrors of the light.
vec3 reflected(vec3 n, vec3 v, vec3 l, vec3 base, float metallic, float a2, float highlight)
{
    float nl = dot(n, l);
    if (nl <= 0.0) return vec3(0.0);
    float nv = max(abs(dot(n, v)), 1e-4);
    vec3 h = normalize(l + v);
    float nh = max(dot(n, h), 0.0);
    float grazing = pow(clamp(1.0 - dot(v, h), 0.0, 1.0), 5.0);
#ifdef USE_ANISOTROPY
    float lobe = stretched_glossy(h, l, v, nh, nl, nv, a2);
#else
    float lobe = glossy(nh, nl, nv, a2);
#endif
    lobe *= highlight;
    vec3 fresnel = mix(f0, vec3(f90), grazing);
    float kept = 1.0 - max(fresnel.r, max(fresnel.g, fresnel.b));
#ifdef USE_TRANSMISSION
    kept *= 1.0 - through;
#endif
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

// Light that a surface of some roughness mirrors from a direction; `soft`, which its harmonics
// tell, where it is rough.
vec3 mirrored_light(vec3 d, float roughness, vec3 soft)
{
#ifdef USE_SURROUND
    if (roughness < 0.6) {
        vec3 p = d / (abs(d.x) + abs(d.y) + abs(d.z));
        vec2 over = vec2(p.x < 0.0 ? -1.0 : 1.0, p.z < 0.0 ? -1.0 : 1.0);
        vec2 at = p.y < 0.0 ? (1.0 - abs(p.zx)) * over : p.xz;
        vec2 size = vec2(textureSize(surround_map, 0));
        float place = roughness / 0.2, finer = min(floor(place), 2.0);
        at = 0.5 * (size.x - 2.0) * (at + 1.0) + 1.0 + vec2(0.0, finer * size.x);
        vec3 one = textureLod(surround_map, at / size, 0.0).rgb;
        vec3 other = textureLod(surround_map, (at + vec2(0.0, size.x)) / size, 0.0).rgb;
        return mix(soft, mix(one, other, place - finer), share_of_map(roughness));
    }
#endif
    return soft;
}

#ifdef USE_ANISOTROPY
const int FACETS = 16;

// Light that a stretched lobe mirrors: the mean over facets that are tilted along the stretch, as often
// as their slopes are, each with a lobe that reaches the next one's.
vec3 mirrored_along(vec3 n, vec3 v, float narrow2)
{
    float alpha = sqrt(narrow2), most = sqrt(max(stretched * stretched - narrow2, 0.0));
    float roughness = sqrt(max(alpha, most / float(FACETS)));
    vec3 around = from_around(n), sum = vec3(0.0);
    float nv = max(abs(dot(n, v)), 1e-4), weights = 1e-30;
    for (int k = 0; k < FACETS; ++k) {
        float share = float(2 * k + 1) / float(FACETS) - 1.0;
        vec3 h = normalize(n + along * (most * share * inversesqrt(1.0 - share * share)));
        vec3 l = reflect(-v, h);
        float nl = dot(n, l), vh = dot(v, h);
        if (nl <= 0.0 || vh <= 0.0) continue;
        float weight = unhidden(l, v, nl, nv, alpha) * nl * vh / max(dot(n, h), 1e-4);
        sum += weight * mirrored_light(l, roughness, mix(from_around(l), around, roughness));
        weights += weight;
    }
    return sum / weights;
}
#endif

// A quadratic of y, and of x and y by its rows.
float quadratic(vec3 c, float y)
{
    return c.x + y * (c.y + y * c.z);
}
float biquadratic(vec3 still, vec3 once, vec3 twice, float x, float y)
{
    return quadratic(still, y) + x * (quadratic(once, y) + x * quadratic(twice, y));
}

// Share of even light that a rough mirror of that colour reflects: a fit of the lobe's integral with
// Schlick's edge (`rough_mirror` in `light.h`), and what bounces between facets (Fdez-Aguera 2019).
vec3 mirrored(vec3 color, float edge, float nv, float roughness)
{
    float alpha = roughness * roughness;
    float scale = biquadratic(
        vec3(0.03316, 8.70555, -6.2036), vec3(2.42758, -16.24609, 19.20866),
        vec3(9.5918, 2.49477, -12.18657), nv, alpha
    ) / biquadratic(
        vec3(1.0, 6.76272, -4.8963), vec3(-0.08257, -1.65557, 13.42527),
        vec3(11.08393, -11.41159, 11.4047), nv, alpha
    );
    float bias = biquadratic(
        vec3(0.92646, 0.12232, 0.18276), vec3(-2.19505, 0.88655, -1.37967),
        vec3(1.28238, -1.09258, 1.28171), nv, alpha
    ) / biquadratic(
        vec3(1.0, 13.85686, 11.31672), vec3(-0.09151, -48.11424, 221.28821),
        vec3(15.29834, 35.43781, -179.87302), nv, alpha
    );
    bias = max(bias, 0.0);
    return (color * scale + edge * bias) * (1.0 + color * (1.0 / (scale + bias) - 1.0));
}
#endif

#ifdef USE_TRANSMISSION
// KHR_materials_transmission without refraction: how much light of each colour goes straight on.
vec3 passed(vec3 base, float metallic, float nv)
{
    vec3 fresnel = mix(f0, vec3(f90), pow(1.0 - nv, 5.0));
    vec3 depth = volume.rgb;
#ifdef USE_THICKNESS_MAP
    depth *= filtered(thickness_map, map_uv(14)).g;
#endif
    float kept = 1.0 - max(fresnel.r, max(fresnel.g, fresnel.b));
    return kept * through * (1.0 - metallic) * base * exp(-depth);
}
#endif

#ifdef DEPTH_MAPS
const int CELL = 16;                                       // pixels of a cell of `highest` each way
const float NARROW = 6.0;                                  // radius from which on more taps look [px]
const float SHARPEST = 1.0;                                // radius of the filter [px]
const float BIAS = 1.0, SLOPE_BIAS = 0.5, STEEPEST = 64.0;  // [px], of the slope, [1]

// Points of the unit disc, of equal areas (Vogel 1979).
vec2 disc_point(int i, int count)
{
    float turn = float(i) * (PI * (3.0 - sqrt(5.0)));
    return sqrt((float(i) + 0.5) / float(count)) * vec2(cos(turn), sin(turn));
}

float nearness_at(int number, ivec2 at)
{
    int side = textureSize(depth_maps, 0).x;
    at = clamp(at, ivec2(0), ivec2(side - 1));
    return texelFetch(depth_maps, ivec2(at.x, number * side + at.y), 0).r;
}

// Whether what a pixel of a map shows lies before a point `there` (column, row, nearness).
float blocks(int number, ivec2 at, vec3 there, vec2 slope, float bias)
{
    float plane = there.z + dot(vec2(at) + 0.5 - there.xy, slope);
    return nearness_at(number, at) > max(plane, there.z) + bias ? 1.0 : 0.0;
}

float filter_radius(vec4 traits, float before)
{
    return clamp(traits.x * before, SHARPEST, traits.z);
}

// The share of a lamp's light that reaches the point, by percentage-closer soft shadows: as in the
// software rasteriser, `light_depth.cpp`. `facet`: normal of the triangle, facing the eye.
float visible(int number, vec3 facet, vec3 n, vec3 l)
{
    if (number < 0 || dot(n, l) <= 0.0) return 1.0;
    vec4 point = vec4(relative, 1.0);
    vec4 traits = views[8 * number + 7];  // softness, lift, largest radius
    float w = dot(views[8 * number + 3], point);
    if (w <= 0.0) return 1.0;
    vec3 there = vec3(dot(views[8 * number], point), dot(views[8 * number + 1], point),
                      dot(views[8 * number + 2], point)) / w;
    vec2 size = vec2(textureSize(depth_maps, 0).x);
    if (any(lessThan(there.xy, vec2(0.0))) || any(greaterThanEqual(there.xy, size))) return 1.0;
    vec2 slope = vec2(0.0);
    float bias = traits.y;
    if (dot(facet, l) > 0.0) {
        vec4 plane = vec4(facet, -dot(facet, relative));
        vec2 change = -vec2(dot(views[8 * number + 4], plane), dot(views[8 * number + 5], plane))
                      / dot(views[8 * number + 6], plane);
        float steepness = abs(change.x) + abs(change.y);
        if (steepness < STEEPEST) {
            slope = change;
            bias = min(BIAS + SLOPE_BIAS * steepness, bias);
        }
    }
    int cells = int(size.x) / CELL;
    ivec2 cell = ivec2(there.xy) / CELL;
    float highest = texelFetch(depth_maps, ivec2(cell.x, DEPTH_MAPS * int(size.x) + number * cells + cell.y), 0).r;
    if (highest <= there.z + bias) return 1.0;
    float radius = filter_radius(traits, highest - there.z), sum = 0.0, count = 0.0;
    int searched = radius <= NARROW ? 16 : 32;
    for (int i = 0; i < searched; ++i) {
        ivec2 at = ivec2(floor(there.xy + radius * disc_point(i, searched)));
        float blocked = blocks(number, at, there, slope, bias);
        sum += blocked > 0.0 ? nearness_at(number, at) - there.z : 0.0;
        count += blocked;
    }
    if (count == 0.0) return 1.0;
    radius = filter_radius(traits, sum / count);
    int taps = radius <= 2.0 ? 8 : radius <= 6.0 ? 16 : 32;
    float share = 0.0;
    for (int i = 0; i < taps; ++i) {
        vec2 at = there.xy + radius * disc_point(i, taps) - 0.5, corner = floor(at), part = at - corner;
        ivec2 first = ivec2(corner);
        float above = mix(blocks(number, first, there, slope, bias),
                          blocks(number, first + ivec2(1, 0), there, slope, bias), part.x);
        float below = mix(blocks(number, first + ivec2(0, 1), there, slope, bias),
                          blocks(number, first + ivec2(1, 1), there, slope, bias), part.x);
        share += mix(above, below, part.y);
    }
    return 1.0 - share / float(taps);
}
#endif

vec3 lit(vec3 base, float metallic, float roughness, vec3 glow)
{
    vec3 n = shading_normal();
    vec3 v = -normalize(relative);
    float widening = normal_widening();
    float a2 = widened(roughness, widening);
    float base_in_map = share_of_map(widened_roughness(roughness, widening));
    vec3 sum = vec3(0.0);
#ifdef USE_ANISOTROPY
    find_stretch(roughness, widening);
#endif
#ifdef USE_CLEARCOAT
    float coat_share = layers.x, coat_roughness = layers.y;
#ifdef USE_CLEARCOAT_MAP
    coat_share *= filtered(clearcoat_map, map_uv(7)).r;
#endif
#ifdef USE_CLEARCOAT_ROUGHNESS_MAP
    coat_roughness *= filtered(clearcoat_roughness_map, map_uv(8)).g;
#endif
    coat_normal = normalize(surface_normal);
#ifdef USE_CLEARCOAT_NORMAL_MAP
    coat_normal = tilted(coat_normal, clearcoat_normal_map, 9);
#endif
    coat_normal = gl_FrontFacing ? coat_normal : -coat_normal;
    coat_a2 = widened(coat_roughness, widening);
    coat_in_map = share_of_map(widened_roughness(coat_roughness, widening));
    float coat_nv = clamp(abs(dot(coat_normal, v)), 0.0, 1.0);
    coat_share *= 0.04 + 0.96 * pow(1.0 - coat_nv, 5.0);
#endif
#ifdef USE_SHEEN
    fuzz_color = sheen.rgb;
    fuzz_roughness = layers.w;
#ifdef USE_SHEEN_COLOR_MAP
    fuzz_color *= filtered(sheen_color_map, map_uv(10)).rgb;
#endif
#ifdef USE_SHEEN_ROUGHNESS_MAP
    fuzz_roughness *= filtered(sheen_roughness_map, map_uv(11)).a;
#endif
    fuzz_roughness = clamp(fuzz_roughness, 0.07, 1.0);
    float fuzz_share = fibre_share(clamp(abs(dot(n, v)), 0.0, 1.0));
#endif
#ifdef DEPTH_MAPS
    vec3 facet = cross(dFdx(place), dFdy(place));
    facet = dot(facet, v) < 0.0 ? -facet : facet;
#endif
    for (int i = 0; i < DIRECTIONAL_COUNT; ++i) {
        vec3 l = lamps[4 * i + 2].xyz;
        vec3 light = lamps[4 * i].rgb;
#ifdef DEPTH_MAPS
        light *= visible(int(lamps[4 * i + 3].z) - 1, facet, n, l);
#endif
        float in_map = lamps[4 * i].w;
        sum += light * reflected(n, v, l, base, metallic, a2, 1.0 - in_map * base_in_map);
        light_layers(light, n, v, l, in_map);
    }
    for (int i = DIRECTIONAL_COUNT; i < LAMP_COUNT; ++i) {
        vec3 offset = lamps[4 * i + 1].xyz - relative;
        float distance_squared = max(dot(offset, offset), 1e-30);
        vec3 l = offset * inversesqrt(distance_squared);
        float beyond = distance_squared * lamps[4 * i + 1].w;
        float window = clamp(1.0 - beyond * beyond, 0.0, 1.0);
        // A point light has scale 0 and offset 1 here: full in all directions.
        vec4 cone = lamps[4 * i + 3];
        float spot = clamp(dot(lamps[4 * i + 2].xyz, l) * cone.x + cone.y, 0.0, 1.0);
        vec3 light = lamps[4 * i].rgb * (window * spot * spot / distance_squared);
#ifdef DEPTH_MAPS
        light *= visible(int(cone.z) - 1, facet, n, l);
#endif
        float in_map = lamps[4 * i].w;
        sum += light * reflected(n, v, l, base, metallic, a2, 1.0 - in_map * base_in_map);
        light_layers(light, n, v, l, in_map);
    }
#ifdef USE_AMBIENT
    float occlusion = 1.0;
#ifdef USE_OCCLUSION_MAP
    occlusion = 1.0 + uv_rows[7].w * (filtered(occlusion_map, map_uv(3)).r - 1.0);
#endif
    vec3 r = reflect(-v, n);
    vec3 around = from_around(n);
    float wide = widened_roughness(roughness, widening);
#ifdef USE_ANISOTROPY
    vec3 ahead = mirrored_along(n, v, a2);
#else
    vec3 ahead = mirrored_light(r, wide, mix(from_around(r), around, wide));
#endif
    vec3 color = mix(f0, base, metallic);
    float nv = clamp(dot(n, v), 0.0, 1.0);
    // As under lamps, what the dielectric mirrors is not scattered, alike for all colours.
    vec3 kept = 1.0 - mirrored(vec3(max(f0.r, max(f0.g, f0.b))), f90, nv, roughness);
    sum += occlusion * (around * base * max(kept, 0.0) * ((1.0 - metallic) * (1.0 - through))
                        + ahead * mirrored(color, mix(f90, 1.0, metallic), nv, roughness));
#ifdef USE_CLEARCOAT
    vec3 coat_r = reflect(-v, coat_normal);
    float coat_wide = widened_roughness(coat_roughness, widening);
    vec3 soft = mix(from_around(coat_r), from_around(coat_normal), coat_wide);
    coat += occlusion * mirrored_light(coat_r, coat_wide, soft);
#endif
#ifdef USE_SHEEN
    fuzz += occlusion * around * fuzz_share * fuzz_color;
#endif
#endif
#ifdef USE_TRANSMISSION
    vec3 passing = passed(base, metallic, min(abs(dot(n, v)), 1.0));
#endif
#ifdef USE_SHEEN
#ifdef USE_TRANSMISSION
    passing *= 1.0 - max(fuzz_color.r, max(fuzz_color.g, fuzz_color.b)) * fuzz_share;
#endif
    sum *= 1.0 - max(fuzz_color.r, max(fuzz_color.g, fuzz_color.b)) * fuzz_share;
    sum += fuzz;
#endif
    sum += glow;
#ifdef USE_CLEARCOAT
    sum = mix(sum, coat, coat_share);
#ifdef USE_TRANSMISSION
    passing *= 1.0 - coat_share;
#endif
#endif
#ifdef USE_TRANSMISSION
    // One alpha for all colours: in which of them it differs from that, and what roughness
    // scatters, is taken from the light around, as blurred.
    float frosted = min(roughness * volume.w, 1.0);
    shown = min(dot(passing, vec3(0.2126, 0.7152, 0.0722)), 1.0) * (1.0 - frosted);
#ifdef USE_AMBIENT
    sum += (passing - shown) * mirrored_light(-v, max(frosted, 0.2), from_around(-v));
#endif
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
    base *= filtered(base_color_map, map_uv(0));
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
    vec4 sampled = filtered(metallic_roughness_map, map_uv(1));
    metallic *= sampled.b;
    roughness *= sampled.g;
#endif
#ifdef USE_SPECULAR_MAP
    f90 *= filtered(specular_map, map_uv(5)).a;
#endif
#ifdef USE_SPECULAR_COLOR_MAP
    f0 *= filtered(specular_color_map, map_uv(6)).rgb;
#endif
#ifdef USE_TEXTURED_SPECULAR
    f0 = min(f0, vec3(1.0)) * f90;
#endif
#ifdef USE_TRANSMISSION
    through = emissive.w;
#ifdef USE_TRANSMISSION_MAP
    through *= filtered(transmission_map, map_uv(13)).r;
#endif
#endif
    vec3 glow = emissive.rgb;
#ifdef USE_EMISSIVE_MAP
    glow *= filtered(emissive_map, map_uv(4)).rgb;
#endif
    vec3 color = lit(base.rgb, clamp(metallic, 0.0, 1.0), clamp(roughness, 0.0, 1.0), glow);
#endif
    // The target holds half floats: an overflow to infinity would spread through the blur.
    radiance = vec4(min(color, vec3(60000.0)) * alpha, alpha * (1.0 - shown));
#ifdef USE_FRONT
    // What is behind hides what is farther still, and gives no light.
    if (gl_FragCoord.z >= texelFetch(limit, ivec2(gl_FragCoord.xy), 0).r) radiance = vec4(0.0);
#endif
}

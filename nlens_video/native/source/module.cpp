// The module's functions, area by area; each area binds its kernels in its own file.
#include "module.h"

namespace nb = nanobind;

namespace {

// The module of the highest level that this processor runs.
const char* best_module() {
#if defined(__x86_64__)
    __builtin_cpu_init();
    const bool v3 =
        __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && __builtin_cpu_supports("bmi2");
    const bool v4 = v3 && __builtin_cpu_supports("avx512f") && __builtin_cpu_supports("avx512bw") &&
                    __builtin_cpu_supports("avx512cd") && __builtin_cpu_supports("avx512dq") &&
                    __builtin_cpu_supports("avx512vl");
    if (v4) return "_x86_64_v4";
    if (v3) return "_x86_64_v3";
#endif
    return "_baseline";
}

}  // namespace

NB_MODULE(NLENS_MODULE, module) {
    module.def("best_module", &best_module, "Name of the module for this processor.");
    nlens::bind_alpha(module);
    nlens::bind_animation(module);
    nlens::bind_aperture_covariance(module);
    nlens::bind_blend(module);
    nlens::bind_bounce(module);
    nlens::bind_coc_discontinuities(module);
    nlens::bind_composite_over(module);
    nlens::bind_deferred(module);
    nlens::bind_depth_layers(module);
    nlens::bind_exposure(module);
    nlens::bind_grain(module);
    nlens::bind_layers(module);
    nlens::bind_light(module);
    nlens::bind_light_depth(module);
    nlens::bind_materials(module);
    nlens::bind_paper_scatter(module);
    nlens::bind_plane_blur(module);
    nlens::bind_projection(module);
    nlens::bind_raster(module);
    nlens::bind_scatter(module);
    nlens::bind_scatter_discs(module);
    nlens::bind_scatter_extend(module);
    nlens::bind_scatter_levels(module);
    nlens::bind_scatter_normalize(module);
    nlens::bind_shadow_coverage(module);
    nlens::bind_shadow_maps(module);
    nlens::bind_shadow_transparency(module);
    nlens::bind_skinning(module);
    nlens::bind_subaperture_gather(module);
    nlens::bind_textures(module);
    nlens::bind_triangles(module);
}

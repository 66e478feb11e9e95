// What every file with bindings needs.
#pragma once

#include <nanobind/nanobind.h>

#include "casters.h"

namespace nlens {

// Kernels touch no Python object, so other threads may run Python meanwhile.
using Unlocked = nanobind::call_guard<nanobind::gil_scoped_release>;

void bind_alpha(nanobind::module_& module);
void bind_animation(nanobind::module_& module);
void bind_aperture_covariance(nanobind::module_& module);
void bind_blend(nanobind::module_& module);
void bind_bounce(nanobind::module_& module);
void bind_coc_discontinuities(nanobind::module_& module);
void bind_composite_over(nanobind::module_& module);
void bind_deferred(nanobind::module_& module);
void bind_depth_layers(nanobind::module_& module);
void bind_exposure(nanobind::module_& module);
void bind_grain(nanobind::module_& module);
void bind_layers(nanobind::module_& module);
void bind_light(nanobind::module_& module);
void bind_light_depth(nanobind::module_& module);
void bind_materials(nanobind::module_& module);
void bind_paper_scatter(nanobind::module_& module);
void bind_plane_blur(nanobind::module_& module);
void bind_projection(nanobind::module_& module);
void bind_raster(nanobind::module_& module);
void bind_scatter(nanobind::module_& module);
void bind_scatter_discs(nanobind::module_& module);
void bind_scatter_extend(nanobind::module_& module);
void bind_scatter_levels(nanobind::module_& module);
void bind_scatter_normalize(nanobind::module_& module);
void bind_shadow_coverage(nanobind::module_& module);
void bind_shadow_maps(nanobind::module_& module);
void bind_shadow_transparency(nanobind::module_& module);
void bind_skinning(nanobind::module_& module);
void bind_subaperture_gather(nanobind::module_& module);
void bind_textures(nanobind::module_& module);
void bind_triangles(nanobind::module_& module);

}  // namespace nlens

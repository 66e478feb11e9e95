"""Functions of the compiled modules. Arrays are C-contiguous unless a comment says otherwise."""

from typing import Any

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Float32, Float64

_Int32 = npt.NDArray[np.int32]
_Int64 = npt.NDArray[np.int64]
_Bits = npt.NDArray[np.uint8]

_Atlas = tuple[npt.NDArray[np.uint16], npt.NDArray[np.int64], npt.NDArray[np.int64]]
_Mesh = tuple[Float32, Float32, Float32, Float32, _Int32, _Int32, Float32]
_Paint = tuple[Float32, _Int32, _Int32, _Atlas]
_DepthMaps = tuple[Float32, Float32, Float32]
_Lights = tuple[Float32, int, Float32, Float32, _DepthMaps]
_Scene = tuple[_Mesh, _Paint, Float32, _Lights]
_Shape = tuple[Float64, Float32, _Int32, Float64]
_Triangles = tuple[_Shape, _Int32]

# area by area, one of `source/*.cpp` each

def best_module() -> str: ...

# alpha.cpp
def cut_out_triangles(
    drawn: _Int32,
    rows: tuple[int, int],
    width: int,
    triangles: _Triangles,
    mesh: _Mesh,
    paint: _Paint,
    most: Float32,
    disparity: Float32,
    ids: _Int32,
    /,
) -> None: ...
def blend_triangles(
    drawn: _Int32,
    rows: tuple[int, int],
    width: int,
    triangles: _Triangles,
    scene: _Scene,
    disparity: Float32,
    changed: tuple[Float32, Float32, Float32],
    /,
) -> None: ...

# animation.cpp
STEP_LEAD_S: float

def sample_tracks(
    time_s: float, tracks: _Int64, times: Float64, values: Float64, out: Float64, /
) -> None: ...
def multiply_nodes(
    local: Float64, order: _Int64, matrices: Float64, has_matrix: Bool, world: Float64, /
) -> None: ...

# aperture_covariance.cpp
def aperture_covariance(
    near: tuple[Float32, ...],
    back: tuple[Float32, ...],
    points: Float32,
    aspect: float,
    wanted: Bool,
    out: Float32,
    band: tuple[int, int],
    /,
) -> None: ...
def edge_parallax(
    rgba: Float32,
    plate: Float32,
    cocs: tuple[Float32, ...],
    trust: Float32,
    table: Float32,
    numbers: tuple[int, int, float, float],
    out: Float32,
    band: tuple[int, int],
    /,
) -> None: ...

# blend.cpp; planes may have any strides
STEPS_BITS: int
FIRST_OCTAVE: int
_Plane = npt.NDArray[Any]
_Planes = tuple[_Plane, ...]
_Axis = tuple[int, int, int, Float32]

def linear(
    planes: _Planes,
    axes: tuple[_Axis, _Axis],
    corner: tuple[int, int],
    rgb_from_codes: Float32,
    to_linear: Float32,
    to_bt709: Float32,
    to_display: Float32,
    out: Float32,
    /,
) -> None: ...
def green_patches(
    planes: _Planes,
    axes: tuple[_Axis, _Axis],
    corners: _Int32,
    rgb_from_codes: Float32,
    to_linear: Float32,
    to_bt709: Float32,
    out: Float32,
    /,
) -> None: ...
def downsample(
    planes: _Planes, rgb_from_codes: Float32, to_linear: Float32, to_bt709: Float32, out: Float32, /
) -> None: ...
def composite_over(
    planes: _Planes,
    alpha: _Plane,
    flags: tuple[bool, bool],
    before: tuple[_Plane, ...],
    axes: tuple[_Axis, _Axis],
    corner: tuple[int, int],
    rgba: Float32,
    tables: tuple[Float32, Float32, Float32, Float32, Float32, Float32],
    peak: float,
    rows: tuple[int, int],
    /,
) -> None: ...

# bounce.cpp
def gather_patches(points: Float32, patches: Float32, irradiance: Float32, /) -> None: ...

# coc_discontinuities.cpp
_Step = tuple[float, float, float, float]

def find_steps(
    coc: Float32, alpha: Float32, away: Float32, step: _Step, marks: tuple[Float32, Float32], /
) -> bool: ...
def find_rims(
    coc: Float32,
    alpha: Float32,
    nearest: tuple[Float32, Float32],
    step: _Step,
    marks: tuple[Float32, Float32],
    /,
) -> bool: ...
def chamfer(reach: Float32, /) -> None: ...
def carry_labels(values: Float32, known: Bool, labels: _Int32, out: Float32, /) -> None: ...

# deferred.cpp
def shade_rows(
    first: int,
    last: int,
    width: int,
    ids: _Int32,
    passed: Float32,
    scene: _Scene,
    rgba: Float32,
    /,
) -> None: ...
def resolve_depth(
    disparity: Float32, first: int, last: int, least: float, depth: Float32, /
) -> None: ...

# depth_layers.cpp
def take_back_out(near_rgba: Float32, near: Bool, back: Bool, filled: Float32, /) -> None: ...
def part_layers(
    near: Bool,
    whole: Float32,
    alone: Float32,
    hidden: Float32,
    near_rgba: Float32,
    back_rgba: Float32,
    /,
) -> None: ...
def halve(
    values: Float32, weight: Float32, offset: tuple[int, int], out: Float32, kept: Float32, /
) -> None: ...
def raise_level(
    fine: Float32, weight: Float32, coarse: Float32, offset: tuple[int, int], out: Float32, /
) -> None: ...

# exposure.cpp
def take_stops(light: Float32, known: tuple[float, float], stops: Float32, /) -> None: ...
def take_change(
    before: Float32, now: Float32, least_share: float, most_spread: float, change: Float64, /
) -> bool: ...

# grain.cpp
def regrain(
    rgba: Float32,
    plate: Float32,
    noise: Float32,
    deviation: Float32,
    codes: Float32,
    lights: Float32,
    /,
) -> None: ...
def restore_grain(
    rgba: Float32,
    plate: Float32,
    noise: Float32,
    deviation: Float32,
    least_loss: float,
    full_loss: float,
    /,
) -> None: ...
def white_noise(
    out: Float32, corner: tuple[int, int], moment: int, seed: int, scale: float, /
) -> None: ...
def add_tiles(out: Float32, tile: Float32, corners: _Int64, shares: Float32, /) -> None: ...

# layers.cpp
def light_layers(rows: Float32, paint: _Paint, lights: _Lights, /) -> None: ...

# light.cpp; rows of a block of 64 points
SURROUND_LEVELS: int
SURROUND_ROUGHEST: float

def light_points(rows: Float32, lights: _Lights, /) -> None: ...

# light_depth.cpp
LIGHT_DEPTH_CELL: int
LIGHT_DEPTH_MAPS: int

def draw_nearness(
    points: Float32,
    faces: _Int32,
    cutout: tuple[Float32, Float32, tuple[int, int], float],
    first: int,
    last: int,
    map: Float32,
    /,
) -> None: ...
def highest_in_cells(map: Float32, highest: Float32, /) -> None: ...
def visible_points(
    maps: _DepthMaps,
    number: int,
    places: Float32,
    facets: Float32,
    towards: Float32,
    shares: Float32,
    /,
) -> None: ...

# materials.cpp
UNLIT: int
OPAQUE: int
LAYERED: int
CUT: int

# paper_scatter.cpp
RIM_PX: float
RIM_STEPS: int

def paper_scatter_rows(
    light: Float32,
    radius_px: Float32,
    rim: Float32,
    out: Float32,
    dilated: Float32,
    band: tuple[int, int],
    /,
) -> None: ...

# plane_blur.cpp
def sum_plane_rows(values: Float32, pad: int, sums: _Int32, steps: Float32, /) -> None: ...
def blur_plane_rows(
    sums: _Int32,
    steps: Float32,
    pad: int,
    radii: Float64,
    block: int,
    pixel_aspect: float,
    corner: tuple[int, int],
    out: Float32,
    rows: tuple[int, int],
    /,
) -> None: ...

# projection.cpp; positions of any strides for `screen_bounds`
def project(positions: Float32, lens: Float64, points: Float64, /) -> None: ...
def screen_places(positions: Float32 | Float64, lens: Float64, found: Float64, /) -> None: ...
def screen_bounds(
    positions: Float32 | Float64, lens: Float64, /
) -> tuple[float, float, float, float, float, float]: ...
def travel_bound(points: Float64, lenses: Float64, /) -> float: ...

# raster.cpp
PADDING: int

def fill_triangles(
    drawn: _Int32,
    first: int,
    last: int,
    shape: _Shape,
    spans: _Int32,
    width: int,
    disparity: Float32,
    ids: _Int32,
    /,
) -> None: ...
def fill_triangles_behind(
    drawn: _Int32,
    first: int,
    last: int,
    shape: _Shape,
    spans: _Int32,
    most: Float32,
    planes: Float32,
    disparity: Float32,
    ids: _Int32,
    /,
) -> None: ...

# scatter.cpp; rows of `sums` may lie apart
_Discs = tuple[Float32, Float32, tuple[int, int], tuple[int, int], float, float]

def scatter_rows(
    light: tuple[Float32, Float32],
    rows: _Int32,
    discs: _Discs,
    columns: tuple[Float64, Float64],
    coarse: tuple[Float32, int, int],
    largest: float,
    rim: float,
    sums: Float32,
    origin: tuple[int, int],
    band: tuple[int, int],
    /,
) -> None: ...

# scatter_discs.cpp
def vignette_discs(
    numbers: Float32,
    discs: _Discs,
    corner: tuple[float, float, float],
    barrel: tuple[float, float],
    band: tuple[int, int],
    /,
) -> None: ...

# scatter_extend.cpp
_Made = tuple[Float32, Float32, Float32]

def survey_layer(
    rgba: Float32,
    coc_px: Float32,
    first: _Int32,
    last: _Int32,
    largest: Float32,
    band: tuple[int, int],
    /,
) -> None: ...
def cut_layer(
    rgba: Float32,
    coc_px: Float32,
    corner: tuple[int, int],
    coc: Float32,
    away: _Bits,
    band: tuple[int, int],
    /,
) -> None: ...
def find_places(away: _Bits, labels: _Int32, places: _Int32, /) -> None: ...
def lay_out_object(
    rgba: Float32,
    coc: Float32,
    away: _Bits,
    made: _Made,
    corner: tuple[int, int],
    limits: tuple[float, float, float],
    band: tuple[int, int],
    /,
) -> None: ...
def lay_out_background(
    rgba: Float32,
    nearest: tuple[_Int32, _Int32, Float32],
    away: _Bits,
    made: _Made,
    corner: tuple[int, int],
    limits: tuple[float, float, float],
    band: tuple[int, int],
    /,
) -> None: ...

# scatter_levels.cpp
_Rule = tuple[float, float, float, float, float]

def gather_levels(
    layer: tuple[Float32, Float32, Float32],
    sums: Float32,
    places: _Int64,
    corner: tuple[int, int],
    starts: tuple[float, float],
    band: tuple[int, int],
    /,
) -> None: ...
def fill_fine_level(
    radii: Float32,
    skews: Float32,
    numbers: Float32,
    rows: _Int32,
    rule: _Rule,
    starts: tuple[float, float],
    band: tuple[int, int],
    /,
) -> None: ...
def fill_coarse_level(
    sums: Float32,
    rgba: Float32,
    numbers: Float32,
    rows: _Int32,
    rule: _Rule,
    size: int,
    band: tuple[int, int],
    /,
) -> None: ...

# scatter_normalize.cpp; rows of `out` may lie apart
def reach_columns(
    first: _Int32,
    last: _Int32,
    radius: Float32,
    shape: tuple[float, float, int],
    low: Float64,
    high: Float64,
    /,
) -> None: ...
def normalise_sums(
    sums: Float32,
    columns: tuple[Float64, Float64],
    origin: tuple[int, int],
    out: Float32,
    band: tuple[int, int],
    /,
) -> None: ...

# shadow_coverage.cpp
PER_PIXEL: int
PROJECTIONS: int

def mark_covered(
    bits: _Bits,
    mesh: tuple[Float64, _Int32, _Int32],
    projections: tuple[_Bits, Float64, Float64],
    held: tuple[_Int32, npt.NDArray[np.int8]],
    /,
) -> None: ...

# shadow_maps.cpp
_Views = tuple[Float64, int, _Int32]

def first_surfaces(
    points: Float32, views: _Views, sides: _Int32, first: Float32, nearest: Float64, /
) -> None: ...
def may_be_blocked(points: Float32, views: _Views, nearest: Float64, found: Bool, /) -> None: ...
def add_blocked(
    points: Float32,
    views: _Views,
    drawn: tuple[_Int32, Float32, Float64, _Bits, Float32],
    weights: tuple[Float32, Float32],
    sums: Float32,
    /,
) -> None: ...
def lost_light(shares: Float32, given: Float64, loss: Float32, /) -> None: ...
def ambient_light(normals: Float64, ambient: Float64, light: Float64, /) -> None: ...
def best_slopes(
    across: Float64, down: Float64, left: Float64, reach: int, slopes: Float32, /
) -> None: ...

# shadow_transparency.cpp
def absorb(
    sums: tuple[Float32, Float32, _Int32],
    opaque: tuple[_Bits, int],
    points: Float64,
    surface: Float64,
    faces: _Int32,
    texture: tuple[Float32, tuple[int, int], float],
    call: int,
    at: tuple[float, float],
    /,
) -> None: ...

# skinning.cpp
def carry(
    positions: Float32,
    directions: Float32,
    carrier: Float64,
    turner: Float64,
    placed: Float32,
    turned: Float32,
    /,
) -> None: ...
def skin(
    positions: Float32,
    directions: Float32,
    joints: _Int32,
    weights: Float32,
    matrices: Float32,
    placed: Float32,
    turned: Float32,
    /,
) -> None: ...

# subaperture_gather.cpp
GATHERED_COLUMNS: int
GATHERED_PLANES: int

def lay_out(
    light: Float32,
    covered: Bool,
    coc_px: Float32,
    table: Float32,
    steps: float,
    start: tuple[int, int, int],
    planes: Float32,
    widest: Float32,
    /,
) -> None: ...
def gather(
    planes: Float32,
    widest: Float32,
    reach: tuple[int, int],
    places: _Int32,
    distances: Float32,
    out: Float32,
    /,
) -> None: ...

# textures.cpp; coordinates, their change by a column and by a row (6, n), and linear RGBA (4, n)
def sample_texture(uv: Float32, atlas: _Atlas, texture: int, out: Float32, /) -> None: ...

# triangles.cpp
def set_up_triangles(
    shape: _Shape,
    sides: _Bits,
    width: int,
    lines: int,
    spans: _Int32,
    planes: Float32,
    kept: _Int32,
    /,
) -> int: ...

"""Functions of the compiled modules. Arrays are C-contiguous unless a comment says otherwise."""

from typing import Any

import numpy.typing as npt

from nlens_video.core.layers import Float32

# area by area, one of `source/*.cpp` each

def best_module() -> str: ...

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
    /,
) -> None: ...

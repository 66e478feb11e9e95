"""Code values in which grain is measured and added: sRGB up to white, in HDR beyond it.

Grain varies least with the level in the plate's own code, which is PQ or HLG in HDR. Light itself
has no code; there the curve of sRGB goes on beyond white, for unlike theirs it is linear in the
dark, where noise is as large as the light.
"""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np
from msgspec import Struct

from nlens_video.core.color import transfer
from nlens_video.core.layers import Float32

_STEPS = 4096
_LEAST_OF_PQ = 10.0  # light at which HDR codes end that are no HLG, which ends at 3.8 [1]
_TOP = 64.0  # above the 49 of PQ; light divided by it keeps all its digits [1]


class GrainCode(Struct, frozen=True, kw_only=True):
    """A code for light.

    Attributes:
        curve: name of its transfer function.
        top: largest light that it holds: what is brighter gets no grain [1].
        per_unit: levels at which a deviation is measured, by its code values [1].
    """

    curve: str
    top: float
    per_unit: float

    @classmethod
    def of(cls, peak: float, clip: float) -> GrainCode:
        """The code for a plate.

        Args:
            peak: light at which the plate's codes end.
            clip: light at which it clips.
        """
        if math.isinf(peak):
            return LIGHT if clip > 1.0 else SDR
        if peak <= 1.0:
            return SDR
        return HLG if peak < _LEAST_OF_PQ else PQ

    @property
    def end(self) -> float:
        """Largest code value."""
        return float(self.to_code(np.array(self.top, np.float32)))

    def to_code(self, light: Float32) -> Float32:
        """Code values of scene-linear light."""
        return transfer(self.curve).to_coded(light.astype(np.float64)).astype(np.float32)

    def to_linear(self, code: Float32) -> Float32:
        """Scene-linear light of code values."""
        return transfer(self.curve).to_linear(code.astype(np.float64)).astype(np.float32)

    def normalised(self, light: Float32) -> Float32:
        """Light by the largest one."""
        return light if self.top == 1.0 else light / np.float32(self.top)

    @property
    def tables(self) -> tuple[Float32, Float32]:
        """Codes by the root of the light, light by code, all of them by the largest one."""
        return _tables(self)


SDR = GrainCode(curve="iec61966-2-1", top=1.0, per_unit=12.0)
HLG = GrainCode(curve="arib-std-b67", top=_TOP, per_unit=24.0)
PQ = GrainCode(curve="smpte2084", top=_TOP, per_unit=24.0)
LIGHT = GrainCode(curve="iec61966-2-1", top=_TOP, per_unit=24.0)


@lru_cache(maxsize=4)
def _tables(code: GrainCode) -> tuple[Float32, Float32]:
    at = np.linspace(0.0, 1.0, _STEPS + 1)
    codes = code.to_code((code.top * at * at).astype(np.float32)) / np.float32(code.end)
    lights = code.to_linear((code.end * at).astype(np.float32))
    return codes, code.normalised(lights)

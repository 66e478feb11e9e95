"""What composites are made on: a plate, its true lens, its truth, and where the object ends."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import binary_erosion, distance_transform_edt

from nlens_video.core.layers import Bool, DefocusedLayer, Float32, ObjectLayer
from nlens_video.evaluate.bench.case import Case, case_of
from nlens_video.evaluate.bench.glb_writer import UInt8
from nlens_video.evaluate.metrics import WINDOW, psnr, ssim_map
from nlens_video.evaluate.plates import Plate, load_plate

_FARTHEST = 1e4  # object depths beyond this mean "nothing there" [scene unit]
_RIM_PX = 2.0  # of the renderer's reconstruction filter, on either side of a sharp outline


@dataclass(frozen=True, slots=True, kw_only=True)
class Subject:
    """A plate that composites are made on.

    Attributes:
        case: plate, object and truth.
        known: what is known of the plate's lens and depth.
        coc_px: true signed CoC of the object, off it that of its nearest pixel (H, W) [px].
        band: pixels over which the true lens mixes object and plate (H, W).
    """

    case: Case
    known: Plate
    coc_px: Float32
    band: Bool

    def score(self, picture: UInt8) -> dict[str, float]:
        """PSNR [dB] and SSIM [1] of a composite (H, W, 3) in the object's box, and in the band."""
        rows, columns = np.nonzero(self.band)
        part = np.s_[_span(rows), _span(columns)]
        seen, truth, band = picture[part], self.case.truth[part], self.band[part]
        rim = WINDOW // 2
        likeness = ssim_map(seen, truth)[band[rim:-rim, rim:-rim]]
        return self.case.score(picture) | {
            "band_psnr_db": psnr(seen[band], truth[band]),
            "band_ssim": float(likeness.mean()),
        }

    def truly_defocused(self, layer: ObjectLayer) -> DefocusedLayer:
        """The object with its true CoC, pixel by pixel; the layer must lie within the frame."""
        box = layer.box
        coc = self.coc_px[box.y0 : box.y1, box.x0 : box.x1].copy()
        coc[layer.rgba[..., 3] <= 0] = 0.0
        return DefocusedLayer(layer=layer, coc_px=coc)


def load_subject(folder: Path) -> Subject:
    """Read a plate, its object and its truth.

    Raises:
        InputError: a file is missing, cannot be read or does not fit the others.
        SceneError: the GLB cannot be used.
    """
    known = load_plate(folder)
    there = (known.object_depth > 0) & (known.object_depth < _FARTHEST)
    coc = known.object_coc_px[_nearest(there)]
    outline = there & ~binary_erosion(there, border_value=1)  # no outline where the frame cuts
    away = distance_transform_edt(~outline)
    band = away <= 0.5 * np.abs(coc[_nearest(outline)]) + _RIM_PX
    return Subject(case=case_of(folder, known), known=known, coc_px=coc, band=band)


def _nearest(known: Bool) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of the nearest known pixel, for every pixel (H, W) each."""
    rows, columns = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return rows, columns


def _span(at: np.ndarray) -> slice:
    """From the first to the last of some rows or columns, with room for a window around them."""
    return slice(max(int(at.min()) - WINDOW // 2, 0), int(at.max()) + WINDOW // 2 + 1)

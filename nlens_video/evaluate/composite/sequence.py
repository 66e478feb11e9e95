"""Sequences with known lens: a folder each, rendered with true depth of field frame by frame.

A sequence is a folder that holds `gt_patch/NNNN.png` (the truth: RGBA, opaque within the object's
reach, 0000 the first frame), and beside it `bg.mp4`, `object.glb`, `object/NNNN.exr` and
`params.json` with `fps`, `focus_distance_m`, `coc_at_infinity_px` and, for each frame, `frames`.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Bool, Float32, UInt8
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.plates import read_codes
from nlens_video.video.exr import read_layer

MARK = "gt_patch"
_PLATE = "bg.mp4"
_LAYERS = "object/%04d.exr"
PARTS = (_PLATE, "object.glb", "object", "params.json")
_SOLID = 0.98  # coverage from which on a pixel has one depth


class Sequence(Struct, frozen=True, kw_only=True):
    """A sequence: its files and its true lens.

    Attributes:
        folder: of its files.
        fit: the true lens.
        rate: frames per second, as the command line takes it [1/s].
        frames: how many it has [1].
    """

    folder: Path
    fit: LensFit
    rate: str
    frames: int

    @property
    def layers(self) -> str:
        """Pattern of the object's layers."""
        return str(self.folder / _LAYERS)

    def truth(self, index: int) -> tuple[UInt8, Bool]:
        """Code values (H, W, 3) of a frame as the lens sees it, and where they are given (H, W).

        Raises:
            InputError: it cannot be read.
        """
        path = self.folder / MARK / f"{index:04d}.png"
        codes = read_codes(path, (self.fit.height, self.fit.width), rgba=True)
        return codes[..., :3], codes[..., 3] > 0

    def object_disparity(self, index: int) -> Float32:
        """Disparity (n,) of the pixels that the object covers wholly on a frame [1 / scene unit].

        Raises:
            InputError: the layer cannot be read.
        """
        layer = read_layer(Path(self.layers % index), (self.fit.width, self.fit.height))
        solid = (layer.rgba[..., 3] > _SOLID) & np.isfinite(layer.depth)
        return np.asarray(1.0 / layer.depth[solid], np.float32)

    def write_plate(self, folder: Path) -> str:
        """Write the plate's code values as lossless pictures.

        The truth is in sRGB and so are the plate's code values, whatever transfer its tags name:
        read through the tag of a video, the object would be coded by another curve than the truth.

        Args:
            folder: gets a picture for each frame.

        Returns:
            Their pattern.

        Raises:
            InputError: the plate cannot be read, or has other pictures than the truth.
        """
        written = 0
        for written, rgb in enumerate(_decoded(self.folder / _PLATE), start=1):
            if rgb.shape[:2] != (self.fit.height, self.fit.width):
                raise InputError(
                    f"{self.folder / _PLATE}: {rgb.shape[1]}x{rgb.shape[0]} pixels, the truth has "
                    f"{self.fit.width}x{self.fit.height}"
                )
            cv2.imwrite(str(folder / f"{written - 1:04d}.png"), rgb[..., ::-1])
        if written != self.frames:
            raise InputError(
                f"{self.folder / _PLATE}: {written} frames, params.json tells of {self.frames}"
            )
        return str(folder / "%04d.png")


def load_sequence(folder: Path) -> Sequence:
    """Read what describes a sequence.

    Raises:
        InputError: the description cannot be read, or its lens changes.
    """
    path = folder / "params.json"
    try:
        described: dict[str, Any] = json.loads(path.read_text())
        width, height = map(int, described["resolution"])
        rate = float(described["fps"])
        lenses = {
            (float(one["focus_distance_m"]), float(one["coc_at_infinity_px"]))
            for one in described["frames"]
        }
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path}: cannot be read as a sequence's description ({error})") from error
    if len(lenses) != 1:
        raise InputError(
            f"{path}: {len(lenses)} different lenses over its frames; expected one for all of them"
        )
    focus, at_infinity = lenses.pop()
    if not (focus > 0 and at_infinity > 0 and 0 < rate < math.inf and math.isfinite(focus)):
        raise InputError(
            f"{path}: focus_distance_m {focus:g}, coc_at_infinity_px {at_infinity:g}, fps "
            f"{rate:g}; expected numbers above 0"
        )
    fit = LensFit(slope=at_infinity * focus, intercept=-at_infinity, width=width, height=height)
    return Sequence(folder=folder, fit=fit, rate=f"{rate:g}", frames=len(described["frames"]))


def _decoded(path: Path) -> Iterator[UInt8]:
    """Code values (H, W, 3) of a video in BT.709's matrix and limited range, frame by frame."""
    import av

    try:
        with av.open(str(path)) as container:
            for frame in container.decode(video=0):
                codes = frame.to_ndarray(
                    format="rgb24", src_colorspace="ITU709", src_color_range="MPEG"
                )
                yield np.asarray(codes, np.uint8)
    except (av.FFmpegError, IndexError) as error:
        raise InputError(f"{path}: cannot be read as a video ({error})") from error

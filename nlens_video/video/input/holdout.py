"""Holdouts: mattes and depth maps of what occludes the object, frame by frame."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import TypeAlias

import numpy as np

from nlens_video.core.color import luma
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Bool, DepthMap, Float32, Matte
from nlens_video.video.exr import FAR, ExrImage, read_exr
from nlens_video.video.info import SourceFrame
from nlens_video.video.input.open import InputHints
from nlens_video.video.input.source import AvSource
from nlens_video.video.named_files import ImageSequence
from nlens_video.video.pixels.picture import AvPicture
from nlens_video.video.pixels.samples import Samples

_CODE = 1.5 / 255.0  # tolerance of black and white in lossy codecs
_ALPHA_IGNORED = (
    "is read by its luminance, as alpha is 1 all over the first frame, but not later; "
    "where alpha is the matte, write it as grey"
)


def open_holdout(spec: str, size: tuple[int, int], unit_m: float = 1.0) -> HoldoutReader:
    """Open a matte or a depth map and read its first frame.

    Args:
        spec: a video, a picture, a `%04d` sequence, or OpenEXR: with a channel Z a depth map, else
            a matte. White is in front; alpha counts where the first frame has any that is not 1.
        size: width and height of the plate [px].
        unit_m: the scene's unit; a depth map is in metres [m].

    Raises:
        InputError: it cannot be read, or has another size.
    """
    if spec.lower().endswith(".exr"):
        return ExrHoldout(spec, size, unit_m)
    return MatteReader(spec, size)


class MatteReader:
    """A matte that FFmpeg decodes; its frame n belongs to frame n of the plate.

    For a frame that is damaged the one before it is held.

    Args:
        spec: a video, a picture or a `%04d` sequence.
        size: width and height of the plate [px].
    """

    def __init__(self, spec: str, size: tuple[int, int]) -> None:
        self._spec = spec
        self._held: set[int] = set()
        self._later: SourceFrame | None = None
        self._read: Matte | None = None
        self._begin()
        info = self._source.info
        self._still = info.kind == "still"
        try:
            _check_size(spec, (info.width, info.height), size)
            if self._source.damaged or (info.kind == "sequence" and info.start_s > 0):
                raise InputError(f"{spec}: the first picture cannot be decoded; make it again")
            first = _samples(self._frame)
        except BaseException:
            self.close()
            raise
        self._by_alpha = _is_see_through(first)
        self._alpha_ignored = False
        self._read = self._matte(first)

    def _begin(self) -> None:
        """Open the file and read its first frame."""
        self._source = AvSource(self._spec, InputHints())
        self._frames: Iterator[SourceFrame] = iter(self._source)
        self._frame = next(self._frames)
        self._later = self._read = None

    @property
    def description(self) -> str:
        """File and channel."""
        return f"{self._spec}, by its {'alpha' if self._by_alpha else 'luminance'}"

    def read(self, index: int) -> Matte:
        """The matte of a frame.

        The file is read from its beginning again for a frame before the last one.

        Raises:
            InputError: it has no such frame.
        """
        if not self._still and index < self._frame.number:
            self.close()
            self._begin()
        while not self._still and self._frame.number < index:
            frame = self._later or next(self._frames, None)
            if frame is None and not self._is_damaged(index):
                raise _ended(self._spec, index)
            if frame is None or frame.number > index:
                self._later = frame
                self._held.add(index)
                break
            self._frame, self._later, self._read = frame, None, None
        if self._read is None:
            self._read = self._matte(_samples(self._frame))
        return self._read

    def notes(self) -> tuple[str, ...]:
        """Irregularities so far, for the user."""
        found = [*self._source.warnings(), *([_ALPHA_IGNORED] if self._alpha_ignored else [])]
        if self._held:
            frames = "1 frame" if len(self._held) == 1 else f"{len(self._held)} frames"
            found.append(f"{frames} cannot be decoded: the matte of the frame before is held")
        return tuple(f"--holdout {self._spec}: {one}" for one in found)

    def close(self) -> None:
        """Close the file."""
        self._source.close()

    def _is_damaged(self, index: int) -> bool:
        """Whether a frame after the last that was decoded is one of the file's damaged ones."""
        return self._source.damaged > 0 and index < (self._source.info.frame_count or 0)

    def _matte(self, samples: Samples) -> Matte:
        if not self._by_alpha or samples.alpha is None:
            self._alpha_ignored = self._alpha_ignored or _is_see_through(samples)
            return _matte(_luminance(samples))
        full = samples.coding.peak or 1.0
        return _matte(samples.alpha.astype(np.float32) / np.float32(full))


class ExrHoldout:
    """Depth or a matte from OpenEXR: one file for all frames, or a `%04d` sequence.

    Args:
        spec: a file, or a pattern whose smallest number on disk is frame 0; none may be missing.
        size: width and height of the plate [px].
        unit_m: as of `open_holdout` [m].

    Attributes:
        holds_depth: whether it is depth, not a matte.
    """

    def __init__(self, spec: str, size: tuple[int, int], unit_m: float = 1.0) -> None:
        self._size = size
        self._unit_m = unit_m
        self._spec = spec
        self._files = ImageSequence.of_input(spec)
        self._start = self._files.span().start if self._files else 0
        first = self._image(0)
        channels = first.channels
        self.holds_depth = "Z" in channels
        self._by_alpha = "A" in channels and (
            bool((channels["A"] < 1.0).any()) or not {"R", "G", "B"} <= set(channels)
        )
        self._alpha_ignored = False
        self._cached = (0, self._read(first))

    @property
    def description(self) -> str:
        """File and channel."""
        if self.holds_depth:
            return f"{self._spec}, where its depth Z is nearer"
        return f"{self._spec}, by its {'alpha' if self._by_alpha else 'luminance'}"

    def read(self, index: int) -> Matte | DepthMap:
        """The matte or the depth of a frame.

        Raises:
            InputError: the sequence has ended, or the file is unusable.
        """
        if self._files is not None and self._cached[0] != index:
            self._cached = (index, self._read(self._image(index)))
        return self._cached[1]

    def depth(self, index: int) -> DepthMap:
        """The depth of a frame, of a file that holds depth.

        Raises:
            InputError: as `read`.
        """
        found = self.read(index)
        assert isinstance(found, DepthMap)
        return found

    def notes(self) -> tuple[str, ...]:
        """Irregularities so far, for the user."""
        return (f"--holdout {self._spec}: {_ALPHA_IGNORED}",) if self._alpha_ignored else ()

    def close(self) -> None:
        """Nothing: no file stays open between frames."""

    def _image(self, index: int) -> ExrImage:
        path = Path(self._spec)
        if self._files is not None:
            path = self._files.path(self._start + index)
            if not path.is_file():
                raise _ended(str(path), index)
        image = read_exr(path)
        _check_size(str(path), (image.width, image.height), self._size)
        if "Z" in image.channels:
            self._check_depth(path, image.channels["Z"])
        return image

    def _check_depth(self, path: Path, depth: Float32) -> None:
        """Refuse depth that hides nothing; in a sequence zeros are a frame without a thing."""
        if not (depth > 0.0).any() and (depth.any() or self._files is None):
            raise InputError(
                f"{path}: Z is nowhere positive; write the distance in front of the camera"
            )

    def _read(self, image: ExrImage) -> Matte | DepthMap:
        if self.holds_depth:
            depth = image.on_display_window(self._channel(image, "Z"), np.inf)
            with np.errstate(invalid="ignore"):
                there = (depth > 0.0) & (depth < FAR)
            units = depth / np.float32(self._unit_m)
            return DepthMap(np.where(there, units, np.float32(np.inf)))
        if self._by_alpha:
            return _matte(image.on_display_window(self._channel(image, "A")))
        if "A" in image.channels:
            self._alpha_ignored = self._alpha_ignored or bool((image.channels["A"] < 1.0).any())
        if "Y" in image.channels:
            return _matte(image.on_display_window(image.channels["Y"]))
        light = sum(
            np.float32(weight) * self._channel(image, name)
            for weight, name in zip(luma("bt709"), "RGB", strict=True)
        )
        return _matte(image.on_display_window(np.asarray(light, dtype=np.float32)))

    def _channel(self, image: ExrImage, name: str) -> Float32:
        try:
            return image.channels[name]
        except KeyError:
            raise InputError(
                f"{self._spec}: has no channel {name} (found {' '.join(sorted(image.channels))}); "
                "a holdout needs Z for depth, or A, Y or R G B for a matte"
            ) from None


HoldoutReader: TypeAlias = MatteReader | ExrHoldout


def _samples(frame: SourceFrame) -> Samples:
    assert isinstance(frame.picture, AvPicture)
    return frame.picture.samples()


def _is_see_through(samples: Samples) -> bool:
    """Whether alpha is not 1 somewhere."""
    return samples.alpha is not None and bool((samples.alpha < (samples.coding.peak or 1.0)).any())


def _luminance(samples: Samples) -> Float32:
    """Coded luminance (H, W), 0 black to 1 white: a matte's codes are shares, not light."""
    coding = samples.coding
    rows = coding.rgb_from_codes
    if coding.family == "rgb":
        first = luma("bt709") @ rows[:, :3]
        planes = zip(first, samples.planes, strict=True)
        return np.asarray(sum(np.float32(w) * plane for w, plane in planes), dtype=np.float32)
    neutral = 0.5 * (coding.peak + 1.0) if coding.bits else 0.0
    offset = rows[0, 3] + neutral * (rows[0, 1] + rows[0, 2])
    first_plane = samples.planes[0].astype(np.float32)
    return np.asarray(np.float32(rows[0, 0]) * first_plane + np.float32(offset), dtype=np.float32)


def _matte(values: Float32) -> Matte:
    coverage = np.clip(np.nan_to_num(values), np.float32(0.0), np.float32(1.0))
    coverage[coverage < _CODE] = 0.0
    white: Bool = coverage > 1.0 - _CODE
    coverage[white] = 1.0
    return Matte(coverage)


def _check_size(name: str, found: tuple[int, int], wanted: tuple[int, int]) -> None:
    if found != wanted:
        raise InputError(
            f"{name}: {found[0]}x{found[1]} pixels, the plate has {wanted[0]}x{wanted[1]}; "
            "make the holdout at the plate's size"
        )


def _ended(name: str, index: int) -> InputError:
    return InputError(
        f"{name}: the holdout ends before frame {index} of the plate; "
        "make it as long as the plate or give --range"
    )

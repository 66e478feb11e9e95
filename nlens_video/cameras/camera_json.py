"""Reads `camera.json`, checking every value; what of it files of other formats hold too."""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TypeVar, get_args

from nlens_video.cameras.solved import (
    LARGEST,
    CameraErrors,
    CameraKey,
    FovSource,
    HorizonSource,
    PathKind,
    Scale,
    SolvedCamera,
    rigid_matrix,
)
from nlens_video.cameras.text import broken_json
from nlens_video.core.errors import SceneError

_FIRST = "first_frame"  # member of the description: index of the first solved frame
DESCRIPTION = "nlens_video_camera"
"""Member of files of other formats that holds what they have no field for; others pass over it."""
_W = TypeVar("_W", bound=str)


def camera_of_json(text: str, source: str = "camera.json") -> SolvedCamera:
    """Read the text of `camera.json`.

    Raises:
        SceneError: not JSON, or a value is missing or wrong; the message names it.
    """
    try:
        raw = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise SceneError(
            f"{source}: no camera ({broken_json(error)}); expected what solve writes"
        ) from error
    return _Reader(source).camera(raw)


def description(camera: SolvedCamera) -> dict[str, object]:
    """Size, sources, errors, scale and method of a camera; of its frames the first's number."""
    whole: dict[str, object] = json.loads(camera.to_json())
    del whole["frames"]
    return {**whole, _FIRST: camera.keys[0].index}


def described_camera(
    keys: Sequence[CameraKey],
    size: tuple[int, int],
    found: object,
    source: str,
    pixel_aspect: float = 1.0,
    **defaults: object,
) -> SolvedCamera:
    """A camera that was read, with what its file says beside it.

    Args:
        keys: its frames.
        size: columns and rows of the plate [px], where the file does not say.
        found: the description in the file, None or anything else where there is none.
        source: what messages call the file.
        pixel_aspect: width of a pixel by its height, as `size` [1].
        **defaults: members of `camera.json`, where there is no description.

    Raises:
        SceneError: a value is missing or wrong.
    """
    said = dict(found) if isinstance(found, dict) else {}
    first = said.pop(_FIRST, 0)  # other files begin with the plate, where the camera then rests
    if isinstance(first, int) and first <= keys[-1].index:
        keys = [key for key in keys if key.index >= first]
    known: dict[str, object] = {
        "width": size[0],
        "height": size[1],
        "fov": "measured",
        "horizon": "measured",
    }
    frames = [
        {
            "index": key.index,
            "pts_s": key.pts_s,
            "world_to_camera": key.world_to_camera.tolist(),
            "fov_x_deg": key.fov_x_deg,
        }
        for key in keys
    ]
    path = "still" if len(keys) == 1 else "moving"
    if "width" not in said:  # its pixels go with its size
        known["pixel_aspect"] = pixel_aspect
    whole = {**known, "path": path, **defaults, **said, "frames": frames}
    return camera_of_json(json.dumps(whole), source)


class _Reader:
    """Checks the values of a `camera.json`."""

    def __init__(self, source: str) -> None:
        self._source = source

    def camera(self, raw: object) -> SolvedCamera:
        """The camera of a parsed file."""
        if not isinstance(raw, dict) or not isinstance(raw.get("frames"), list):
            raise self._error('expected an object with "width", "height" and a list "frames"')
        if not raw["frames"]:
            raise self._error('"frames" is empty; expected at least one')
        keys = tuple(self._key(number, one) for number, one in enumerate(raw["frames"]))
        if any(b.pts_s <= a.pts_s for a, b in zip(keys, keys[1:], strict=False)):
            raise self._error('"pts_s" must rise from frame to frame')
        errors = raw.get("stderr")
        return SolvedCamera(
            width=self._size(raw, "width"),
            height=self._size(raw, "height"),
            keys=keys,
            ground_y=self._number(raw, "ground_y", 0.0),
            fov=self._word(raw, "fov", get_args(FovSource), "assumed"),
            horizon=self._word(raw, "horizon", get_args(HorizonSource), "assumed"),
            path=self._word(raw, "path", get_args(PathKind), "still"),
            scale=self._word(raw, "scale", get_args(Scale), "arbitrary"),
            errors=self._errors(errors if isinstance(errors, dict) else {}),
            method=str(raw.get("method", "given")),
            principal_px=self._point(raw, "principal_px", "px"),
            distortion_k1=self._number(raw, "distortion_k1", 0.0),
            place=self._point(raw, "place", "frame"),
            place_guessed=raw.get("place_guessed") is True,
            reprojection_px=self._number(raw, "reprojection_px", 0.0)
            if "reprojection_px" in raw
            else None,
            pixel_aspect=self._ratio(raw, "pixel_aspect"),
        )

    def _key(self, number: int, raw: object) -> CameraKey:
        if not isinstance(raw, dict):
            raise self._error(f"frame {number} is no object")
        matrix = rigid_matrix(raw.get("world_to_camera"))
        if matrix is None:
            raise self._error(
                f'frame {number}: "world_to_camera" must be a rigid 4x4 matrix by rows'
            )
        fov = self._number(raw, "fov_x_deg", None)
        if not 0.0 < fov < 180.0:
            raise self._error(f'frame {number}: "fov_x_deg" is {fov:g}, expected 0 to 180 degrees')
        return CameraKey(
            index=int(self._number(raw, "index", float(number))),
            pts_s=self._number(raw, "pts_s", 0.0),
            world_to_camera=matrix,
            fov_x_deg=fov,
        )

    def _errors(self, raw: dict[str, object]) -> CameraErrors:
        names = ("fov_deg", "pitch_deg", "roll_deg")
        known = {name: self._number(raw, name, 0.0) for name in names if name in raw}
        return CameraErrors(**known)

    def _point(self, raw: dict[str, object], key: str, unit: str) -> tuple[float, float] | None:
        point = raw.get(key)
        if point is None:
            return None
        if not isinstance(point, list) or len(point) != 2:
            raise self._error(f'"{key}" must be a column and a row [{unit}]')
        named: dict[str, object] = {"column": point[0], "row": point[1]}
        return self._number(named, "column", None), self._number(named, "row", None)

    def _size(self, raw: dict[str, object], name: str) -> int:
        value = self._number(raw, name, None)
        if value < 1 or value != int(value):
            raise self._error(f'"{name}" is {value:g}, expected a number of pixels')
        return int(value)

    def _ratio(self, raw: dict[str, object], name: str) -> float:
        value = self._number(raw, name, 1.0)
        if not 1.0 / LARGEST <= value:
            raise self._error(f'"{name}" is {value:g}, expected a number above 0')
        return value

    def _number(self, raw: dict[str, object], name: str, default: float | None) -> float:
        value = raw.get(name, default)
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self._error(f'"{name}" is {value!r:.40}, expected a number')
        if not abs(value) <= LARGEST:
            raise self._error(f'"{name}" is {value!r:.40}, expected a finite number')
        return float(value)

    def _word(self, raw: dict[str, object], name: str, words: tuple[_W, ...], default: _W) -> _W:
        value = raw.get(name, default)
        for word in words:
            if value == word:
                return word
        raise self._error(f'"{name}" is {value!r:.40}, expected one of {", ".join(words)}')

    def _error(self, text: str) -> SceneError:
        return SceneError(f"{self._source}: {text}")

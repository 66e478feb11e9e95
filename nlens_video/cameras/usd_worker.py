"""The process that reads USD: a file's path in, the numbers of its camera as JSON out (`usd.py`).

OpenUSD is native code that trusts its input, and writes what it finds wrong to standard error. Here
it can neither crash nor hold up the caller.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator
from typing import Any

from pxr import Tf, Usd, UsdGeom

_SECONDS = 100
_MOST_FRAMES = 50_000


def main() -> int:
    """Print the camera of the file that the first argument names, or what is wrong with it."""
    _limit()
    try:
        print(json.dumps(_found(sys.argv[1])))  # noqa: T201
    except Tf.ErrorException:
        print(json.dumps({"fault": "cannot be read as USD; export the scene again"}))  # noqa: T201
    except UnicodeDecodeError:  # of OpenUSD's message about bytes that are no text
        print(json.dumps({"fault": "cannot be read as USD; it is damaged"}))  # noqa: T201
    return 0


def _found(path: str) -> dict[str, Any]:
    stage = Usd.Stage.Open(path)
    perspective = UsdGeom.Tokens.perspective
    for prim in stage.Traverse():
        lens = UsdGeom.Camera(prim)
        if prim.IsA(UsdGeom.Camera) and lens.GetProjectionAttr().Get() == perspective:
            return _numbers(stage, lens)
    return {"fault": "no perspective camera; export the scene with its camera"}


def _numbers(stage: Usd.Stage, lens: UsdGeom.Camera) -> dict[str, Any]:
    layer, where = stage.GetRootLayer(), str(lens.GetPath())
    for prim in _ancestors(lens.GetPrim()):
        placed = UsdGeom.Xformable(prim)
        if len(placed.GetOrderedXformOps()) != len(placed.GetXformOpOrderAttr().Get() or ()):
            return {"fault": f"camera {where}: its xformOps are incomplete; export the scene again"}
    said = layer.customLayerData.get("nlens_video_camera")
    codes = _codes(stage, lens)
    return {
        "camera": where,
        "codes_per_s": stage.GetTimeCodesPerSecond()
        if layer.HasTimeCodesPerSecond() or layer.HasFramesPerSecond()
        else None,
        "metres": UsdGeom.GetStageMetersPerUnit(stage)
        if stage.HasAuthoredMetadata(UsdGeom.Tokens.metersPerUnit)
        else None,
        "z_up": UsdGeom.GetStageUpAxis(stage) == UsdGeom.Tokens.z,
        "description": said if isinstance(said, str) else None,
        "codes": codes,
        "frames": [_frame(lens, Usd.TimeCode(code)) for code in codes],
        "layers": sorted(layer.realPath for layer in stage.GetUsedLayers()),
    }


def _frame(lens: UsdGeom.Camera, when: Usd.TimeCode) -> list[float]:
    """World matrix by columns (16), focal length, aperture and its offsets at a time code."""
    world = UsdGeom.XformCache(when).GetLocalToWorldTransform(lens.GetPrim())
    return [
        *(value for row in world for value in row),
        lens.GetFocalLengthAttr().Get(when),
        lens.GetHorizontalApertureAttr().Get(when),
        lens.GetHorizontalApertureOffsetAttr().Get(when),
        lens.GetVerticalApertureOffsetAttr().Get(when),
    ]


def _codes(stage: Usd.Stage, lens: UsdGeom.Camera) -> list[float]:
    """Time codes at which the camera is read: the plate's first frame, whole ones, all keys."""
    keys: set[float] = set()
    for attribute in (
        lens.GetFocalLengthAttr(), lens.GetHorizontalApertureAttr(),
        lens.GetHorizontalApertureOffsetAttr(), lens.GetVerticalApertureOffsetAttr(),
    ):  # fmt: skip
        keys.update(attribute.GetTimeSamples())
    for prim in _ancestors(lens.GetPrim()):
        keys.update(UsdGeom.Xformable(prim).GetTimeSamples())
    start = stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else min(keys, default=0.0)
    last = max(keys, default=start)
    if not start < last < math.inf:
        return [start]
    whole = range(math.ceil(start), math.floor(last) + 1) if last - start < _MOST_FRAMES else ()
    return sorted({start, *map(float, whole), *(code for code in keys if code >= start)})


def _ancestors(prim: Usd.Prim) -> Iterator[Usd.Prim]:
    """What has a place in the world, from a camera up."""
    while prim and not prim.IsPseudoRoot():
        if prim.IsA(UsdGeom.Xformable):
            yield prim
        prim = prim.GetParent()


def _limit() -> None:
    """Bound the time where the system can."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    sys.exit(main())

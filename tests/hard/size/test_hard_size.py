"""Frames of one pixel, of a few, of odd sides, and of 8K."""

import subprocess
import sys

import cv2
import numpy as np
from hard.catalogue import Outcome, at_least, at_most, case, exactly
from hard.drawing import panels
from hard.objects import LENS, composited, cube, folder, plate_bgr
from support.folders import TESTS

from nlens_video.core.errors import LensFitError, NlensError
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxCocNetwork
from nlens_video.stages.f_coc import estimate_coc

TINY = {(1, 1): "no lens", (2, 2): "1 line", (17, 31): "a lens"}
"""Columns and rows, and how the search for a lens ends: one pixel is of one colour."""


def _plate(size: tuple[int, int]) -> np.ndarray:
    return cv2.resize(plate_bgr(), size, interpolation=cv2.INTER_AREA)


def _tiny(preset: str) -> Outcome:
    """Frames of a few pixels by a preset, with a given lens and one that is looked for."""
    figures, shown = [], {}
    with folder() as place:
        glb = cube(place / "cube.glb")
        for size in TINY:
            plate, name = _plate(size), f"{size[0]} x {size[1]}"
            given, _ = composited(glb, preset, LENS.for_width(*size), plate)
            shown[name] = given[..., ::-1]
            same = (given.shape, given.dtype) == (plate.shape, plate.dtype)
            figures.append(exactly(f"{name}: same shape and type", str(same), "True"))
            try:
                _, fit = composited(glb, preset, None, plate)
                ended = "no lens" if fit is None else "a lens"
            except LensFitError as error:
                ended = f"{len(str(error).splitlines())} line"
            wanted = TINY[size]
            figures.append(exactly(f"{name}: the search for a lens ends with", ended, wanted))
    return Outcome(tuple(figures), lambda: panels(shown, height=124))


@case
def test_tiny_frames_by_draft():
    """Frames of 1 x 1, 2 x 2 and 17 x 31 pixels go through `draft`; four tell no lens."""
    return _tiny("draft")


@case
def test_tiny_frames_by_realtime():
    """Frames of 1 x 1, 2 x 2 and 17 x 31 pixels go through `realtime`."""
    return _tiny("realtime")


@case
def test_tiny_frames_by_standard():
    """Frames of 1 x 1, 2 x 2 and 17 x 31 pixels go through `standard`, effects and all."""
    return _tiny("standard")


@case
def test_tiny_frames_by_reference():
    """Frames of 1 x 1, 2 x 2 and 17 x 31 pixels go through `reference`, the sampled lens."""
    return _tiny("reference")


@case
def test_tiny_frames_by_paper():
    """Frames of 1 x 1, 2 x 2 and 17 x 31 pixels go through `paper`, networks on the whole frame."""
    return _tiny("paper")


@case
def test_tiny_plates_for_the_coc_network():
    """The CoC network reads plates of 1 x 1 to 17 x 31 pixels without a NaN, in their own size."""
    figures, shown = [], {}
    with OnnxCocNetwork(find_model("coc").path) as network:
        for size in (*TINY, (1, 31), (31, 1)):
            plate = _plate(size)
            coc = estimate_coc(network, plate.astype(np.float32) / 255.0)
            name = f"{size[0]} x {size[1]}"
            if size in TINY:
                shown[name] = plate[..., ::-1]
            finite = np.isfinite(coc.coc_px).all() and np.isfinite(coc.sigma_px).all()
            figures += [
                exactly(f"{name}: shape", str(coc.coc_px.shape == size[::-1]), "True"),
                exactly(f"{name}: finite", str(bool(finite)), "True"),
            ]
    return Outcome(tuple(figures), lambda: panels(shown, height=93))


EIGHT_K = (7680, 4320)
RUN = """
import sys
import numpy as np
sys.path.insert(0, sys.argv[1])
from pathlib import Path
import cv2
from hard.size.test_hard_size import EIGHT_K, LENS, _plate, composited
def peak_kb():
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])

base = peak_kb()
plate = _plate(EIGHT_K)
glb, lens = Path(sys.argv[2]) / "cube.glb", LENS.for_width(*EIGHT_K)
out, _ = composited(glb, sys.argv[3], lens, plate, effects="defocus")
peak = peak_kb()
there = (out != plate).any(axis=2)
rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
small = cv2.resize(out, (480, 270), interpolation=cv2.INTER_AREA)
cv2.imwrite(str(Path(sys.argv[2]) / "small.png"), small)
print((peak - base) / 1024, rows[0], rows[-1], columns[0], columns[-1])
"""


@case
def test_frame_of_8k():
    """A frame of 7680 x 4320 looks like one of 480 x 270, and memory is a few frames."""
    with folder() as place:
        glb = cube(place / "cube.glb")
        command = [sys.executable, "-c", RUN, str(TESTS), str(place), "realtime"]
        ran = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        assert ran.returncode == 0, ran.stderr
        small = cv2.imread(str(place / "small.png"))
        plate = cv2.resize(_plate(EIGHT_K), (480, 270), interpolation=cv2.INTER_AREA)
        usual, _ = composited(glb, "realtime", LENS, plate, effects="defocus")
    memory_mb, *ends = (float(v) for v in ran.stdout.split())
    there = (usual != plate).any(axis=2)
    rows, columns = np.flatnonzero(there.any(axis=1)), np.flatnonzero(there.any(axis=0))
    own = [rows[0], rows[-1], columns[0], columns[-1]]
    off = (small.astype(float) - usual)[there] / 255.0
    return Outcome(
        (
            at_least("PSNR, reduced, to the small frame [dB]", -10 * np.log10((off**2).mean()), 38),
            at_most("reach of the object, off by [px of 480]",
                    max(abs(a / 16 - b) for a, b in zip(ends, own, strict=True)), 2.0),
            at_most("memory by the bytes of the frame", memory_mb * 2**20 / (7680 * 4320 * 3), 18),
        ),
        lambda: panels({"8K, reduced": small[..., ::-1], "480 x 270": usual[..., ::-1]}),
    )  # fmt: skip


@case
def test_object_larger_than_any_frame():
    """For an object of 1e5 frames' width around the camera, no more than the frame is drawn."""
    with folder() as place:
        glb = cube(place / "huge.glb", at=(0.0, -4e4, -5e4), size=8e4)
        try:
            seen, _ = composited(glb, "standard", LENS, effects="defocus")
        except NlensError as error:
            return Outcome((exactly("ends with", str(error), "a picture"),), lambda: panels({}))
    return Outcome(
        (at_least("pixels it covers, share", (seen != plate_bgr()).any(axis=2).mean(), 0.5),),
        lambda: panels({"composite": seen[..., ::-1]}),
    )

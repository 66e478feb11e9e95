"""The same bits, whatever the threads, the bands, the machine's load and the run."""

import json
import os
import subprocess
import sys
import zlib
from contextlib import contextmanager

import numpy as np
import pytest
from hard.catalogue import Outcome, case, exactly
from hard.drawing import over_grey, panels
from hard.objects import LENS, PRESETS, composited, cube, folder, plate_bgr
from hard.quality_levels import QUALITIES, Card, cards, lens_at, through
from support.folders import TESTS

from nlens_video import Compositor
from nlens_video.kernels import aperture_covariance, thread_pool
from nlens_video.kernels.scatter import extend, levels, scatter
from nlens_video.networks import onnx_networks
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxPaperNetworks
from nlens_video.render.software import renderer

NEAR_AND_FAR = (Card(1.5, half=(7.0, 20.0), seed=1), Card(4.0, half=(28.0, 16.0), seed=2))
FIT = lens_at(2.18, 30.0)


@case
def test_same_bits_on_any_number_of_threads():
    """Rows shared by 1, 2, 3 or 7 threads give the same bits, at every quality level."""
    scene = cards(*NEAR_AND_FAR)
    seen, most = {quality: [] for quality in QUALITIES}, []
    for count in (1, 2, 3, 7):
        with pytest.MonkeyPatch.context() as changed, _processors(changed, count) as took:
            for quality in QUALITIES:
                seen[quality].append(through(quality, scene, FIT, threads=count))
        most.append(max(took))
    return Outcome(
        (
            *(
                exactly(f"values that differ, {r}", sum(int((v != s[0]).sum()) for v in s), 0)
                for r, s in seen.items()
            ),
            exactly(
                "threads that a loop was given, at most", ", ".join(map(str, most)), "1, 2, 3, 7"
            ),
        ),
        lambda: panels({r: over_grey(s[0]) for r, s in seen.items()}),
    )


@contextmanager
def _processors(changed, count):
    """A machine of so many processors, whatever there are; yields the threads of each loop."""
    taken, took = thread_pool._taken, [1]

    def counted(own, helpers):
        found = taken(own, helpers)
        took.append(1 + found)
        return found

    changed.setattr(thread_pool, "processors", lambda: count)
    changed.setattr(thread_pool, "_taken", counted)
    changed.setattr(thread_pool, "_pool", None)  # one of as many threads
    yield took
    if thread_pool._pool is not None:
        thread_pool._pool.shutdown()


@case
def test_same_bits_for_any_height_of_bands():
    """Bands of 1, 5, 16 or 64 rows that threads take at a time give the same bits."""
    scene = cards(*NEAR_AND_FAR)
    seen = {quality: [] for quality in QUALITIES}
    for rows in (1, 5, 16, 64):
        with pytest.MonkeyPatch.context() as changed:
            for module in (scatter, extend, levels):
                changed.setattr(module, "BAND_ROWS", rows)
            for name in ("_COVARIANCE_ROWS", "_PARALLAX_ROWS"):
                changed.setattr(aperture_covariance, name, rows)
            changed.setattr(renderer, "_BANDS", rows)
            for quality in QUALITIES:
                seen[quality].append(through(quality, scene, FIT))
    return Outcome(
        tuple(
            exactly(f"values that differ, {r}", sum(int((v != s[0]).sum()) for v in s), 0)
            for r, s in seen.items()
        ),
        lambda: panels({f"{r}, bands of 1": over_grey(s[0]) for r, s in seen.items()}),
    )


@case
def test_papers_networks_in_strips_of_any_height():
    """The paper's networks give the same on strips of 32, 64 or all rows, to float precision."""
    networks = OnnxPaperNetworks(find_model("paper-arnet").path, find_model("paper-iunet").path)
    rng = np.random.default_rng(0)
    code = rng.random((128, 96, 3), dtype=np.float32)
    defocus = rng.uniform(-0.4, 0.4, (128, 96)).astype(np.float32)
    made = []
    for rows in (128, 64, 32):
        with pytest.MonkeyPatch.context() as changed:
            changed.setattr(onnx_networks, "STRIP_ROWS", rows)
            made.append(networks.render(code, defocus)[0])
    away = max(float(np.abs(one - made[0]).max()) for one in made)
    return Outcome(
        (exactly("largest difference, rounded to 1e-5", round(away, 5), 0.0),),
        lambda: panels({"in one": _byte(made[0]), "in strips of 32": _byte(made[2])}),
    )


RUN = """
import json, os, sys, zlib
if sys.argv[2] == "one":
    os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
sys.path.insert(0, sys.argv[1])
from hard.determinism.test_hard_determinism import sums
print(json.dumps(sums()))
"""


def sums() -> dict[str, int]:
    """Checksums of a composite by each preset."""
    with folder() as place:
        glb = cube(place / "cube.glb")
        return {p: zlib.crc32(composited(glb, p, LENS, time=0.2)[0].tobytes()) for p in PRESETS}


@case
def test_same_bits_in_any_process():
    """A process of one core and other hashes, one of all cores, and this one: the same bits."""
    tests, found = str(TESTS), [sums()]
    for number, cores in enumerate(("one", "all")):
        ran = subprocess.run(
            [sys.executable, "-c", RUN, tests, cores], capture_output=True, text=True, check=False,
            timeout=200, env={**os.environ, "PYTHONHASHSEED": str(number + 1)},
        )  # fmt: skip
        assert ran.returncode == 0, ran.stderr
        found.append(json.loads(ran.stdout))
    with folder() as place:
        shown, _ = composited(cube(place / "cube.glb"), "standard", LENS, time=0.2)
    return Outcome(
        tuple(
            exactly(f"different composites in 3 processes, {p}", len({one[p] for one in found}), 1)
            for p in PRESETS
        ),
        lambda: panels({"standard": shown[..., ::-1]}),
    )


@case
def test_same_bits_after_any_frame():
    """A frame looks the same alone, after others, and after itself: no state is kept."""
    plate, figures = plate_bgr(), []
    with folder() as place:
        glb = cube(place / "cube.glb")
        for preset in PRESETS:
            alone, _ = composited(glb, preset, LENS, time=0.4)
            with Compositor(glb, preset=preset, fit=LENS, fps=25) as lens:
                after = [lens.process(plate, time=t) for t in (0.0, 0.9, 0.4, 0.4)][2:]
            differ = sum(int((one != alone).sum()) for one in after)
            figures.append(exactly(f"samples that differ, {preset}", differ, 0))
    return Outcome(tuple(figures), lambda: panels({"the frame": alone[..., ::-1]}))


def _byte(picture: np.ndarray) -> np.ndarray:
    return np.round(255 * np.clip(picture, 0, 1)).astype(np.uint8)

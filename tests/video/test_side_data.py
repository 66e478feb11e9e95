"""Side data that PyAV cannot be shown, as the profile of a PNG: processes end as they should."""

import subprocess
import sys

import PIL.Image
import pytest
from PIL import ImageCms
from support import shots

SRGB = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
LOOP = """
import av, sys
from nlens_video import Compositor
with Compositor(sys.argv[2], fit=sys.argv[3], fps=25) as lens, av.open(sys.argv[1]) as plate:
    for frame in [*plate.decode(video=0)] * 4:
        lens.process_av(frame)
"""


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shot")
    shots.write_shot(folder, frames=2)
    with PIL.Image.open(folder / "plate.png") as plate:
        for name in ("icc.png", "n_0001.png", "n_0002.png"):
            plate.save(folder / name, icc_profile=SRGB)
        plate.save(folder / "icc.apng", save_all=True, append_images=[plate], icc_profile=SRGB)
        plate.save(folder / "icc.webp", lossless=True, icc_profile=SRGB)
    return folder


def python(*words):
    return subprocess.run([sys.executable, *map(str, words)], capture_output=True, text=True)


def nlens(*words):
    return python("-m", "nlens_video", *words)


@pytest.mark.needs_gl
@pytest.mark.parametrize(
    ("plate", "out"),
    [
        ("icc.png", "out.png"), ("n_%04d.png", "out_%04d.png"), ("n_%04d.png", "out.mp4"),
        ("icc.apng", "out.apng"), ("icc.webp", "out.webp"),
    ],
)  # fmt: skip
def test_plates_with_a_profile_are_composited(files, tmp_path, plate, out):
    lens = ("--fit", files / "fit.json", "--preset", "draft")
    run = nlens(files / plate, files / "anim.glb", tmp_path / out, *lens)
    assert run.returncode == 0, run.stderr
    wanted = 2 if out == "out_%04d.png" else 1
    assert len([one for one in tmp_path.iterdir() if one.name.startswith("out")]) == wanted


@pytest.mark.needs_gl
def test_plates_with_a_profile_are_planned_fitted_and_checked(files, tmp_path):
    scene = files / "anim.glb"
    for words in (
        (files / "icc.png", scene, tmp_path / "out.png", "--plan", "--fit", files / "fit.json"),
        ("fit", files / "icc.png", scene, tmp_path / "fit.json"),
        ("check", files / "icc.png", "--plate", files / "icc.png"),
    ):
        run = nlens(*words)
        assert run.returncode >= 0, run.stderr  # no signal; what it finds is not tested here


@pytest.mark.needs_gl
@pytest.mark.parametrize("plate", ["icc.png", "icc.apng"])
def test_frames_with_a_profile_go_through_a_loop_of_pyav(files, plate):
    run = python("-c", LOOP, files / plate, files / "anim.glb", files / "fit.json")
    assert run.returncode == 0, run.stderr

"""The aperture's shape read off the highlights of pictures that are drawn with one."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from support import shots
from support.command import nlens

from nlens_video.core.layers import Box
from nlens_video.core.optics import ROUND, Aperture
from nlens_video.effects.camera.aperture_shape import fit_aperture, read_aperture
from nlens_video.effects.camera.highlight_discs import find_discs
from nlens_video.kernels.scatter.scatter import scatter
from nlens_video.video.pixels.picture import ArrayPicture

SIZE = (400, 700)
COC_PX = 30.0
CELLS = [(60 + 70 * row, 60 + 75 * column) for row in range(5) for column in range(8)]


def highlights(aperture, count=12, coc_px=COC_PX, seed=1, size=SIZE, noise=0.01):
    """A dim plate of display-coded sRGB with points of light behind the focus."""
    rng = np.random.default_rng(seed)
    rgba = np.zeros((*size, 4), np.float32)
    for cell in rng.permutation(len(CELLS))[:count]:
        row, column = (n + rng.integers(-8, 9) for n in CELLS[cell])
        rgba[row, column] = (*[rng.uniform(0.3, 0.9)] * 3, 1.0)
    coc = np.full(size, -coc_px, np.float32)
    frame = Box(0, 0, size[1], size[0])
    light = scatter(rgba, coc, aperture=aperture, frame=frame)[..., :3] * 0.25 * np.pi * coc_px**2
    dim = cv2.GaussianBlur(rng.random(size).astype(np.float32), (0, 0), 20.0)
    coded = np.clip(light + 0.4 * dim[..., None] ** 2, 0.0, 1.0) ** (1 / 2.2)
    return np.clip(coded + rng.normal(0.0, noise, coded.shape), 0.0, 1.0).astype(np.float32)


def apart_deg(one, other, blades):
    period = 360.0 / blades
    return abs((one - other + 0.5 * period) % period - 0.5 * period)


@pytest.mark.parametrize("cat_eye", [0.0, 0.5])
@pytest.mark.parametrize("blades", range(5, 10))
def test_blades_rotation_and_cat_eye_are_read(blades, cat_eye):
    aperture = Aperture(blades=blades, rotation_deg=17.0, roundness=0.2, cat_eye=cat_eye)
    found = read_aperture(ArrayPicture(highlights(aperture, seed=blades)))
    assert found.aperture.blades == blades
    assert apart_deg(found.aperture.rotation_deg, 17.0, blades) < 2.0
    assert abs(found.aperture.roundness - 0.2) < 0.25
    assert abs(found.aperture.cat_eye - cat_eye) <= 0.15
    assert found.discs >= 10


@pytest.mark.parametrize("coc_px", [12.0, 30.0, 60.0])
@pytest.mark.parametrize("quality", [60, 100])
def test_round_discs_have_no_blades_whatever_their_size_and_compression(coc_px, quality):
    picture = np.uint8(highlights(ROUND, coc_px=coc_px) * 255 + 0.5)
    packed = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    seen = np.float32(cv2.imdecode(packed, cv2.IMREAD_COLOR)) / 255
    assert read_aperture(ArrayPicture(seen)).aperture == ROUND


def test_an_aperture_is_read_through_strong_compression():
    picture = np.uint8(highlights(Aperture(blades=6, rotation_deg=8.0)) * 255 + 0.5)
    packed = cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, 50])[1]
    seen = np.float32(cv2.imdecode(packed, cv2.IMREAD_COLOR)) / 255
    assert read_aperture(ArrayPicture(seen)).aperture.blades == 6


def squares(rng, light):
    for row, column in CELLS[:12]:
        light[row - 12 : row + 12, column - 12 : column + 12] = 0.9


def glows(rng, light):
    for row, column in CELLS[:12]:
        light[row, column] = 900.0
    light[:] = np.minimum(cv2.GaussianBlur(light, (0, 0), 9.0), 1.0)


def texture(rng, light):
    light[:] = cv2.GaussianBlur(rng.random(SIZE).astype(np.float32), (0, 0), 3.0) * 4.0 - 1.5


@pytest.mark.parametrize("draw", [squares, glows, texture])
def test_windows_glows_and_texture_tell_no_aperture(draw):
    rng = np.random.default_rng(4)
    light = np.full(SIZE, 0.1, np.float32)
    draw(rng, light)
    seen = np.clip(light + rng.normal(0.0, 0.01, SIZE), 0.0, 1.0).astype(np.float32)
    assert fit_aperture(find_discs(seen)) is None


def test_fewer_than_four_discs_tell_no_aperture():
    assert read_aperture(ArrayPicture(highlights(Aperture(blades=6), count=3))) is None


def test_shapes_that_do_not_agree_tell_no_blades():
    turned = [highlights(Aperture(blades=5, rotation_deg=24.0 * k), seed=k) for k in range(3)]
    seen = np.hstack([turned[0][:, :230], turned[1][:, 230:460], turned[2][:, 460:]])
    found = read_aperture(ArrayPicture(seen))
    assert found is None or found.aperture.blades == 0


def test_a_plate_with_wide_pixels_is_read_as_it_is_seen():
    seen = highlights(Aperture(blades=6, rotation_deg=20.0))
    narrow = cv2.resize(seen, (SIZE[1] // 2, SIZE[0]), interpolation=cv2.INTER_AREA)
    found = read_aperture(ArrayPicture(narrow), pixel_aspect=2.0)
    assert found.aperture.blades == 6
    assert apart_deg(found.aperture.rotation_deg, 20.0, 6) < 2.0


def test_a_large_plate_is_read_reduced():
    seen = highlights(Aperture(blades=6, rotation_deg=20.0))
    large = cv2.resize(seen, None, fx=6.0, fy=6.0)
    assert read_aperture(ArrayPicture(large)).aperture.blades == 6


@pytest.mark.slow
@pytest.mark.parametrize(("given", "said"), [((), True), (("--aperture", "round"), False)])
def test_the_plan_says_which_aperture_the_plate_shows(tmp_path, given, said):
    seen = highlights(Aperture(blades=6, rotation_deg=20.0), count=30)
    seen = seen[: shots.HEIGHT, : shots.WIDTH]
    plate = shots.write_png(tmp_path / "plate.png", np.uint8(seen * 255 + 0.5))
    cube = shots.cube_glb(tmp_path / "cube.glb")
    fit = shots.fit_json(tmp_path / "fit.json")
    run = nlens(plate, cube, tmp_path / "out.png", "--plan", "--fit", fit, *given)
    line = "aperture: of 6 blades, off"
    assert (line in run.stdout + run.stderr) is said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("preset", "shaped"),
    [
        ("draft", True), ("realtime", True), ("standard", True), ("reference", True),
        ("paper", False),
    ],
)  # fmt: skip
def test_every_preset_blurs_by_the_aperture_that_the_plate_shows_or_says_that_it_cannot(
    tmp_path, preset, shaped
):
    seen = highlights(Aperture(blades=6, rotation_deg=20.0), count=30)
    seen = seen[: shots.HEIGHT, : shots.WIDTH]
    plate = shots.write_png(tmp_path / "plate.png", np.uint8(seen * 255 + 0.5))
    cube = shots.cube_glb(tmp_path / "cube.glb")
    fit = shots.fit_json(tmp_path / "fit.json")
    made = {}
    for name, given in (("read", ()), ("round", ("--aperture", "round"))):
        out = tmp_path / f"{name}.png"
        run = nlens(plate, cube, out, "--preset", preset, "--fit", fit, *given)
        assert run.returncode == 0, run.stderr
        made[name] = cv2.imread(str(out)), run.stdout + run.stderr
    assert np.array_equal(made["read"][0], made["round"][0]) is not shaped
    assert ("blurs by round discs alone" in made["read"][1]) is not shaped
    assert ("aperture: of 6 blades" in made["read"][1]) is shaped
    assert "aperture:" not in made["round"][1]

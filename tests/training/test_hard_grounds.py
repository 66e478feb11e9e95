import json
import math
import os
import subprocess
import sys

import numpy as np
import pytest
from PIL import Image
from support.folders import SAMPLES


@pytest.fixture(autouse=True)
def _samples_on_the_path(monkeypatch):
    monkeypatch.syspath_prepend(str(SAMPLES))


def test_seeds_on_hard_ground_take_every_ground_in_turn_where_it_is_found():
    from truth.plan import HARD_GROUNDS, draw_view

    views = [draw_view(seed, "hard") for seed in range(9000, 9024)]
    assert [view.ground for view in views] == 2 * list(HARD_GROUNDS)
    assert all(view.setting in HARD_GROUNDS[view.ground] for view in views)
    assert draw_view(9000).ground == ""


def test_every_third_round_of_the_grounds_is_kept_unseen():
    from truth.plan import draw_view, kept_unseen

    held = [seed for seed in range(9000, 9072) if kept_unseen(seed)]
    assert held == [*range(9024, 9036), *range(9060, 9072)]
    assert len({draw_view(seed, "hard").ground for seed in held}) == 12


@pytest.mark.parametrize("seed", range(9000, 9020))
def test_lenses_of_hard_grounds_are_for_sale(seed):
    from truth import subject
    from truth.plan import FOCUSES, draw_lens, draw_view

    view = draw_view(seed, "hard")
    depths = subject.depths(view, subject.mesh(view))
    for lens in (draw_lens(view, focus, depths) for focus in FOCUSES):
        assert 1.2 <= lens.f_number <= 22.0
        assert lens.blades in (0, 5, 6, 7)
        assert 0.0 <= lens.cat_eye <= 0.8
        assert np.abs(lens.coc_px([view.nearest_m, view.farthest_m])).max() <= 39.0


@pytest.mark.parametrize("blades", [5, 6, 7])
def test_bladed_aperture_has_the_area_of_the_round_one(blades):
    from truth.plan import Lens

    round_one = Lens(focal_mm=50.0, f_number=2.0, focus_m=2.0)
    bladed = Lens(focal_mm=50.0, f_number=2.0, focus_m=2.0, blades=blades)
    radius = [25.0 / lens.blender_f_number for lens in (round_one, bladed)]
    turn = 2.0 * math.pi / blades * np.arange(blades)
    x, y = radius[1] * np.cos(turn), radius[1] * np.sin(turn)
    area = 0.5 * np.abs(x @ np.roll(y, 1) - y @ np.roll(x, 1))
    assert area == pytest.approx(math.pi * radius[0] ** 2)


def still(electrons=1e7, **other):
    """A pipeline that leaves the picture alone as far as a codec can."""
    from truth.pipeline import Pipeline

    neutral = {"read_electrons": 0.0, "edges": True, "denoise": 0.0, "contrast": 1.0}
    neutral |= {"sharpen": 0.0, "radius_px": 1.0, "codec": "libx264", "crf": 18}
    return Pipeline(electrons=electrons, **(neutral | other))


@pytest.mark.parametrize("codec", ["libx264", "libx265"])
def test_good_camera_shows_the_colours_of_the_light(codec):
    from truth.develop import to_code
    from truth.pipeline import footage

    light = np.empty((96, 128, 3), np.float32)
    light[...] = np.linspace(0.05, 0.6, 128)[:, None] * [1.0, 0.8, 0.5]
    found = footage(light, still(codec=codec), np.random.default_rng(1))
    error = np.int16(found) - np.int16(to_code(light))
    assert np.abs(error[4:-4, 4:-4]).max() <= 6
    assert np.abs(error[4:-4, 4:-4].mean((0, 1))).max() < 2.0


@pytest.mark.parametrize("electrons", [400.0, 10000.0])
def test_sensor_has_the_shot_noise_of_its_electrons(electrons):
    from truth.pipeline import sensed

    light = np.full((400, 400, 3), 0.25, np.float32)
    found = sensed(light, still(electrons, edges=False), np.random.default_rng(2))
    measured = found[1::2, ::2, 1]  # green pixels of the pattern, which are not interpolated
    assert measured.mean() == pytest.approx(0.25, rel=0.01)
    assert measured.std() == pytest.approx(math.sqrt(0.25 / electrons), rel=0.05)


def test_sharpening_raises_the_contrast_of_an_edge_and_denoising_lowers_grain():
    from truth.pipeline import graded

    light = np.full((64, 64, 3), 0.1, np.float32)
    light[:, 32:] = 0.3
    plain, sharp = (np.ptp(graded(light, still(sharpen=weight))) for weight in (0.0, 0.8))
    assert sharp > plain + 8
    noise = np.random.default_rng(3).normal(0.0, 0.01, light.shape)
    grainy = np.float32(light + noise)
    rough, smooth = (graded(grainy, still(denoise=level))[:, :28].std() for level in (0.0, 0.03))
    assert smooth < 0.6 * rough


def test_plate_becomes_footage_with_the_same_labels_every_time(tmp_path):
    from truth.develop import write_exr
    from truth.pipeline import convert

    folder = tmp_path / "9000_mid"
    folder.mkdir()
    light = np.float16(np.random.default_rng(0).random((96, 128, 3)))
    write_exr(
        folder / "bg.exr", {c: np.ascontiguousarray(light[..., i]) for i, c in enumerate("RGB")}
    )
    np.save(folder / "bg_coc.npy", np.ones((96, 128), np.float16))
    (folder / "params.json").write_text('{"f_stop": 2.0}')
    for name in ("a", "b"):
        (tmp_path / name).mkdir()
        convert(folder, tmp_path / name / folder.name)
    first, second = (tmp_path / name / folder.name for name in ("a", "b"))
    assert (first / "bg.png").read_bytes() == (second / "bg.png").read_bytes()
    assert (first / "bg_coc.npy").read_bytes() == (folder / "bg_coc.npy").read_bytes()
    known = json.loads((first / "params.json").read_text())
    assert known["f_stop"] == 2.0
    assert 18 <= known["pipeline"]["crf"] <= 30


def render(seed, folder):
    command = [sys.executable, "-m", "truth.make", "--seed", str(seed), "--camera", "hard"]
    command += ["--focus", "any", "--percent", "8", "--samples", "12", "--error", "0.2"]
    path = os.pathsep.join([str(SAMPLES), str(SAMPLES.parent)])
    subprocess.run(
        [*command, "--out", str(folder)], check=True, env={**os.environ, "PYTHONPATH": path}
    )
    return next(folder.glob(f"{seed}_*"))


@pytest.mark.slow
@pytest.mark.needs_blender
@pytest.mark.parametrize("seed", [9000, 9002, 9004, 9005])
def test_hard_ground_is_rendered_with_its_labels(tmp_path, seed):
    folder = render(seed, tmp_path)
    picture = np.asarray(Image.open(folder / "bg.png"), np.float64)
    known = json.loads((folder / "params.json").read_text())
    coc, depth = (np.load(folder / name) for name in ("object_coc.npy", "object_depth.npz"))
    depth = depth["depth"]
    held = depth < 1e9
    law = known["coc_at_infinity_px"] * (known["focus_distance_m"] / depth[held] - 1.0)
    np.testing.assert_allclose(coc[held], law, atol=0.02)
    assert picture.std() > 3.0
    assert (picture.max(2) > 8).mean() > 0.8  # the barrel darkens corners at most

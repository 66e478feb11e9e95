"""The plan tells of what is drawn, and of nothing else."""

from fractions import Fraction

import numpy as np
import pytest
from support import shots
from support.command import nlens, one_line
from support.glb_builder import GlbBuilder


@pytest.fixture(scope="module")
def words(tmp_path_factory):
    """The words that plan a run whose object moves."""
    folder = shots.write_shot(tmp_path_factory.mktemp("plan"), 3, end=(0.3, 0.0, -1.6))
    fit = ["--fit", folder / "fit.json"]
    return [folder / "in.mp4", folder / "anim.glb", folder / "out.mp4", "--plan", "-v", *fit]


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (["--preset", "realtime"], "assumed)"),
        (["--effects", "auto,-shadow"], "assumed)"),
        (["--preset", "standard"], "assumed), on its shadow too"),
        (["--ground-reflectance", "0.2"], "assumed), on its shadow and reflection too"),
        (["--effects", "motion-blur,shadow"], "asked for by --effects"),
    ],
)
def test_plan_names_what_motion_blurs_beside_the_object_only_where_it_is_drawn(words, more, told):
    run = nlens(*words, *more)
    (line,) = [one for one in run.stdout.splitlines() if one.startswith("effect motion-blur")]
    assert line.endswith(told), line


@pytest.mark.parametrize(
    ("lens", "told"),
    [
        ("f/2.8", True),
        ("50mm", True),
        ("sensor full-frame", True),
        ("50mm f/2.8", False),
        ("f/2.8 sensor full-frame", False),
        ("focus 2m", False),
    ],
)
def test_lens_whose_parts_do_not_tell_the_blur_is_told(tmp_path, lens, told):
    folder = shots.write_shot(tmp_path, 1)
    run = nlens(folder / "in.mp4", folder / "anim.glb", folder / "out.mp4", "--lens", lens)
    assert ("--lens changes nothing" in run.stderr) == told, run.stderr
    assert run.returncode == 0


@pytest.mark.parametrize(
    ("keys", "told"),
    [
        ([[0.6, 0.0, 0.0, 0.8], [-0.5, 0.2, 0.0, 0.84]], True),  # rises in the shot
        ([[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, 0.0, 1.0]], True),  # level
        (None, False),
    ],
)
def test_objects_shade_themselves_by_any_light_that_reaches_them_in_the_shot(tmp_path, keys, told):
    shots.write_video(tmp_path / "in.mp4", 3)
    builder = GlbBuilder()
    mesh = builder.mesh(shots.CUBE, shots.CUBE_FACES)
    builder.node(mesh=mesh, translation=[0.0, 0.0, -1.6], scale=[0.35] * 3)
    lens = builder.camera(shots.YFOV, aspect=shots.WIDTH / shots.HEIGHT)
    builder.node(camera=lens, matrix=shots.camera_pose().T.ravel().tolist())
    if keys is not None:
        light = builder.light(intensity=2.0)
        builder.animation((light, "rotation", [0.0, 0.1], np.float32(keys), "LINEAR"))
    glb = builder.write(tmp_path / "a.glb")
    run = nlens(tmp_path / "in.mp4", glb, tmp_path / "o.mkv", "--plan", "--fallback", "constant")
    assert ("each other under a light" in run.stdout) == told, run.stdout


@pytest.mark.parametrize(
    ("times", "told"),
    [
        (range(0, 12 * 40, 40), "yuv420p, 25.000 fps"),
        ([*range(0, 240, 40), *range(240, 840, 100)], "variable rate, 15.385 fps on average"),
    ],
    ids=["constant", "variable"],
)
def test_plan_says_where_the_frame_rate_varies(tmp_path, times, told):
    plate = shots.write_video(
        tmp_path / "in.mp4", len(times), pts=list(times), time_base=Fraction(1, 1000), audio=False
    )
    glb, fit = shots.cube_glb(tmp_path / "anim.glb"), shots.fit_json(tmp_path / "fit.json")
    run = nlens(plate, glb, tmp_path / "out.mp4", "--plan", "--fit", fit)
    (line,) = [one for one in run.stdout.splitlines() if one.startswith("plate ")]
    assert line.endswith(told), line


LOST = ("codec ", "pixel format ", "light above white")


def lost(text, label):
    """Notes on what pictures lose, of a plan or a summary."""
    notes = [line.partition(label)[2].strip() for line in text.splitlines() if label in line]
    return [note for note in notes if note.startswith(LOST)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("plate", "codec", "pix_fmt", "out", "told"),
    [
        ("in.mov", "qtrle", "argb", ["out.mp4"], "alpha is left out"),
        ("in.mkv", "ffv1", "yuv420p10le", ["out.mpg"], "8 bits for 10"),
        ("in.mkv", "ffv1", "yuv420p10le", ["out_%02d.webp"], "8 bits for 10"),
        ("in.mkv", "ffv1", "yuv444p10le", ["out.jpg", "--frame", "1"], "8 bits for 10"),
        ("in.mkv", "ffv1", "yuv420p10le", ["out.mkv"], None),
        ("in.mp4", "libx264", "yuv420p", ["out.mp4"], None),
    ],
)
def test_plan_says_what_the_result_loses_of_the_plate_as_the_summary_does(
    tmp_path, plate, codec, pix_fmt, out, told
):
    shots.write_video(tmp_path / plate, 2, codec=codec, pix_fmt=pix_fmt, audio=False)
    name, *more = out
    words = [
        tmp_path / plate, shots.cube_glb(tmp_path / "anim.glb"), tmp_path / name, *more,
        "--fit", shots.fit_json(tmp_path / "fit.json"), "--preset", "draft",
    ]  # fmt: skip
    before = sorted(tmp_path.iterdir())
    found = lost(nlens(*words, "--plan").stdout, "note: ")
    assert sorted(tmp_path.iterdir()) == before
    assert found == lost(nlens(*words).stderr, "note ")
    assert bool(found) == (told is not None)
    assert told is None or told in found[-1]


@pytest.mark.slow
def test_plan_of_chunks_and_of_an_address_says_nothing_of_what_is_lost(words, tmp_path):
    plate, glb, _, *more = words
    for out in ([tmp_path / "chunks", "--chunk-out"], ["udp://127.0.0.1:9"]):
        run = nlens(plate, glb, *out, *more)
        assert run.returncode == 0, run.stderr
        assert lost(run.stdout, "note: ") == []
    assert not list(tmp_path.iterdir())


def test_one_picture_of_many_frames_is_refused_by_the_plan_as_by_the_run(words):
    plate, glb, out, *more = words
    of_run = [word for word in more if word not in ("--plan", "-v")]
    said = {
        one_line(nlens(plate, glb, out.with_suffix(".png"), *of_run, *plan), 6)
        for plan in ([], ["--plan"])
    }
    (line,) = said
    assert "out.png: is one picture, the plate is a video; give --frame N" in line


def test_pipeline_that_composites_nothing_is_refused_by_the_plan_as_by_the_run(words, tmp_path):
    pipeline = tmp_path / "bounds.toml"
    pipeline.write_text('nodes = ["object-bounds"]\n')
    of_run = [word for word in words if word not in ("--plan", "-v")]
    said = {one_line(nlens(*of_run, "--preset", pipeline, *plan), 2) for plan in ([], ["--plan"])}
    (line,) = said
    assert "bounds.toml: has no node 'composite'" in line

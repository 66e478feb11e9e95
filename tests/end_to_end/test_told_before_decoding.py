"""Errors that are found before the plate is decoded, and runs on a single frame."""

import json
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from support import shots
from support.command import nlens, one_line

from nlens_video.farm import job as job_module
from nlens_video.run import find_fit as fit_module
from nlens_video.run import pooled_samples

pytestmark = pytest.mark.needs_gl


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    slide = {"end": (0.3, 0.0, -2.6), "seconds": 0.5}
    folder = shots.write_shot(tmp_path_factory.mktemp("shot"), **slide)
    shots.cube_glb(folder / "bare.glb", camera=False)
    shots.cube_glb(folder / "behind.glb", start=(0.0, 0.0, 30.0))
    shots.cube_glb(folder / "left.glb", start=(-60.0, 0.0, -2.6), end=(-50.0, 0.0, -2.6))
    shots.cube_glb(folder / "leaves.glb", end=(60.0, 0.0, -1.6), seconds=0.2)
    shots.cube_glb(folder / "near.glb", start=(-2.7, 0.0, -2.6))
    (folder / "bad.json").write_text('{"slope": "steep"}')
    return folder


@pytest.fixture
def no_pass(monkeypatch):
    """Whoever decodes the plate to follow its lens, or to find it, fails the test."""

    def decodes(*given, **named):
        pytest.fail("the plate is decoded before the slip is told")

    monkeypatch.setattr(pooled_samples, "lens_track_pass", decodes)
    monkeypatch.setattr(fit_module, "lens_track_pass", decodes)
    monkeypatch.setattr(job_module, "find_fit", decodes)


SLIPS = [
    (["--codec", "x264lib"], 2, "no such encoder"),
    (["--codec", "vp8"], 2, "--codec vp8: mp4 does not hold it; give another OUT"),
    (["--crf", "999"], 2, "--crf 999: libx264 takes"),
    (["--crf", "20", "--codec", "ffv1"], 2, "--crf 20: ffv1"),
    (["--pix-fmt", "yuv421"], 2, "--pix-fmt yuv421: no such pixel format"),
    (["--preset", "cinematic"], 2, "standard"),
    (["--effects", "glitter"], 2, "defocus"),
    (["--fit", "none.json"], 5, "none.json"),
    (["--fit", "bad.json"], 5, "slope"),
    (["--animation", "run"], 4, "no animation 'run'"),
    (["--scene", "dusk"], 4, "dusk"),
    (["--camera", "crane"], 4, "crane"),
    (["--footprint", "car"], 4, "car"),
    (["--holdout", "none.png"], 3, "--holdout none.png: no such file"),
    (["--env", "none.hdr"], 3, "--env-map none.hdr: no such file"),
    (["--layers", "none.exr"], 3, "--layers none.exr: no such file"),
    (["--interpolation", "linear"], 2, "--interpolation is that between keys; give --key too"),
]
TARGETS = [
    (["--report", "in.mp4/r"], 6, "is no folder"),
    (["--aov", "in.mp4"], 6, "is no folder"),
    (["--save-fit", "no/such/fit.json"], 6, "does not exist; make it first"),
    (["--timings", "no/such/t.json"], 6, "does not exist; make it first"),
    (["--range", "500:"], 2, "--range 500: of the plate: no such frames; it has about 12"),
    (["--frame", "500"], 2, "no such frames; it has about 12"),
]


@pytest.mark.usefixtures("no_pass")
@pytest.mark.parametrize(("more", "code", "words"), SLIPS + TARGETS)
def test_invalid_options_are_refused_before_the_plate_is_decoded(
    shot, tmp_path, monkeypatch, more, code, words
):
    monkeypatch.chdir(shot)
    line = one_line(nlens("in.mp4", "anim.glb", tmp_path / "out.mp4", *more), code)
    assert words in line
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("no_pass")
def test_object_before_the_plate_is_answered_with_the_order(shot, tmp_path, monkeypatch):
    monkeypatch.chdir(shot)
    line = one_line(nlens("anim.glb", "in.mp4", tmp_path / "out.mp4"), 2)
    assert "IN is anim.glb, and the GLB is in.mp4; swap them" in line


@pytest.mark.usefixtures("no_pass")
@pytest.mark.parametrize(("more", "code", "words"), SLIPS[:4] + SLIPS[8:12])
def test_invalid_chunked_run_is_refused_before_its_first_chunk(
    shot, tmp_path, monkeypatch, more, code, words
):
    """Their codec is needed at the very end, when hours may have gone by."""
    monkeypatch.chdir(shot)
    line = one_line(nlens("in.mp4", "anim.glb", tmp_path / "out.mp4", "--resume", *more), code)
    assert words in line
    assert not list(tmp_path.iterdir())


@pytest.mark.usefixtures("no_pass")
@pytest.mark.parametrize(
    ("out", "words"),
    [
        ("no/such/out.mp4", "does not exist; make it first"),
        ("out.xyz", "nothing writes this extension"),
        ("out.m3u8", "hls writes several files; give - as OUT, then | ffmpeg -i - "),
        ("out.png", "is one picture, the plate is a video; give --frame N, a video or a sequence"),
        (".", "is a folder"),
    ],
)
def test_unwritable_output_format_is_refused_before_decoding(shot, tmp_path, out, words):
    run = nlens(shot / "in.mp4", shot / "anim.glb", tmp_path / out)
    assert words in one_line(run, 6)
    assert not list(tmp_path.iterdir())


@pytest.mark.skipif("h264_nvenc" not in av.codecs_available, reason="this FFmpeg knows no such")
@pytest.mark.skipif(Path("/dev/nvidia0").exists(), reason="here it may be at hand")
@pytest.mark.usefixtures("no_pass")
def test_encoder_without_its_hardware_is_refused_before_decoding(shot, tmp_path):
    run = nlens(shot / "in.mp4", shot / "anim.glb", tmp_path / "o.mp4", "--codec", "h264_nvenc")
    assert "--codec h264_nvenc: needs hardware that is not at hand" in one_line(run, 2)


@pytest.mark.usefixtures("no_pass")
@pytest.mark.parametrize(
    ("place", "words"),
    [
        (["--at", "400,300", "--size", "0.3"], "--at 400,300 is far off; expected fractions"),
        (["--at", "0.5,0.8", "--size", "300"], "--size 300 is a share of the frame's height"),
        (["--at", "0.5,0.8", "--size", "0.3", "--horizon", "-540"], "--horizon -540 is far off"),
        (["--at", "0.5,0.8", "--size", "0.3", "--roll", "5"], "give --horizon H too"),
    ],
)
def test_placement_in_pixels_is_refused(shot, tmp_path, place, words):
    run = nlens(shot / "in.mp4", shot / "bare.glb", tmp_path / "out.mp4", *place)
    assert words in one_line(run, 2)


FAR_LEFT = ("--at", "-4,0.9", "--size", "0.3", "--horizon", "0.5")


class TestOutOfView:
    @pytest.mark.usefixtures("no_pass")
    @pytest.mark.parametrize("plate", ["in.mp4", "plate.png"])
    @pytest.mark.parametrize(
        ("glb", "more", "words"),
        [
            ("behind.glb", [], "behind the camera; check --camera"),
            ("left.glb", [], "left of the frame; check --camera"),
            ("left.glb", ["--effects", "none"], "left of the frame"),
            ("bare.glb", [*FAR_LEFT], "left of the frame; check --at and"),
        ],
    )
    def test_object_outside_every_frame_is_refused(self, shot, tmp_path, plate, glb, more, words):
        out = (tmp_path / "out.mp4").with_suffix("." + plate.rpartition(".")[2])
        line = one_line(nlens(shot / plate, shot / glb, out, *more), 4)
        assert "the object is out of view" in line and words in line
        assert not list(tmp_path.iterdir())

    def test_object_just_beside_the_frame_leaves_no_result(self, shot, tmp_path):
        """So near that its blur might have reached in: only drawing it tells."""
        out = tmp_path / "o.png"
        run = nlens(shot / "plate.png", shot / "near.glb", out, "--effects", "none")
        assert "is in view on none of 1 frames" in one_line(run, 4)
        assert not list(tmp_path.iterdir())

    def test_object_that_leaves_the_frame_is_accepted(self, shot, tmp_path):
        run = nlens(
            shot / "in.mp4", shot / "leaves.glb", tmp_path / "o.mp4", "--fit", shot / "fit.json",
            "--json",
        )  # fmt: skip
        assert run.returncode == 0, run.stderr
        assert 0 < json.loads(run.stdout)["composited"] < 12

    def test_range_without_the_object_in_view_is_accepted(self, shot, tmp_path):
        run = nlens(
            shot / "in.mp4", shot / "leaves.glb", tmp_path / "o.mp4", "--fit", shot / "fit.json",
            "--range", "8:", "--json",
        )  # fmt: skip
        assert run.returncode == 0, run.stderr
        assert json.loads(run.stdout)["composited"] == 0

    def test_live_source_may_start_without_the_object_in_view(self, shot, tmp_path):
        size = f"{shots.WIDTH}x{shots.HEIGHT}"
        run = nlens(
            f"testsrc2=size={size}:rate=25:duration=0.2", shot / "behind.glb", tmp_path / "o.mkv",
            "--input-format", "lavfi", "--json",
        )  # fmt: skip
        assert run.returncode == 0, run.stderr
        assert json.loads(run.stdout)["composited"] == 0


class TestOneFrame:
    @pytest.mark.parametrize("words", [["--frame", "5"], ["--range", "5:6"]])
    def test_single_frame_of_a_video_is_written_as_a_picture(self, shot, tmp_path, words):
        out = tmp_path / "out.png"
        run = nlens(
            shot / "in.mp4", shot / "anim.glb", out, "--fit", shot / "fit.json", *words, "--json"
        )
        assert run.returncode == 0, run.stderr
        assert json.loads(run.stdout)["timing"]["frames"] == 1
        whole = nlens(
            shot / "in.mp4", shot / "anim.glb", tmp_path / "all_%04d.png", "--fit",
            shot / "fit.json",
        )  # fmt: skip
        assert whole.returncode == 0, whole.stderr
        assert np.array_equal(cv2.imread(str(out)), cv2.imread(str(tmp_path / "all_0005.png")))

    @pytest.mark.parametrize("name", ["o.jpg", "o.exr", "o.webp", "o.gif", "o.mp4", "o_%04d.png"])
    def test_every_output_format_accepts_a_single_frame(self, shot, tmp_path, name):
        run = nlens(
            shot / "in.mp4", shot / "anim.glb", tmp_path / name, "--fit", shot / "fit.json",
            "--frame", "3",
        )  # fmt: skip
        assert run.returncode == 0, run.stderr
        (made,) = tmp_path.iterdir()
        assert made.name == name.replace("%04d", "0003")

    @pytest.mark.usefixtures("no_pass")
    @pytest.mark.parametrize("words", [["--range", "5:7"], ["--range", "5:"], []])
    def test_several_frames_into_one_picture_are_refused(self, shot, tmp_path, words):
        run = nlens(shot / "in.mp4", shot / "anim.glb", tmp_path / "out.png", *words)
        assert "is one picture" in one_line(run, 6)

    def test_contact_sheet_uses_the_selected_frame(self, shot, tmp_path):
        run = nlens("place", shot / "in.mp4", shot / "bare.glb", tmp_path / "s.png", "--frame", "7")
        assert run.returncode == 0, run.stderr

    @pytest.mark.parametrize("words", [["--frame", "-1"], ["--frame", "1:2"], ["--frame", "x"]])
    def test_frame_option_must_be_a_number(self, shot, tmp_path, words):
        run = nlens(shot / "in.mp4", shot / "anim.glb", tmp_path / "o.png", *words)
        assert "is not the number of a frame" in one_line(run, 2)

    def test_frame_and_range_options_exclude_each_other(self, shot, tmp_path):
        words = ["--frame", "1", "--range", "2:3"]
        run = nlens(shot / "in.mp4", shot / "anim.glb", tmp_path / "o.png", *words)
        assert "not allowed with" in one_line(run, 2)


def test_unwritable_report_folder_is_refused_before_a_check(shot, monkeypatch):
    from nlens_video.check import command

    monkeypatch.setattr(command, "compare", lambda *given, **named: pytest.fail("compared first"))
    plate = shot / "in.mp4"
    run = nlens("check", plate, "--against", plate, "--report", plate)
    assert "is no folder" in one_line(run, 6)


@pytest.mark.parametrize("words", [["render"], ["fit"]])
def test_interval_of_fits_is_refused_for_a_stream(shot, tmp_path, words):
    run = nlens(*words, "-", shot / "anim.glb", tmp_path / "o.json", "--track-focus", "10")
    assert "--track-focus 10 needs a file, not a stream" in one_line(run, 2)

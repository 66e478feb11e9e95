"""`evaluate sequences`: a short clip with a known lens, and the figures by hand."""

import csv
import json
import math
import shutil

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from support.shots import write_video
from support.truth_folder import INTERCEPT, SLOPE, camera, cube_depth, write_rendered

from nlens_video.cli.main import main
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.composite.sequences import (
    BLOCK_PX,
    FrameFigures,
    coc_rms,
    frame_figures,
    over_sequence,
)

FRAMES = 4


@pytest.fixture(scope="module")
def rendered(tmp_path_factory):
    """A cube at rest before a noisy plate; its truth is free of noise."""
    folder = write_rendered(tmp_path_factory.mktemp("made") / "cube")
    plate = cv2.imread(str(folder / "bg.png"))[..., ::-1]
    write_video(folder / "bg.mp4", FRAMES, rgb=plate, rate=24, audio=False)
    codes = cv2.imread(str(folder / "gt_noshadow.png"))
    there = (cube_depth(camera()) < 1e9).astype(np.uint8)
    near = cv2.dilate(there, np.ones((21, 21), np.uint8))
    for name in ("gt_patch", "object"):
        (folder / name).mkdir()
    for index in range(FRAMES):
        patch = np.dstack([codes * near[..., None], 255 * near])
        assert cv2.imwrite(str(folder / "gt_patch" / f"{index:04d}.png"), patch)
        shutil.copy(folder / "object.exr", folder / "object" / f"{index:04d}.exr")
    describe(folder)
    return folder


@pytest.fixture
def sequence(rendered, tmp_path):
    """The same as a copy that a test may spoil."""
    return shutil.copytree(rendered, tmp_path / "cube")


def describe(folder, *, frames=FRAMES, scale=1.0, **changes):
    """`params.json` of the lens by which the plate was made, or of another one."""
    lens = {
        "focus_distance_m": SLOPE / -INTERCEPT,
        "coc_at_infinity_px": -INTERCEPT * scale,
    }
    told = {
        "ground_plane_y_gltf": 0.0,
        "resolution": [320, 180],
        "fps": 24,
        "frames": [{"frame": index, **lens} for index in range(frames)],
    }
    (folder / "params.json").write_text(json.dumps({**told, **changes}))


def rows_of(capsys, *words):
    assert main(["evaluate", "sequences", *map(str, words), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    return {row["name"]: row for row in told["sequences"]["summary"]}


def test_estimated_lens_comes_close_to_the_true_one_and_no_blur_does_not(
    rendered, tmp_path, capsys
):
    rows = rows_of(capsys, rendered.parent, "--out", tmp_path / "tables")
    found, true, sharp = rows["lens found"], rows["true lens"], rows["no blur"]
    assert true["gap_db_most"] == true["object_rms_px"] == true["more_flicker_percent_most"] == 0.0
    assert 0.0 < found["object_rms_px"] < 1.5
    assert abs(found["gap_db_most"]) < 2.0 < 5.0 < sharp["gap_db_most"]
    assert true["psnr_db"] < true["block_psnr_db"]
    names = {path.name for path in (tmp_path / "tables").iterdir()}
    assert names == {"sequences.md", "sequences.csv", "sequence_frames.csv"}
    text = (tmp_path / "tables" / "sequence_frames.csv").read_text()
    lines = list(csv.DictReader(text.splitlines()))
    assert len(lines) == 3 * FRAMES
    true_db = [float(line["psnr_db"]) for line in lines if line["row"] == "true lens"]
    assert np.mean(true_db) == pytest.approx(true["psnr_db"], abs=1e-3)


@pytest.mark.slow
def test_estimated_lens_is_compared_with_the_described_one(sequence, capsys):
    off = rows_of(capsys, sequence)["lens found"]["object_rms_px"]
    describe(sequence, scale=1.5)
    told_more = rows_of(capsys, sequence)
    # the cube's CoC of about 12 px would be half as large again
    assert told_more["lens found"]["object_rms_px"] > off + 3.0
    assert told_more["lens found"]["gap_db_most"] < 0.0


def no_alpha(folder):
    for path in (folder / "gt_patch").iterdir():
        cv2.imwrite(str(path), cv2.imread(str(path)))


def two_lenses(folder):
    lenses = [{"focus_distance_m": 5.0, "coc_at_infinity_px": at} for at in (6.0, 7.0)]
    told = json.loads((folder / "params.json").read_text())
    (folder / "params.json").write_text(json.dumps({**told, "frames": lenses}))


def empty_truth(folder):
    for path in (folder / "gt_patch").iterdir():
        cv2.imwrite(str(path), np.zeros((180, 320, 4), np.uint8))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("spoil", "named"),
    [
        (lambda folder: (folder / "bg.mp4").unlink(), "bg.mp4"),
        (lambda folder: (folder / "bg.mp4").write_bytes(b"no video"), "bg.mp4"),
        (lambda folder: (folder / "params.json").write_text("{"), "params.json"),
        (lambda folder: describe(folder, fps=0), "fps"),
        (lambda folder: describe(folder, frames=FRAMES + 1), "5"),
        (lambda folder: describe(folder, resolution=[160, 90]), "160x90"),
        (lambda folder: (folder / "gt_patch" / "0001.png").unlink(), "0001.png"),
        (lambda folder: shutil.rmtree(folder / "gt_patch"), "gt_patch"),
        (two_lenses, "2 different lenses"),
        (no_alpha, "RGBA"),
        (empty_truth, "empty"),
    ],
)
def test_unusable_sequence_is_refused_in_one_line_with_its_name(sequence, capsys, spoil, named):
    spoil(sequence)
    assert main(["evaluate", "sequences", str(sequence)]) == 3
    told = capsys.readouterr().err
    assert told.count("\n") == 1 and named in told


def frame(*, psnr_db=30.0, detail=0.0):
    return FrameFigures(psnr_db=psnr_db, block_psnr_db=40.0, detail=detail, coc_rms_px=0.5)


OUT_OF_VIEW = FrameFigures(
    psnr_db=math.nan, block_psnr_db=math.nan, detail=math.nan, coc_rms_px=math.nan
)


def test_largest_gap_is_the_frame_farthest_below_the_true_lens():
    known = [frame(psnr_db=db) for db in (30.0, 34.0, 32.0)]
    seen = [frame(psnr_db=db) for db in (30.5, 33.0, 32.0)]
    told = over_sequence(seen, known)
    assert told["gap_db"] == 1.0
    assert told["gap_spread_db"] == pytest.approx(np.std([-0.5, 1.0, 0.0]))
    assert told["spread_db"] == pytest.approx(np.std([30.5, 33.0, 32.0]))


def test_flicker_is_twice_the_amplitude_of_alternating_detail():
    steady = [frame(detail=0.1 * at) for at in range(6)]
    calm = [frame(detail=0.1 * at + 0.01 * (-1) ** at) for at in range(6)]
    wild = [frame(detail=0.1 * at + 0.03 * (-1) ** at) for at in range(6)]
    assert over_sequence(calm, calm)["flicker_percent"] == pytest.approx(2.0)
    assert over_sequence(wild, calm)["more_flicker_percent"] == pytest.approx(200.0)
    assert over_sequence(steady, calm)["more_flicker_percent"] == pytest.approx(-100.0)


def test_frames_without_the_object_are_not_counted():
    seen = [frame(detail=0.1), frame(detail=0.2), frame(detail=0.3)]
    for one in (seen, [*seen, OUT_OF_VIEW]):
        told = over_sequence(one, one)
        assert told["psnr_db"] == 30.0 and told["flicker_percent"] == pytest.approx(0.0, abs=1e-9)


def test_frames_equal_to_the_ground_truth_are_excluded_from_the_gap():
    same = replace(frame(), psnr_db=math.inf, block_psnr_db=math.nan)
    told = over_sequence([same, frame(psnr_db=29.0)], [same, frame(psnr_db=30.0)])
    assert told["gap_db"] == 1.0 and told["psnr_db"] == 29.0
    assert math.isnan(over_sequence([same], [same])["gap_db"])


def test_block_psnr_ignores_noise_but_not_a_shift_of_light():
    truth = np.full((32, 40, 3), 100, np.uint8)
    reach = np.zeros((32, 40), bool)
    reach[4:28, 5:35] = True
    checks = np.indices(reach.shape).sum(axis=0) % 2
    noisy = (truth + np.where(checks, 10, -10)[..., None]).astype(np.uint8)
    lighter = truth + np.uint8(10)
    expected = 20.0 * math.log10(25.5)
    for picture, block in ((noisy, math.inf), (lighter, expected)):
        told = frame_figures(picture, truth, reach, 0.0)
        assert told.psnr_db == pytest.approx(expected)
        assert told.block_psnr_db == pytest.approx(block)
    thin = np.zeros_like(reach)
    thin[: BLOCK_PX - 1] = True
    assert math.isnan(frame_figures(noisy, truth, thin, 0.0).block_psnr_db)


def test_coc_error_is_evaluated_at_the_objects_depths():
    true = LensFit(slope=30.0, intercept=-6.0, width=320, height=180)
    found = LensFit(slope=32.0, intercept=-6.5, width=320, height=180)
    disparity = np.array([0.5, 1.0], np.float32)
    assert coc_rms(found, true, disparity) == pytest.approx(math.sqrt((0.5**2 + 1.5**2) / 2))
    assert math.isnan(coc_rms(None, true, disparity))

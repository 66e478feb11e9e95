"""A lens that changes over a file is followed; one that does not is left alone."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from support import shots

from nlens_video import Compositor
from nlens_video.cli.main import main
from nlens_video.core.errors import LensFitError
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.base.live_lens import LiveLens
from nlens_video.options.parser import parse
from nlens_video.options.to_settings import settings
from nlens_video.run.lens_track_pass import lens_track_pass
from nlens_video.stages.r_lens_change import (
    CHANGED,
    Signature,
    changed,
    differs,
    is_cut,
    signature,
)
from nlens_video.stages.r_lens_track import FitTrack, Keyframe, hold_segments, share_slope
from nlens_video.video.pixels.picture import ArrayPicture


def fit(intercept, frame=0, error=0.2):
    return LensFit(
        slope=24.0, intercept=intercept, slope_stderr=error, intercept_stderr=error,
        width=shots.WIDTH, height=shots.HEIGHT, frame=frame,
    )  # fmt: skip


def shot(rgb, grain=1.0, seed=0):
    noise = grain * np.random.default_rng(seed).standard_normal(rgb.shape)
    return ArrayPicture(np.uint8(np.clip(rgb + noise, 0, 255)), "rgb")


@pytest.mark.parametrize("factor", [0.8, 1.2, 1.5])
def test_signature_changes_with_focus(factor):
    before = signature(shot(shots.plate()))
    after = signature(shot(shots.plate(intercept=factor * shots.INTERCEPT), seed=1))
    assert changed(before, after) > CHANGED
    assert not is_cut(before, after)


def test_signature_ignores_noise_light_and_a_passing_person():
    rgb = shots.plate()
    before = signature(shot(rgb))
    person = rgb.copy()
    person[:, 150:230] = 60
    light = np.uint8(np.clip(0.8 * rgb.astype(np.float32), 0, 255))
    for other in (shot(rgb, 4.0, 1), shot(light, seed=2), shot(person, seed=3)):
        now = signature(other)
        assert changed(before, now) < CHANGED
        assert not is_cut(before, now)


def test_signature_detects_a_cut():
    other = np.uint8(0.4 * shots.plate(7))
    assert is_cut(signature(shot(shots.plate())), signature(shot(other)))


def test_signature_of_a_plate_without_detail_never_changes():
    assert changed(signature(shot(shots.grey(), 0.0)), signature(shot(shots.grey(), 0.0))) == 0.0


def changed_by_definition(reference, now):
    """The second largest of the rows' median changes that half of a row tells."""
    difference = now.ratios - reference.ratios
    medians = [
        abs(np.median(known))
        for row in difference.transpose(0, 2, 1).reshape(-1, difference.shape[1])
        if len(known := row[np.isfinite(row)]) >= difference.shape[1] // 2
    ]
    return sorted(medians)[-2] if len(medians) >= 2 else 0.0


@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.3, 0.6, 0.9, 1.0]))
def test_change_is_that_of_its_definition_where_detail_is_missing(seed, missing):
    random = np.random.default_rng(seed)
    signatures = []
    for _ in range(2):
        ratios = random.standard_normal((6, 8, 2))
        ratios[random.random(ratios.shape) < missing] = np.nan
        signatures.append(Signature(ratios, np.zeros((6, 8))))
    assert changed(*signatures) == changed_by_definition(*signatures)


@given(st.lists(st.floats(-30, 30), min_size=2, max_size=9), st.integers(2, 12))
def test_fit_track_is_smooth_and_stays_between_its_keyframes(intercepts, spacing):
    keys = tuple(Keyframe(at * spacing, 0, fit(value)) for at, value in enumerate(intercepts))
    track = FitTrack(hold_segments(keys, spacing, {keys[-1].index: 200}), 5.0)
    values = np.array([track.at(index).intercept for index in range(keys[-1].index + 1)])
    span = max(intercepts) - min(intercepts)
    assert np.abs(np.diff(values)).max(initial=0.0) <= 0.75 * span + 1e-9
    assert values.min() >= min(intercepts) - 0.5 * span - 1e-6
    assert values.max() <= max(intercepts) + 0.5 * span + 1e-6


def test_fit_track_of_a_linear_focus_pull_has_no_lag():
    keys = tuple(Keyframe(at, 0, fit(-10.0 - 0.1 * at)) for at in range(0, 60, 6))
    track = FitTrack(keys, 5.0)
    for index in range(54):
        assert track.at(index).intercept == pytest.approx(-10.0 - 0.1 * index, abs=1e-6)


def test_fit_track_keeps_its_ends_outside_of_its_keyframes():
    keys = tuple(Keyframe(at, 0, fit(-10.0 - 0.1 * at)) for at in range(6, 30, 6))
    track = FitTrack(keys, 5.0)
    assert track.at(0).intercept == track.at(6).intercept == pytest.approx(-10.6, abs=1e-6)
    assert track.at(99).intercept == track.at(24).intercept == pytest.approx(-12.4, abs=1e-6)


def test_lens_rests_until_the_last_frame_on_which_it_was_seen_at_rest():
    keys = (Keyframe(0, 0, fit(-10.0)), Keyframe(15, 0, fit(-16.0)))
    track = FitTrack(hold_segments(keys, 3, {0: 12, 15: 24}), 1.0)
    values = [track.at(index).intercept for index in range(25)]
    assert values[:10] == pytest.approx([-10.0] * 10, abs=0.01)
    assert -16.0 < values[13] < -10.0
    assert values[18:] == pytest.approx([-16.0] * 7, abs=0.01)


def test_fits_of_a_shot_share_the_slope_that_they_agree_on():
    errors = (3.0, 1.5, -2.0)
    keys = [
        Keyframe(
            at, 0,
            replace(
                fit(-10.0 - at - 0.5 * error), slope=24.0 + error, slope_stderr=4.0,
                intercept_stderr=2.0, correlation=-1.0,
            ),
        )
        for at, error in enumerate(errors)
    ]  # fmt: skip
    shared = share_slope(keys)
    assert {key.fit.slope for key in shared} == {24.0 + np.mean(errors)}
    ends = [key.fit.intercept for key in shared]
    np.testing.assert_allclose(np.diff(ends), -1.0, rtol=1e-9)
    opened = [keys[0], replace(keys[1], fit=replace(keys[1].fit, slope=40.0))]
    assert share_slope(opened) == tuple(opened), "an aperture that opens changes the slope"


def test_fit_track_jumps_at_a_cut():
    keys = (
        Keyframe(0, 0, fit(-10.0)),
        Keyframe(20, 1, fit(-20.0, 20)),
        Keyframe(30, 1, fit(-20.0, 30)),
    )
    track = FitTrack(hold_segments(keys, 5, {0: 18, 20: 27, 30: 40}), 5.0, cuts=(20,))
    assert track.at(19).intercept == pytest.approx(-10.0)
    assert track.at(20).intercept == pytest.approx(-20.0)


@pytest.fixture(scope="module")
def pulled(tmp_path_factory):
    """A focus pull: rest, 20 frames of pulling, rest."""
    folder = tmp_path_factory.mktemp("pull")
    for index in range(40):
        share = np.clip((index - 10) / 20, 0, 1)
        rgb = shots.plate(intercept=shots.INTERCEPT * (1 + 0.5 * share))
        shots.write_png(folder / f"in_{index:04d}.png", shot(rgb, seed=index).array)
    shots.cube_glb(folder / "anim.glb")
    return folder


def arguments(folder, *more):
    return [
        str(folder / "in_%04d.png"), str(folder / "anim.glb"), str(folder / "out_%04d.png"),
        "--input-rate", "25", *more,
    ]  # fmt: skip


@pytest.mark.slow
def test_focus_pull_is_tracked(pulled):
    track = lens_track_pass(settings(parse(arguments(pulled))))
    assert track is not None
    there = 0.55  # a disparity of the ground in view
    values = np.array([track.at(index).coc_px(np.float32(there)) for index in range(40)])
    shares = np.clip((np.arange(40) - 10) / 20, 0, 1)
    truth = shots.SLOPE * there + shots.INTERCEPT * (1 + 0.5 * shares)
    assert np.abs(values - truth).max() < 1.5
    assert np.abs(np.diff(values, 2)).max() < 0.15


@pytest.mark.slow
def test_focus_pull_that_accelerates_to_the_last_frame_is_tracked_to_its_end(tmp_path):
    ends = 1.5 - 0.9 * (np.arange(29) / 28) ** 2
    for index, factor in enumerate(ends):
        rgb = shots.plate(3, intercept=factor * shots.INTERCEPT)
        shots.write_png(tmp_path / f"in_{index:04d}.png", shot(rgb, seed=index).array)
    shots.cube_glb(tmp_path / "anim.glb")
    track = lens_track_pass(settings(parse(arguments(tmp_path))))
    assert track is not None
    assert track.keys[-1].index == 28
    there = np.linspace(0.4, 0.8, 5)  # disparities of the ground in view
    error = [
        track.at(index).coc_px(there) - shots.SLOPE * there - factor * shots.INTERCEPT
        for index, factor in enumerate(ends)
    ]
    assert np.abs(error).mean() < 0.4
    assert np.abs(error).max() < 1.0


@pytest.mark.slow
def test_fit_follows_a_lens_that_changes_by_default(pulled, tmp_path):
    plate, glb, _ = arguments(pulled)[:3]
    kept = tmp_path / "fit.json"
    assert main(["fit", plate, glb, str(kept), "--input-rate", "25"]) == 0
    track = FitTrack.load(kept)
    assert track is not None
    assert len(track.keys) > 3


@pytest.mark.slow
def test_constant_focus_is_not_tracked(pulled, tmp_path):
    for index in range(12):
        shots.write_png(tmp_path / f"in_{index:04d}.png", shot(shots.plate(), seed=index).array)
    shots.cube_glb(tmp_path / "anim.glb")
    assert lens_track_pass(settings(parse(arguments(tmp_path)))) is None
    assert lens_track_pass(settings(parse(arguments(pulled, "--track-focus", "off")))) is None
    given = shots.fit_json(tmp_path / "fit.json")
    assert lens_track_pass(settings(parse(arguments(pulled, "--fit", str(given))))) is None


@pytest.mark.slow
def test_no_change_is_told_on_twenty_shots_of_a_constant_lens_with_walkers(tmp_path):
    """Every third frame is fitted; a dark or bright figure walks over the ground of each shot."""
    rng = np.random.default_rng(0)
    for seed in range(20):
        folder = tmp_path / str(seed)
        folder.mkdir()
        shots.cube_glb(folder / "anim.glb")
        rgb = shots.plate(seed, slope=rng.uniform(0.5, 1.5) * shots.SLOPE)
        tone, top = rng.integers(20, 235), rng.integers(0, shots.HEIGHT // 2)
        for index in range(10):
            walked = rgb.copy()
            left = int(shots.WIDTH * (index / 10))
            walked[top:, left : left + shots.WIDTH // 8] = tone
            shots.write_png(folder / f"in_{index:04d}.png", shot(walked, 2.0, seed=index).array)
        track = lens_track_pass(settings(parse(arguments(folder, "--track-focus", "3"))))
        assert track is None, f"shot {seed}: {track.describe()}"


def test_fit_that_differs_by_less_than_its_error_does_not_move_the_live_lens():
    live = LiveLens(1 / 25)
    live.found(fit(-10.0, error=2.0))
    live.found(fit(-12.0, error=2.0))
    assert live.fits == 1 and live.step(1).intercept == -10.0
    live.found(fit(-18.0, error=2.0))
    assert live.fits == 2 and live.step(2).intercept < -10.0


def test_change_beyond_the_readings_errors_is_told_however_open_both_lenses_are():
    before = LensFit(slope=0.1, intercept=-4.0, intercept_stderr=5.0, width=8, height=8)
    now = replace(before, intercept=-8.0)
    assert not differs(before, now, still=True)
    assert differs(*(replace(fit, readings_share=0.1) for fit in (before, now)), still=True)


def test_unsigned_blur_is_compared_where_the_sign_is_ambiguous():
    near = LensFit(slope=0.1, intercept=4.0, sign="ambiguous", width=8, height=8)
    far = LensFit(slope=0.1, intercept=-4.2, width=8, height=8)
    assert not differs(near, far, still=True)
    assert differs(replace(near, sign="resolved"), far, still=True)


@pytest.mark.slow
@pytest.mark.needs_gl
def test_command_tracks_focus_and_reports_it(pulled, capsys):
    assert main(arguments(pulled, "--json", "--preset", "realtime")) == 0
    outcome = json.loads(capsys.readouterr().out)
    assert any("the lens changes" in note for note in outcome["notes"])
    first, last = (cv2.imread(str(pulled / "out_%04d.png") % at) for at in (0, 39))
    assert first is not None and np.abs(first.astype(int) - last).max() > 20


@pytest.mark.slow
@pytest.mark.needs_gl
def test_saved_focus_track_reproduces_the_tracking_run(pulled, tmp_path):
    plate, glb, _ = arguments(pulled)[:3]
    kept = tmp_path / "fit.json"
    rate = ("--input-rate", "25", "-q")
    assert main(["fit", plate, glb, str(kept), "--track-focus", "auto", *rate]) == 0
    followed = lens_track_pass(settings(parse(arguments(pulled))))
    assert FitTrack.load(kept) == followed
    assert LensFit.load(kept) == followed.at(0)
    double = followed.for_width(2 * shots.WIDTH, 2 * shots.HEIGHT)
    assert double.at(7).slope == pytest.approx(2 * followed.at(7).slope)
    for name, more in (("a", ()), ("b", ("--fit", str(kept)))):
        result = str(tmp_path / f"{name}_%04d.png")
        assert main([plate, glb, result, "--preset", "realtime", *rate, *more]) == 0
    for index in (0, 20, 39):
        pictures = (tmp_path / f"{name}_{index:04d}.png" for name in "ab")
        assert len({picture.read_bytes() for picture in pictures}) == 1


@pytest.mark.slow
@pytest.mark.needs_gl
def test_run_saves_the_focus_track_that_it_followed_or_was_given(pulled, tmp_path):
    plate, glb, _ = arguments(pulled)[:3]
    found, kept = tmp_path / "found.json", tmp_path / "kept.json"
    for name, more in (
        ("a", ("--save-fit", str(found))),
        ("b", ("--fit", str(found), "--save-fit", str(kept))),
    ):
        result = str(tmp_path / f"{name}_%04d.png")
        words = [plate, glb, result, "--preset", "draft", "--input-rate", "25", "-q", *more]
        assert main(words) == 0
    assert FitTrack.load(found) is not None
    assert found.read_text() == kept.read_text()
    for index in (0, 20, 39):
        pictures = (tmp_path / f"{name}_{index:04d}.png" for name in "ab")
        assert len({picture.read_bytes() for picture in pictures}) == 1


@pytest.mark.slow
@pytest.mark.needs_gl
def test_reported_lens_of_a_followed_focus_is_that_of_the_first_frame_of_the_run(
    pulled, tmp_path, capsys
):
    plate, glb, _ = arguments(pulled)[:3]
    kept = tmp_path / "fit.json"
    rest = ("--input-rate", "25", "--range", "30:34")
    assert main(["fit", plate, glb, str(kept), *rest]) == 0
    there, track = LensFit.load(kept), FitTrack.load(kept)
    assert there.intercept == track.at(30).intercept
    assert abs(there.intercept - track.at(0).intercept) > 1.0
    capsys.readouterr()
    result = str(tmp_path / "out_%04d.png")
    assert main([plate, glb, result, *rest, "--fit", str(kept), "--preset", "draft", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)["fit"]
    assert told["intercept"] == pytest.approx(there.intercept)


@pytest.mark.slow
@pytest.mark.needs_gl
def test_focus_that_is_given_does_not_hold_a_lens_that_changes(pulled):
    told = lens_track_pass(settings(parse(arguments(pulled, "--lens", "focus 2m"))))
    free = lens_track_pass(settings(parse(arguments(pulled))))
    assert free is not None and told == free


@pytest.mark.slow
@pytest.mark.needs_gl
@pytest.mark.parametrize("command", [(), ("fit",)])
def test_focus_that_is_given_is_said_not_to_be_used_where_the_lens_changes(
    pulled, tmp_path, capsys, command
):
    plate, glb = arguments(pulled)[:2]
    out = str(tmp_path / ("fit.json" if command else "out_%04d.png"))
    words = [*command, plate, glb, out, "--input-rate", "25", "--lens", "focus 2m"]
    assert main([*words, *(() if command else ("--preset", "draft"))]) == 0
    assert "the focus of --lens is not used" in capsys.readouterr().err


def test_fit_file_with_an_invalid_track_is_refused_in_one_line(tmp_path):
    kept = shots.fit_json(tmp_path / "fit.json")
    assert FitTrack.load(kept) is None
    for track in ({}, {"keys": []}, {"keys": [{"index": 0}], "stretch": 1, "cuts": []}):
        kept.write_text(json.dumps({**json.loads(kept.read_text()), "track": track}))
        with pytest.raises(LensFitError, match="makes no sense"):
            FitTrack.load(kept)


@pytest.mark.parametrize(
    ("first", "edit"),
    [(0, {"slope": 30.0}), (6, {"intercept": -4.0}), (0, {"width": 2 * shots.WIDTH})],
)
def test_fit_file_that_was_edited_beside_its_track_is_refused_in_one_line(tmp_path, first, edit):
    keys = tuple(Keyframe(at, 0, fit(-10.0 - 0.1 * at, at)) for at in range(0, 30, 6))
    kept = tmp_path / "fit.json"
    kept.write_text(FitTrack(keys, 5.0).to_json(first))
    assert FitTrack.load(kept).keys == keys
    kept.write_text(json.dumps({**json.loads(kept.read_text()), **edit}))
    with pytest.raises(LensFitError, match=r'are not those of its "track".*delete "track"'):
        FitTrack.load(kept)


def test_fit_file_of_a_shot_without_a_key_of_its_own_is_read(tmp_path):
    keys = tuple(Keyframe(at, 1, fit(-10.0 - at, at)) for at in (20, 26, 32))
    kept = tmp_path / "fit.json"
    kept.write_text(FitTrack(keys, 5.0, cuts=(15,)).to_json())
    assert FitTrack.load(kept).at(0) == keys[0].fit


def test_live_lens_keeps_up_with_a_pull_between_its_fits():
    """Fits every 0.2 s of a focus that moves at a constant rate: a lag of 0.06 s at most."""
    live, rate = LiveLens(1 / 25), -0.4
    values = []
    for index in range(40):
        if index % 5 == 0 and (not index or live.calls_for_fit(0.2, index)):
            live.found(fit(-10.0 + rate * index))
        values.append(live.step(index).intercept)
    lag = [(-10.0 + rate * index - value) / rate for index, value in enumerate(values)]
    assert max(np.abs(lag[15:])) <= 0.06 * 25
    assert live.step(65).intercept == pytest.approx(-10.0 + rate * 35, abs=0.05)


def test_live_focus_tracking_is_gradual_except_at_cuts():
    live = LiveLens(1 / 25)
    assert live.step(0) is None
    rgb = shots.plate()
    live.begin(fit(-10.0), 0, shot(rgb, seed=0))
    assert not any(live.needs_refit(index, shot(rgb, seed=index)) for index in range(1, 9))
    pulled = shots.plate(intercept=1.5 * shots.INTERCEPT)
    assert live.needs_refit(9, shot(pulled, seed=9))
    live.step(8)
    live.found(fit(-18.0))
    values = [live.step(9).intercept]
    for index in range(10, 35):
        assert not live.needs_refit(index, shot(pulled, seed=index))
        values.append(live.step(index).intercept)
    assert np.abs(np.diff(values, prepend=-10.0)).max() < 0.55 * 8.0  # two thirds in 0.12 s
    assert min(values) > -21.0
    assert values[-1] == pytest.approx(-18.0, abs=0.1)
    assert live.needs_refit(36, shot(np.uint8(0.3 * shots.plate(3))))
    live.found(fit(-5.0))
    assert live.step(36).intercept == -5.0


@pytest.mark.slow
@pytest.mark.needs_gl
def test_compositor_tracks_a_focus_pull(tmp_path):
    glb = shots.cube_glb(tmp_path / "cube.glb")
    truth = shots.SLOPE * 0.55 + 1.5 * shots.INTERCEPT
    ends = {}
    for track_focus in ("auto", "off"):
        with Compositor(glb, preset="draft", fps=25, track_focus=track_focus) as lens:
            for index in range(36):
                share = np.clip((index - 8) / 12, 0, 1)
                rgb = shots.plate(intercept=shots.INTERCEPT * (1 + 0.5 * share))
                lens.process(shot(rgb, seed=index).array[..., ::-1])
            ends[track_focus] = float(lens.fit.coc_px(np.float32(0.55)))
    assert abs(ends["auto"] - truth) < 1.5
    assert abs(ends["off"] - truth) > 3.0

"""A first look at a file tells whether its lens rests, and what moves as a still camera sees it."""

import threading
from threading import Event

import numpy as np
import pytest
from support import shots, takes

from nlens_video.core import signals
from nlens_video.core.errors import InputError
from nlens_video.effects.foreground.survey import StaticCameraSurvey
from nlens_video.options.parser import parse
from nlens_video.options.to_settings import settings
from nlens_video.run import first_look as module
from nlens_video.run.first_look import begun_look, first_look
from nlens_video.run.lens_track_pass import lens_track_pass
from nlens_video.run.open_run import read_again
from nlens_video.run.plate_source import opened

SIZE = shots.WIDTH, shots.HEIGHT


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """Writes a clip in H.264 with B frames, of plates by the factor on the lens' intercept."""

    def write(factors, seed=0):
        folder = tmp_path_factory.mktemp("clip")
        rng = np.random.default_rng(seed)
        plates = {one: shots.plate(intercept=one * shots.INTERCEPT) for one in set(factors)}
        frames = [(plates[one] + rng.normal(0, 1, plates[one].shape)) / 255 for one in factors]
        takes.encode(folder / "in.mp4", frames, size=SIZE, crf=16, audio=False)
        shots.cube_glb(folder / "anim.glb")
        return folder

    return write


def asked(folder, *more):
    words = [str(folder / "in.mp4"), str(folder / "anim.glb"), str(folder / "out.mp4")]
    return settings(parse([*words, *more]))


def pulled(frames, begin, end):
    return [round(float(np.interp(at, [begin, end], [1.0, 1.5])), 3) for at in range(frames)]


@pytest.mark.parametrize(
    ("factors", "rests"),
    [
        ([1.0] * 30, True),
        (pulled(30, 8, 20), False),
        (pulled(30, 25, 29), False),
        ([1.0], True),
    ],
    ids=["rest", "pull", "pull at the end", "one frame"],
)
def test_a_lens_is_told_to_rest_or_not_by_few_frames_of_the_file(clip, factors, rests):
    look = first_look(asked(clip(factors)))
    assert look is not None
    assert look.lens_rests == rests


def test_a_cut_calls_for_the_exact_pass(clip):
    folder = clip([1.0] * 12)
    shown = [shots.plate() / 255] * 12 + [0.4 / 255 * shots.plate(7)] * 12
    takes.encode(folder / "in.mp4", shown, size=SIZE, audio=False)
    look = first_look(asked(folder))
    assert look is not None and not look.lens_rests


def test_frames_that_no_other_needs_are_not_decoded_and_few_are_measured(clip, monkeypatch):
    folder, measured = clip([1.0] * 50), []
    real = module.signature
    monkeypatch.setattr(module, "signature", lambda picture: (measured.append(1), real(picture))[1])
    look = first_look(asked(folder))
    assert len(look.survey.times) < 45
    assert len(measured) <= 12


def test_the_exact_pass_is_left_out_where_the_lens_rests(clip, monkeypatch):
    folder = clip([1.0] * 20)
    look = first_look(asked(folder))
    monkeypatch.setattr(
        "nlens_video.run.lens_track_pass.opened", lambda source: pytest.fail("read again")
    )
    assert lens_track_pass(asked(folder), look) is None


def test_survey_of_the_first_look_is_that_of_a_look_of_its_own(clip):
    folder = clip([1.0] * 30)
    given = asked(folder)
    look = first_look(given)
    with opened(given.source) as source:
        info = source.info
    own = StaticCameraSurvey((info.width, info.height))
    for frame in read_again(given.source, info)(sparse=True):
        own.see(frame)
    assert own.times == look.survey.times
    np.testing.assert_array_equal(own.survey.model().roots, look.survey.survey.model().roots)


def test_a_look_that_has_begun_is_the_look(clip):
    given = asked(clip(pulled(30, 8, 20)))
    look = first_look(given)
    with begun_look(given) as begun:
        found = begun()
    assert found.lens_rests == look.lens_rests
    assert found.survey.times == look.survey.times


def test_a_look_that_nobody_waits_for_ends(clip):
    given, left = asked(clip([1.0] * 12)), Event()
    left.set()
    assert first_look(given, left) is None
    with begun_look(given):
        pass
    assert not [one for one in threading.enumerate() if one.name in ("begun", "decode")]


def test_a_fault_of_a_look_is_raised_where_it_is_waited_for(tmp_path):
    shots.cube_glb(tmp_path / "anim.glb")
    (tmp_path / "in.mp4").write_bytes(b"no film")
    with begun_look(asked(tmp_path)):
        pass
    with begun_look(asked(tmp_path)) as begun, pytest.raises(InputError, match=r"in\.mp4"):
        begun()


@pytest.mark.parametrize("first", [KeyboardInterrupt(), InputError("no picture")])
def test_an_interrupt_of_a_look_does_not_replace_the_error_that_ends_the_run(first, monkeypatch):
    seen = Event()

    def looking(settings, left):
        seen.set()
        left.wait(10)
        signals.check()

    monkeypatch.setattr(module, "first_look", looking)
    monkeypatch.setattr(signals, "requested", Event())
    with pytest.raises(BaseException) as caught, begun_look(None):
        assert seen.wait(10)
        signals.requested.set()
        first.add_note("the part written so far is X")
        raise first
    assert caught.value is first
    assert caught.value.__notes__ == ["the part written so far is X"]


@pytest.mark.parametrize(
    "more",
    [("--track-focus", "off", "--occlusion", "none"), ("--track-focus", "3"),
     ("--effects", "none"), ("--frame", "0")],
)  # fmt: skip
def test_nothing_is_looked_at_where_neither_lens_nor_what_moves_is_asked_for(clip, more):
    folder = clip([1.0] * 3)
    out = ["--frame", "0"] if "--frame" in more else []
    words = [str(folder / "in.mp4"), str(folder / "anim.glb")]
    words.append(str(folder / ("out.png" if out else "out.mp4")))
    assert first_look(settings(parse([*words, *more]))) is None


def test_with_a_known_lens_only_what_moves_is_surveyed(clip, monkeypatch):
    folder = clip([1.0] * 12)
    monkeypatch.setattr(module, "signature", lambda picture: pytest.fail("the lens is watched"))
    shots.fit_json(folder / "fit.json")
    look = first_look(asked(folder, "--fit", str(folder / "fit.json")))
    assert len(look.survey.times) > 1


def test_what_moves_is_not_surveyed_where_it_is_known(clip):
    look = first_look(asked(clip([1.0] * 12), "--occlusion", "none"))
    assert look.lens_rests
    assert look.survey is None


def test_of_a_range_only_its_frames_are_read_and_no_survey_is_kept(clip):
    look = first_look(asked(clip(pulled(30, 20, 29)), "--range", "0:12"))
    assert look.lens_rests
    assert look.survey is None

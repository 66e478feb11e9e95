"""The plug-in for OpenCV, PyAV and numpy loops."""

import os
import pickle
import threading
import tracemalloc
from concurrent.futures import ThreadPoolExecutor
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from support import shots

from nlens_video import Compositor
from nlens_video.core.errors import (
    InputError,
    LensFitError,
    SceneError,
    UsageError,
)
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Aperture
from nlens_video.stages.r_lens_track import FitTrack, Keyframe

pytestmark = pytest.mark.needs_gl
FIT = LensFit(slope=shots.SLOPE, intercept=shots.INTERCEPT, width=shots.WIDTH, height=shots.HEIGHT)


@pytest.fixture(scope="module")
def glb(tmp_path_factory):
    path = tmp_path_factory.mktemp("glb") / "anim.glb"
    return shots.cube_glb(path, end=(0.3, 0.0, -2.6), seconds=0.5)


@pytest.fixture
def lens(glb):
    with Compositor(glb, preset="realtime", fit=FIT, fps=25) as compositor:
        yield compositor


def bgr():
    return np.ascontiguousarray(shots.plate()[..., ::-1])


def test_result_has_the_frames_form_and_the_frame_is_not_modified(lens):
    frame = bgr()
    result = lens.process(frame)
    assert (result.shape, result.dtype) == (frame.shape, frame.dtype)
    assert np.array_equal(frame, bgr())
    changed = (result != frame).any(axis=2)
    assert 0.005 < changed.mean() < 0.3


def test_what_is_far_off_half_way_of_a_frame_leaves_the_streak_that_it_has_in_view(tmp_path):
    glb = shots.cube_glb(
        tmp_path / "dash.glb", start=(-6.0, 0.0, -1.6), end=(0.0, 0.0, -1.6), seconds=0.02
    )
    options = {"preset": "standard", "effects": "motion-blur", "shutter_angle": 360.0}
    with Compositor(glb, fit=FIT, fps=25, **options) as lens:
        first = lens.process(bgr())
    assert (first != bgr()).any(axis=2).mean() > 0.01


@pytest.mark.parametrize("form", ["new", "the frame", "every other column"])
def test_result_is_written_into_the_array_that_is_given(lens, glb, form):
    frame = bgr()
    expected = lens.process(frame, time=0.1)
    wide = np.zeros((shots.HEIGHT, 2 * shots.WIDTH, 3), np.uint8)
    out = {"new": np.zeros_like(frame), "the frame": frame, "every other column": wide[:, ::2]}[
        form
    ]
    assert lens.process(frame, 0.1, out) is out
    np.testing.assert_array_equal(out, expected)
    assert not wide[:, 1::2].any()


def test_frame_that_takes_its_own_result_costs_no_memory_of_its_size(glb):
    frame = np.random.default_rng(0).integers(0, 256, (1080, 1920, 3), np.uint8)

    def most_bytes(out):
        tracemalloc.start()
        lens.process(frame, 0.1, out)
        most = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return most

    with Compositor(glb, preset="draft", effects="none", fit=FIT, fps=25) as lens:
        lens.process(frame, 0.0)
        for _ in range(2):  # what is kept from frame to frame is there then
            lens.process(frame, 0.1, frame)
        in_place, anew = most_bytes(frame), most_bytes(None)
    assert in_place < frame.nbytes < 1.01 * (anew - in_place)


@pytest.mark.parametrize(
    ("out", "said"),
    [
        (np.zeros((4, 4, 3), np.uint8), r"out is \(4, 4, 3\) of uint8; expected an array"),
        (bgr().astype(np.float32), "of float32; expected an array"),
        (np.frombuffer(bytes(bgr()), np.uint8).reshape(bgr().shape), "read-only"),
        ([1, 2], "not list"),
    ],
)
def test_array_that_cannot_take_the_result_is_refused(lens, out, said):
    with pytest.raises(UsageError, match=said):
        lens.process(bgr(), out=out)


def test_channel_order_is_bgr_as_in_opencv(lens):
    result = lens.process(bgr())
    changed = np.abs(result.astype(int) - bgr()).max(axis=2) > 60
    blue, _, red = result[changed].astype(float).mean(axis=0)
    assert red > blue  # the cube is orange


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16, np.float32])
def test_integer_and_float_sample_types_give_the_same_picture(lens, dtype):
    scale = {np.uint8: 1, np.uint16: 257, np.float32: 1 / 255}[dtype]
    result = lens.process((bgr() * np.array(scale, dtype)).astype(dtype), time=0.0)
    plain = lens.process(bgr(), time=0.0)
    assert result.dtype == dtype
    seen = np.minimum(result.astype(np.float64) / scale, 255.0)  # floats hold more than white
    assert np.abs(seen - plain).max() <= 0.51


def test_time_argument_moves_the_object_and_defaults_to_the_frame_count(lens):
    zeroth, first = lens.process(bgr()), lens.process(bgr())
    assert not np.array_equal(zeroth, first)
    assert np.array_equal(lens.process(bgr(), time=1 / 25), first)


def test_av_frames_keep_format_time_and_tags(lens):
    frame = av.VideoFrame.from_ndarray(shots.plate(), "rgb24").reformat(
        format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
    )
    frame.pts, frame.time_base, frame.color_primaries = 7, Fraction(1, 50), 1
    before = frame.to_ndarray().copy()
    result = lens.process_av(frame)
    assert (result.format.name, result.pts, result.time_base) == ("yuv420p", 7, Fraction(1, 50))
    assert result.color_primaries == 1
    assert (result.to_ndarray() != before).any()
    assert np.array_equal(frame.to_ndarray(), before)


def test_animation_of_av_frames_begins_at_the_first_one(lens):
    def frame(pts):
        made = av.VideoFrame.from_ndarray(shots.plate(), "rgb24")
        made.pts, made.time_base = pts, Fraction(1, 25)
        return lens.process_av(made).to_ndarray()

    first, second = frame(1000), frame(1001)
    assert np.array_equal(first, lens.process(bgr(), time=0.0)[..., ::-1])
    assert np.array_equal(second, lens.process(bgr(), time=1 / 25)[..., ::-1])


def test_av_frames_of_packed_formats_keep_their_format(lens):
    frame = av.VideoFrame.from_ndarray(shots.plate(), "rgb24").reformat(format="nv12")
    frame.pts, frame.time_base = 3, Fraction(1, 25)
    result = lens.process_av(frame)
    assert (result.format.name, result.pts, result.time_base) == ("nv12", 3, Fraction(1, 25))


def test_av_frames_without_time_or_tags_are_accepted(lens):
    frame = av.VideoFrame.from_ndarray(bgr(), "bgr24")
    (result,) = lens.stream(iter([frame]))
    assert (result.format.name, result.pts, result.time_base) == ("bgr24", None, None)
    assert np.array_equal(result.to_ndarray(), lens.process(bgr(), time=0.0))


def test_av_frames_that_need_a_conversion_keep_their_colour_tags(lens):
    frame = av.VideoFrame.from_ndarray(bgr(), "bgr24").reformat(format="rgb565le")
    frame.color_range, frame.colorspace = 1, 1
    frame.color_trc, frame.color_primaries = 13, 1
    frame.pts, frame.time_base = 7, Fraction(1, 30)
    result = lens.process_av(frame)
    assert result.format.name == "rgb565le" and (result.pts, result.time_base) == (
        7, Fraction(1, 30),
    )  # fmt: skip
    assert (result.color_range, result.colorspace) == (1, 1)
    assert (result.color_trc, result.color_primaries) == (13, 1)


def test_av_frames_whose_rows_lie_from_the_bottom_up_are_composited_upright(lens, tmp_path):
    light = (shots.plate() / 255.0).astype(np.float32)
    assert cv2.imwrite(str(tmp_path / "in.pfm"), light[..., ::-1])
    with av.open(str(tmp_path / "in.pfm")) as file:
        frame = next(file.decode(video=0))
    assert frame.planes[0].line_size < 0
    changed = (lens.process_av(frame).to_ndarray() != light).any(axis=2)
    expected = (lens.process(bgr(), time=0.0) != bgr()).any(axis=2)
    assert np.count_nonzero(changed & expected) > 0.8 * np.count_nonzero(expected)


def test_av_frames_of_a_read_only_format_are_refused(lens):
    with pytest.raises(InputError, match="pal8"):
        lens.process_av(av.VideoFrame(shots.WIDTH, shots.HEIGHT, "pal8"))
    with pytest.raises(UsageError, match="ndarray"):
        lens.process_av(bgr())
    with pytest.raises(UsageError, match="process_av"):
        lens.process(av.VideoFrame.from_ndarray(bgr(), "bgr24"))


def test_stream_of_frames_holds_one_frame_at_a_time(lens):
    def endless():
        while True:
            yield bgr()

    stream = lens.stream(endless())
    assert next(stream).shape == next(stream).shape
    stream.close()


def test_fit_plan_and_timings_describe_the_run(lens):
    assert lens.plan == ()
    lens.process(bgr())
    lens.process(bgr())
    assert lens.fit == FIT
    assert any("scatter" in line for line in lens.plan)
    assert lens.timings.frames == 2 and "render" in lens.timings.node_median_ms


def test_compositor_can_be_called_from_any_thread(lens):
    with ThreadPoolExecutor(3) as pool:
        results = list(pool.map(lambda _: lens.process(bgr(), time=0.1), range(6)))
    assert all(np.array_equal(results[0], result) for result in results)


def test_closing_ends_the_thread_and_can_be_repeated(glb):
    compositor = Compositor(glb, fit=FIT)
    compositor.process(bgr())
    compositor.close()
    compositor.close()
    assert compositor.fit == FIT and compositor.plan
    with pytest.raises(UsageError, match="closed"):
        compositor.process(bgr())
    assert not [t for t in threading.enumerate() if t.name.startswith("nlens-compositor")]


def test_assigned_fit_takes_effect_on_the_next_frame(lens, glb):
    first = lens.process(bgr(), time=0.0)
    lens.fit = replace(FIT, slope=2 * FIT.slope, intercept=2 * FIT.intercept)
    assert lens.fit.slope == 2 * FIT.slope
    changed = lens.process(bgr(), time=0.0)
    assert not np.array_equal(first, changed)
    with Compositor(glb, preset="realtime", fit=lens.fit, fps=25) as other:
        assert np.array_equal(other.process(bgr(), time=0.0), changed)


def test_fit_assigned_before_the_first_frame_is_used(glb):
    with Compositor(glb, preset="realtime", fps=25) as lens:
        lens.fit = FIT
        lens.process(bgr())
        assert lens.fit == FIT


def test_swapping_the_object_keeps_the_fit_and_the_time(lens, glb, tmp_path):
    lens.process(bgr())
    other = shots.cube_glb(tmp_path / "other.glb", start=(0.3, 0.0, -2.0), size=0.2)
    lens.swap(other)
    swapped = lens.process(bgr())
    assert lens.fit == FIT and lens.timings.frames == 2
    with Compositor(other, preset="realtime", fit=FIT, fps=25) as plain:
        assert np.array_equal(plain.process(bgr(), time=1 / 25), swapped)
    lens.swap(tmp_path / "none.glb")
    with pytest.raises(SceneError, match=r"none\.glb"):
        lens.process(bgr())
    lens.swap(glb)
    assert lens.process(bgr()).shape == bgr().shape


def test_notebook_display_shows_picture_fit_and_plan(lens):
    assert "no frame yet" in lens.show()._repr_html_()
    lens.process(bgr())
    assert len(repr(lens.show())) < 10_000 and "slope=24" in repr(lens.show())
    html = lens.show()._repr_html_()
    assert "data:image/jpeg;base64," in html and "coc_px = 24" in html and "scatter" in html


@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_use_in_a_forked_process_is_refused(lens):
    lens.process(bgr())
    code = os.fork()
    if code == 0:  # no pytest in here, whatever happens
        try:
            lens.process(bgr())
        except UsageError as error:
            os._exit(0 if "another process" in str(error) else 2)
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(code, 0)[1]) == 0
    assert lens.process(bgr()).shape == bgr().shape


@pytest.mark.slow
@pytest.mark.needs_torch
def test_tensors_come_back_as_tensors_of_their_type_and_device(lens):
    import torch

    frame = torch.from_numpy(bgr())
    result = lens.process(frame, time=0.0)
    assert (result.dtype, result.device) == (frame.dtype, frame.device)
    assert np.array_equal(result.numpy(), lens.process(bgr(), time=0.0))


@pytest.mark.needs_torch
@pytest.mark.parametrize("name", ["float16", "bfloat16"])
def test_tensors_of_half_precision_keep_what_the_object_does_not_cover(lens, name):
    import torch

    frame = torch.from_numpy(bgr()).to(getattr(torch, name)) / 255
    result = lens.process(frame, time=0.0)
    assert result.dtype == frame.dtype
    full = frame.float()
    expected = lens.process(full, time=0.0)
    covered = (expected != full).any(dim=2)
    assert 0.01 < covered.float().mean() < 0.5
    assert torch.equal(result, expected.to(frame.dtype))
    assert torch.equal(result[~covered], frame[~covered])


@pytest.mark.parametrize("dtype", [">u2", ">f4", np.float16])
def test_sample_types_of_other_byte_order_or_width_are_kept(lens, dtype):
    native = {">u2": np.uint16, ">f4": np.float32, np.float16: np.float32}[dtype]
    codes = bgr().astype(native)
    frame = codes * native(257) if dtype == ">u2" else (codes / native(255)).astype(dtype)
    frame = frame.astype(dtype)
    result = lens.process(frame, time=0.0)
    expected = lens.process(frame.astype(native), time=0.0)
    assert result.dtype == frame.dtype and np.array_equal(result, expected.astype(dtype))


def test_float_frames_of_0_to_255_are_refused_but_bright_light_is_not(lens):
    with pytest.raises(InputError, match="divide"):
        lens.process(bgr().astype(np.float32))
    bright = bgr().astype(np.float32) / 255
    bright[:40] = 3.0  # a lit sky of scene-linear footage is none of that
    assert lens.process(bright, time=0.0).max() == 3.0


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_float_frames_of_no_numbers_are_refused_with_and_without_a_fit(lens, glb, value):
    said = "most of the float samples are NaN or infinite"
    frame = np.full(bgr().shape, value, np.float32)
    with Compositor(glb) as unfitted, pytest.raises(InputError, match=said):
        unfitted.process(frame)
    with pytest.raises(InputError, match=said):
        lens.process(frame.astype(np.float16))


def test_single_samples_of_no_number_count_as_black_and_stay_beside_the_object(lens):
    frame = bgr().astype(np.float32) / 255
    frame[190:220] = 0.0
    black = lens.process(frame, time=0.0)
    frame[190:220] = np.nan
    result = lens.process(frame, time=0.0)
    kept = np.isnan(result)
    assert 0.5 < kept[190:220].mean() < 1.0 and not kept[220:].any()
    np.testing.assert_array_equal(result[~kept], black[~kept])


@pytest.mark.parametrize("dtype", [np.float64, np.int32, bool])
def test_unsupported_sample_types_are_refused(lens, dtype):
    with pytest.raises(InputError, match="expected uint8, uint16, float32 or half precision"):
        lens.process(bgr().astype(dtype))


@pytest.mark.parametrize("shape", [(), (9,), (0, 0, 3), (4, 4, 2), (4, 4, 3, 1)])
def test_floats_of_no_pictures_shape_are_refused(lens, shape):
    with pytest.raises(InputError, match="expected"):
        lens.process(np.zeros(shape, np.float32))


def test_grey_16_bit_frames_keep_shape_and_type(lens):
    frame = bgr()[..., 1].astype(np.uint16) * 257
    result = lens.process(frame)
    assert (result.shape, result.dtype) == (frame.shape, np.uint16) and (result != frame).any()


def test_frames_of_another_size_are_refused(lens):
    lens.process(bgr())
    with pytest.raises(UsageError, match="frame of 480x260 after frames of 480x270: one comp"):
        lens.process(bgr()[:-10])


def test_errors_for_an_unusable_scene_or_wrong_settings_name_them(tmp_path, glb):
    (tmp_path / "bad.glb").write_bytes(b"no")
    with Compositor(tmp_path / "bad.glb") as compositor, pytest.raises(SceneError, match="bad.glb"):
        compositor.process(bgr())
    with pytest.raises(UsageError, match="fps"):
        Compositor(glb, fps=0)
    with pytest.raises(UsageError, match="standard"):
        Compositor(glb, preset="nope")
    with pytest.raises(LensFitError, match=r"none\.json"):
        Compositor(glb, fit=tmp_path / "none.json")
    with Compositor(glb, fit=FIT) as compositor, pytest.raises(UsageError, match="NoneType"):
        compositor.process(None)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"fps": float("inf")}, "fps"),
        ({"budget_ms": -1.0}, "budget_ms"),
        ({"fallback": "any"}, "none, constant"),
        ({"track_focus": "always"}, "auto, off"),
        ({"fit": {"slope": 1}}, "dict"),
    ],
)
def test_invalid_setting_is_refused_by_the_constructor(glb, settings, named):
    with pytest.raises(UsageError, match=named):
        Compositor(glb, **settings)


@pytest.mark.parametrize("time", [float("nan"), float("inf"), "now"])
def test_time_that_is_not_a_finite_number_is_refused(lens, time):
    with pytest.raises(UsageError, match="is not a time"):
        lens.process(bgr(), time=time)


@pytest.mark.parametrize("number", [1.5, "a", -1])
def test_position_that_is_no_whole_number_is_refused(lens, number):
    with pytest.raises(UsageError, match="is not a position"):
        lens.process(bgr(), number=number)


def test_assigning_none_as_fit_is_refused_and_keeps_the_fit(lens):
    with pytest.raises(UsageError, match="NoneType"):
        lens.fit = None
    assert lens.fit == FIT


def test_pickling_a_compositor_is_refused(lens):
    with pytest.raises(UsageError, match="one in each"):
        pickle.dumps(lens)


def test_calls_during_close_end_with_a_frame_or_a_closed_error(glb):
    compositor = Compositor(glb, preset="draft", fit=FIT)
    compositor.process(bgr())

    def ask(_):
        try:
            return compositor.process(bgr(), time=0.0).shape == bgr().shape
        except UsageError as error:
            return "closed" in str(error)

    with ThreadPoolExecutor(6) as pool:
        asked = [pool.submit(ask, number) for number in range(30)]
        compositor.close()
        assert all(one.result() for one in asked)


def test_fit_is_loaded_from_a_path(tmp_path, glb):
    with Compositor(glb, fit=shots.fit_json(tmp_path / "fit.json")) as compositor:
        compositor.process(bgr())
        assert compositor.fit == FIT


@pytest.fixture
def track(tmp_path):
    """A lens that a run followed over 40 frames, and its file."""
    keys = tuple(
        Keyframe(at, 0, replace(FIT, intercept=shots.INTERCEPT * (1 + at / 40), frame=at))
        for at in range(0, 41, 8)
    )
    path = tmp_path / "track.json"
    path.write_text(FitTrack(keys, 3.0).to_json())
    return FitTrack(keys, 3.0), path


def test_lens_of_a_saved_track_follows_the_position_of_each_frame(track, glb):
    followed, path = track
    options = {"preset": "draft", "fps": 25}
    with Compositor(glb, fit=path, **options) as lens:
        assert lens.fit == followed.at(0)
        for number in (0, 1, 2):
            assert lens.process(bgr(), 0.0).any()
            assert lens.fit == followed.at(number)
        later = lens.process(bgr(), 0.0, number=30)
        assert lens.fit == followed.at(30)
        assert any("the lens changes" in line for line in lens.plan)
    with Compositor(glb, fit=followed.at(30), **options) as constant:
        np.testing.assert_array_equal(constant.process(bgr(), 0.0), later)


def test_saved_track_is_that_of_frames_of_another_size(track, glb):
    half = cv2.resize(bgr(), None, fx=0.5, fy=0.5)
    with Compositor(glb, preset="draft", fit=track[1]) as lens:
        lens.process(half, number=20)
        assert lens.fit.intercept == pytest.approx(0.5 * track[0].at(20).intercept)


def test_track_goes_on_after_the_object_is_swapped_and_ends_with_a_fit(track, glb):
    followed, path = track
    with Compositor(glb, preset="draft", fit=FIT) as lens:
        lens.process(bgr())
        lens.fit = path
        lens.process(bgr(), number=16)
        assert lens.fit == followed.at(16)
        lens.swap(glb)
        lens.process(bgr(), number=24)
        assert lens.fit == followed.at(24)
        lens.fit = FIT
        lens.process(bgr(), number=32)
        assert lens.fit == FIT


def test_aperture_is_given_as_text_or_object_with_the_same_result(glb):
    pictures = []
    for changes in ({}, {"aperture": "3:20"}, {"aperture": Aperture(blades=3, rotation_deg=20.0)}):
        with Compositor(glb, preset="realtime", fit=FIT, fps=25, **changes) as compositor:
            pictures.append(compositor.process(bgr(), time=0.0))
    plain, words, typed = pictures
    assert np.array_equal(words, typed) and not np.array_equal(words, plain)


def test_invalid_aperture_is_refused_by_the_constructor(glb):
    with pytest.raises(UsageError, match="is not auto, round"):
        Compositor(glb, aperture="oval")
    with pytest.raises(UsageError, match="cat-eye"):
        Compositor(glb, cat_eye=2.0)
    with pytest.raises(UsageError, match="leave cat_eye out"):
        Compositor(glb, aperture=Aperture(blades=5), cat_eye=0.5)

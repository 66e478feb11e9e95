"""OpenCV's capture with an object in its frames, beside OpenCV's own on the same real files."""

import threading
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from support import shots
from support.clips import write_clip
from support.conformance import OPTIONS as OPTIONS_OF_PLATES
from support.conformance import (
    RATE,
    Composited,
    assert_conforms,
    assert_same_errors,
    by_command_line,
    write_plate,
)
from support.programs import made

import nlens_video
from nlens_video import Compositor, VideoCapture
from nlens_video.core.errors import NlensError, SceneError, UsageError
from nlens_video.core.lens_fit import LensFit
from nlens_video.stages.r_lens_track import FitTrack, Keyframe

pytestmark = pytest.mark.needs_gl
FIT = LensFit(slope=shots.SLOPE, intercept=shots.INTERCEPT, width=shots.WIDTH, height=shots.HEIGHT)
OPTIONS = {"preset": "draft", "fit": FIT}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("capture")
    shots.write_video(folder / "in.mp4", frames=12)
    shots.cube_glb(folder / "anim.glb", end=(0.3, 0.0, -2.6), seconds=0.5)
    return str(folder / "in.mp4"), folder / "anim.glb"


@pytest.fixture
def capture(files):
    with VideoCapture(*files, **OPTIONS) as made:
        yield made


def by_hand(files):
    """The composites that a loop over OpenCV's capture makes."""
    plate = cv2.VideoCapture(files[0])
    with Compositor(files[1], fps=plate.get(cv2.CAP_PROP_FPS), **OPTIONS) as lens:
        while plate.grab():
            time = plate.get(cv2.CAP_PROP_POS_MSEC) / 1000
            yield lens.process(plate.retrieve()[1], time)


def test_frames_are_those_of_opencv_composited(capture, files):
    expected = list(by_hand(files))
    found = []
    while (read := capture.read())[0]:
        found.append(read[1])
    assert len(found) == 12
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_array_equal(one, other)
    assert capture.read() == (False, None)


def conforming(plate, options):
    """What the capture makes of a plate in bgr0, whose fourth byte is no sample."""
    options = dict(options)
    made, times = [], []
    with VideoCapture(plate.path, options.pop("glb", plate.glb), **options) as capture:
        while (read := capture.read())[0]:
            made.append(as_bgr0(read[1]))
            times.append(Fraction(len(times), RATE))
    return Composited(made, times)


def as_bgr0(frame):
    blank = np.zeros((*frame.shape[:2], 4), np.uint8)
    blank[..., :3] = frame
    return [blank.reshape(len(blank), -1)]


def of_command_line(plate):
    expected = by_command_line(plate)
    for planes in expected.planes:
        planes[0][:, 3::4] = 0
    return expected


@pytest.mark.slow
def test_frames_and_errors_are_those_of_the_command_line(tmp_path):
    plate = write_plate(tmp_path, "packed")
    assert_conforms(conforming, plate, of_command_line(plate))
    assert_same_errors(conforming, plate, (NlensError, TypeError), host_checks_names=True)


@pytest.mark.slow
@pytest.mark.needs_programs("ffmpeg")
def test_pixels_that_are_not_square_are_honoured(tmp_path):
    plate = write_plate(tmp_path, "packed")
    wide = made("-i", plate.path, "-c", "copy", "-aspect", "8:3", tmp_path / "wide.mkv")
    wide.replace(plate.path)
    expected = of_command_line(plate)
    assert_conforms(conforming, plate, expected)
    square = conforming(plate, {**OPTIONS_OF_PLATES, "fit": plate.fit, "pixel_aspect": 1.0})
    assert any(np.any(a[0] != b[0]) for a, b in zip(square.planes, expected.planes, strict=True))

    def by_hand(plate, options):
        """A loop that tells the compositor what OpenCV's frames do not say."""
        with Compositor(plate.glb, fps=RATE, pixel_aspect=1.5, **options) as lens:
            frames = [frame.to_ndarray(format="bgr24") for frame in plate.frames()]
            made = [as_bgr0(lens.process(frame)) for frame in frames]
        return Composited(made, expected.times)

    assert_conforms(by_hand, plate, expected)


@pytest.mark.needs_programs("ffmpeg")
def test_ratio_of_pixels_is_turned_with_the_picture(files, tmp_path):
    frames = [
        av.VideoFrame.from_ndarray(np.zeros((32, 64, 3), np.uint8), "rgb24") for _ in range(2)
    ]
    square = write_clip(
        tmp_path / "square.mp4", [one.reformat(format="yuv420p") for one in frames], rotation=90,
        codec="mpeg4",
    )  # fmt: skip
    tall = made("-i", square, "-c:v", "copy", "-aspect", "4:1", tmp_path / "tall.mp4")
    with VideoCapture(tall, files[1], **OPTIONS) as capture:
        assert capture.read()[1].shape == (64, 32, 3)
        assert capture._pixel_aspect() == pytest.approx(0.5, rel=1e-3)
        capture.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)
        assert capture._pixel_aspect() == pytest.approx(2.0, rel=1e-3)


def test_object_is_in_the_frames_and_moves(capture, files):
    plate = cv2.VideoCapture(files[0])
    changed = [np.any(plate.read()[1] != capture.read()[1], axis=2) for _ in range(12)]
    assert all(one.any() for one in changed)
    assert (changed[0] != changed[11]).any()


def assert_alike(one, other):
    """Equal but for the light, which is estimated on the first frame that is composited."""
    assert np.abs(one.astype(int) - other).max() <= 2


def test_frames_that_are_only_grabbed_are_not_composited(capture, files):
    expected = list(by_hand(files))
    assert all(capture.grab() for _ in range(5))
    assert_alike(capture.retrieve()[1], expected[4])
    assert capture.compositor.timings.frames == 1


def test_animation_follows_a_new_position(capture, files):
    expected = list(by_hand(files))
    assert capture.set(cv2.CAP_PROP_POS_FRAMES, 7)
    assert_alike(capture.read()[1], expected[7])
    assert capture.set(cv2.CAP_PROP_POS_FRAMES, 2)
    assert_alike(capture.read()[1], expected[2])
    assert np.abs(expected[7].astype(int) - expected[2]).max() > 30


def test_mattes_follow_a_new_position_and_frames_that_are_only_grabbed(files, tmp_path):
    for number in range(12):
        matte = np.zeros((shots.HEIGHT, shots.WIDTH), np.uint8)
        matte[:, : 8 * number] = 255
        assert cv2.imwrite(str(tmp_path / f"m_{number:02d}.png"), matte)
    with VideoCapture(*files, **OPTIONS, holdout=tmp_path / "m_%02d.png") as capture:
        expected = [capture.read()[1] for _ in range(12)]
        for number in (7, 2):
            assert capture.set(cv2.CAP_PROP_POS_FRAMES, number)
            assert_alike(capture.read()[1], expected[number])
        assert capture.grab() and capture.grab()
        assert_alike(capture.read()[1], expected[5])


def test_lens_of_a_saved_track_follows_a_new_position_and_frames_that_are_only_grabbed(
    files, tmp_path
):
    keys = tuple(Keyframe(at, 0, replace(FIT, intercept=-12.0 - at)) for at in range(0, 13, 3))
    track, path = FitTrack(keys, 2.0), tmp_path / "track.json"
    path.write_text(track.to_json())
    with VideoCapture(*files, preset="draft", fit=path) as capture:
        for number in (0, 1, 5, 6):
            if number == 5:
                capture.set(cv2.CAP_PROP_POS_FRAMES, number)
            assert capture.read()[0]
            assert capture.compositor.fit.intercept == track.at(number).intercept
        assert capture.grab() and capture.grab() and capture.read()[0]
        assert capture.compositor.fit.intercept == track.at(9).intercept


def test_result_is_written_into_a_fitting_array_only(capture):
    image = np.zeros((shots.HEIGHT, shots.WIDTH, 3), np.uint8)
    assert capture.read(image)[1] is image and image.any()
    other = np.zeros((4, 4, 3), np.uint8)
    assert capture.read(other)[1].shape == image.shape and not other.any()


def test_properties_and_state_are_opencvs(capture, files):
    plate = cv2.VideoCapture(files[0])
    for name in ("FRAME_WIDTH", "FRAME_HEIGHT", "FRAME_COUNT", "FPS", "FOURCC", "POS_FRAMES"):
        assert capture.get(getattr(cv2, f"CAP_PROP_{name}")) == plate.get(
            getattr(cv2, f"CAP_PROP_{name}")
        )
    assert capture.isOpened() and capture.getBackendName() == plate.getBackendName()
    assert not capture.getExceptionMode()
    capture.setExceptionMode(True)
    assert capture.getExceptionMode()


def test_file_that_is_not_there_is_not_open_and_reads_nothing(files, tmp_path):
    with VideoCapture(tmp_path / "none.mp4", files[1], **OPTIONS) as capture:
        assert not capture.isOpened()
        assert capture.read() == (False, None)
        assert capture.open(files[0])
        assert capture.read()[0]


def test_released_capture_is_closed_and_leaves_no_thread(files):
    before = threading.active_count()
    capture = VideoCapture(*files, **OPTIONS)
    assert capture.read()[0]
    capture.release()
    capture.release()
    assert not capture.isOpened() and capture.read() == (False, None)
    assert not [one for one in threading.enumerate() if one.name.startswith("nlens-compositor")]
    assert threading.active_count() <= before + 1  # the kernels' pool stays


def test_options_and_scene_are_checked_as_a_compositor_checks_them(files, tmp_path):
    with pytest.raises(UsageError, match="budget_ms=-1"):
        VideoCapture(*files, budget_ms=-1)
    with VideoCapture(files[0], tmp_path / "none.glb", fit=FIT) as capture:
        with pytest.raises(SceneError):
            capture.read()


def test_class_has_opencvs_methods():
    missing = {name for name in dir(cv2.VideoCapture) if not name.startswith("_")} - set(
        dir(nlens_video.VideoCapture)
    )
    assert missing == {"waitAny"}  # of several captures at once

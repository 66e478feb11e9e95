"""The contract of the adapters, on frames in plain memory."""

import numpy as np
import pytest
from support import shots
from support.conformance import (
    CASES,
    VIDEO,
    Composited,
    assert_conforms,
    assert_same_errors,
    planes_of,
)

from nlens_video.adapters import contract
from nlens_video.core.errors import InputError, NlensError, UsageError
from nlens_video.video.info import FrameTags

pytestmark = pytest.mark.needs_gl
NAMES = FrameTags.__struct_fields__


def as_frame(frame, **changes):
    given = {
        "pixel_format": frame.format.name, "width": frame.width, "height": frame.height,
        "planes": tuple(planes_of(frame)),
        "tags": FrameTags(**{name: getattr(frame, name) for name in NAMES}),
    }  # fmt: skip
    return contract.Frame(**{**given, **changes})


def composite(plate, options):
    options = dict(options)
    lens = contract.open(options.pop("glb", plate.glb), fps=25, **options)
    made, frames = [], plate.frames()
    try:
        for number, frame in enumerate(frames):
            time_s = float((frame.pts - frames[0].pts) * frame.time_base)
            asked = as_frame(frame, time_s=time_s, number=number)
            contract.process(lens, asked)
            made.append(list(asked.planes))
    finally:
        contract.close(lens)
    times = [(frame.pts - frames[0].pts) * frame.time_base for frame in frames]
    return Composited(made, times)


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES)
def test_frames_are_those_of_the_command_line(case, plates, expected):
    assert_conforms(composite, plates(case), expected(case))


@pytest.mark.slow
def test_errors_are_those_of_the_command_line(plates):
    assert_same_errors(composite, plates("bt709"), NlensError)


@pytest.fixture
def lens(plates):
    plate = plates("bt709")
    made = contract.open(plate.glb, preset="draft", fit=plate.fit, fps=25)
    yield made
    contract.close(made)


def assert_same_samples(one, other):
    for mine, theirs in zip(one, other, strict=True):
        np.testing.assert_array_equal(mine, theirs)


@pytest.mark.parametrize("name", ["nv12", "nv21", "yuyv422", "uyvy422", "yvyu422", "nv16", "nv24"])
def test_samples_that_share_planes_are_composited_where_they_lie(lens, plates, name):
    planar = {"nv12": "yuv420p", "nv21": "yuv420p", "nv24": "yuv444p"}.get(name, "yuv422p")
    first = plates("bt709").frames()[0]
    plain = first.reformat(format=planar)
    shared = plain.reformat(format=name)
    expected, asked = (as_frame(one, tags=VIDEO, time_s=0.0) for one in (plain, shared))
    contract.process(lens, expected)
    contract.process(lens, asked)
    made = type(shared)(shots.WIDTH, shots.HEIGHT, name)
    for plane, rows in zip(made.planes, asked.planes, strict=True):
        np.frombuffer(plane, np.uint8).reshape(plane.height, -1)[:, : rows.shape[1]] = rows
    assert_same_samples(planes_of(made.reformat(format=planar)), expected.planes)
    assert not np.array_equal(asked.planes[0], planes_of(shared)[0])


def test_padding_of_rows_is_left_as_it_is(lens, plates):
    frame = plates("bt709").frames()[0]
    wide = tuple(np.pad(rows, ((0, 2), (0, 32)), constant_values=7) for rows in planes_of(frame))
    tight, padded = as_frame(frame, time_s=0.0), as_frame(frame, planes=wide, time_s=0.0)
    contract.process(lens, tight)
    contract.process(lens, padded)
    for rows, other in zip(padded.planes, tight.planes, strict=True):
        height, width = other.shape
        np.testing.assert_array_equal(rows[:height, :width], other)
        assert (rows[height:] == 7).all() and (rows[:, width:] == 7).all()


def test_frames_in_another_order_are_the_same(plates):
    plate = plates("bt709")
    frames = plate.frames()

    def run(order):
        with contract.open(plate.glb, preset="realtime", track_focus="off", fit=plate.fit) as lens:
            made = {}
            for number in order:
                asked = as_frame(frames[number], time_s=number / 25, number=number)
                contract.process(lens, asked)
                made[number] = asked.planes
        return made

    straight, mixed = run([0, 1, 2, 3]), run([0, 3, 1, 2, 1])
    for number, planes in straight.items():
        assert_same_samples(planes, mixed[number])


def test_pixels_that_are_not_square_change_the_objects_form(plates):
    plate = plates("bt709")
    widths = []
    for aspect in (1.0, 2.0):
        with contract.open(plate.glb, preset="draft", effects="none", fit=plate.fit) as lens:
            asked = as_frame(plate.frames()[0], time_s=0.0, pixel_aspect=aspect)
            before = asked.planes[0].astype(int)
            contract.process(lens, asked)
        columns = np.nonzero((np.abs(asked.planes[0] - before) > 8).any(axis=0))[0]
        widths.append(np.ptp(columns))
    assert widths[1] < 0.7 * widths[0]


@pytest.mark.parametrize(
    ("changes", "error", "said"),
    [
        ({"pixel_format": "pal8"}, InputError, "pal8"),
        ({"pixel_format": "yuv420p16be"}, InputError, "yuv420p16be"),
        ({"planes": ()}, InputError, "plane 0 is too small or missing; expected 270 rows"),
        ({"pixel_format": "yuv420p16le"}, InputError, "at least 960 bytes"),
        ({"time_s": float("nan")}, UsageError, "is not a time"),
    ],
)
def test_frames_that_cannot_be_composited_in_are_refused(lens, plates, changes, error, said):
    asked = as_frame(plates("bt709").frames()[0], **changes)
    with pytest.raises(error, match=said):
        contract.process(lens, asked)


def test_frames_after_an_error_are_as_they_were(plates, tmp_path):
    broken = tmp_path / "broken.glb"
    broken.write_bytes(b"no")
    frame = plates("bt709").frames()[0]
    asked = as_frame(frame)
    with contract.open(broken, fit=plates("bt709").fit) as lens, pytest.raises(NlensError):
        contract.process(lens, asked)
    assert_same_samples(asked.planes, planes_of(frame))


def test_frames_of_another_size_need_another_open(lens, plates):
    frame = plates("bt709").frames()[0]
    contract.process(lens, as_frame(frame))
    with pytest.raises(UsageError, match="one compositor takes one size"):
        contract.process(lens, as_frame(frame.reformat(width=240, height=136)))
    contract.close(lens)
    with pytest.raises(UsageError, match="closed"):
        contract.process(lens, as_frame(frame))


def test_contract_has_a_version():
    assert contract.VERSION == 1

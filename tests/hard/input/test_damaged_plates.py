"""Plates that are damaged on the way: the good frames stay, at their times, and are reported."""

import itertools
import os
import random
import threading
from fractions import Fraction

import av
import numpy as np
import pytest
from av.bitstream import BitStreamFilterContext
from hypothesis import given, settings
from hypothesis import strategies as st
from support import shots
from support.clips import copy, noise_frame, read_times, write_clip, write_plates

from nlens_video.cli.main import main
from nlens_video.core.errors import InputError
from nlens_video.video import exr
from nlens_video.video.exr import write_layers
from nlens_video.video.input import source
from nlens_video.video.input.repair import SourceClock
from nlens_video.video.input.source import open_source

FRAMES = 60
EACH_SEVENTH = r"if(mod(n\,7)\,-1\,40)"  # packet, and of it about each fortieth byte


def flat(level, size=(64, 48)):
    frame = noise_frame(*size, "yuv420p")
    frame.planes[0].update(bytes([level]) * frame.planes[0].buffer_size)
    return frame


def clip_of(path, count=FRAMES, codec="mpeg4"):
    """Frames that grow brighter; of MPEG-4 and PNG each is a key frame."""
    frames = [flat(4 * number) for number in range(count)]
    if codec == "png":
        grey = (np.full((48, 64, 3), 4 * number, np.uint8) for number in range(count))
        frames = [av.VideoFrame.from_ndarray(picture, "rgb24") for picture in grey]
    options = {"g": "1"} if codec == "mpeg4" else {}
    base = Fraction(1, 25)
    return write_clip(path, frames, codec=codec, pts=range(count), time_base=base, options=options)


def filtered(given, made, words):
    """A copy whose video packets have passed one of FFmpeg's bitstream filters."""
    with av.open(str(given)) as read, av.open(str(made), "w") as written:
        stream = read.streams.video[0]
        out = written.add_stream_from_template(stream)
        change = BitStreamFilterContext(words, stream, out)
        for packet in read.demux(stream):
            for changed in change.filter(packet if packet.size else None):
                changed.stream = out
                written.mux(changed)
    return made


def read(path):
    """Time [s] and luma of each frame that comes, and the source, closed."""
    with open_source(str(path)) as plate:
        frames = [
            (float(frame.pts * frame.time_base), float(np.mean(planes(frame)))) for frame in plate
        ]
    return frames, plate


def planes(frame):
    return np.frombuffer(frame.picture.frame.planes[0], np.uint8)


@pytest.mark.parametrize("amount", [EACH_SEVENTH, "200"])
@pytest.mark.parametrize("codec", ["mpeg4", "libx264", "mpeg2video", "libvpx-vp9"])
def test_corrupted_packets_do_not_shift_the_times_of_others(tmp_path, codec, amount):
    given = clip_of(tmp_path / "in.mkv", codec=codec)
    noisy = filtered(given, tmp_path / "noisy.mkv", f"noise=amount={amount}")
    frames, plate = read(noisy)
    usual = {round(float(time_s), 3) for time_s in read_times(given)}
    assert len(frames) >= FRAMES // 2
    # a decoder may give a picture twice; the second follows at once, which is said
    times = [round(time_s, 3) for time_s, _ in frames]
    follows = [later for earlier, later in itertools.pairwise(times) if later - earlier < 0.0015]
    assert set(times) <= usual | set(follows)
    assert plate.warnings() or not follows


def damaged_clip(folder, count, *lost):
    """Pictures each for itself, some of them destroyed."""
    data = bytearray(clip_of(folder / "in.mov", count, codec="png").read_bytes())
    starts = [at for at in range(len(data)) if data[at : at + 4] == b"\x89PNG"]
    for number in lost:
        data[starts[number] : starts[number] + 40] = bytes(40)
    (folder / "bad.mov").write_bytes(data)
    return str(folder / "bad.mov")


@pytest.mark.parametrize("lost", [(4, 5, 11), (18,), (19,), (15, 17, 18), (7, 19)], ids=str)
def test_lost_pictures_leave_a_gap_in_times_and_numbers(tmp_path, lost):
    with open_source(damaged_clip(tmp_path, 20, *lost)) as plate:
        found = [(frame.index, frame.number, frame.time_s) for frame in plate]
    kept = [number for number in range(20) if number not in lost]
    assert found == [(at, number, pytest.approx(number / 25)) for at, number in enumerate(kept)]
    assert plate.damaged == len(lost)


def test_good_pictures_of_a_short_clip_that_begins_damaged_are_found(tmp_path):
    with open_source(damaged_clip(tmp_path, 2, 0)) as plate:
        assert [frame.pts * frame.time_base for frame in plate] == [Fraction(1, 25)]


def test_damaged_pictures_of_a_sequence_do_not_shift_the_numbers_of_others(tmp_path):
    pattern = write_plates(tmp_path, *range(1001, 1009))
    data = bytearray((tmp_path / "p_1004.png").read_bytes())
    data[40:60] = bytes(20)
    (tmp_path / "p_1004.png").write_bytes(data)
    (tmp_path / "out").mkdir()
    copy(pattern, tmp_path / "out" / "o_%04d.png")
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == [f"o_{number}.png" for number in range(1001, 1009) if number != 1004]


def test_damaged_openexr_files_are_skipped_and_leave_a_gap(tmp_path, monkeypatch):
    for number in range(12):
        values = np.full((4, 6), number, np.float32)
        write_layers(tmp_path / f"p_{number:02d}.exr", dict.fromkeys("RGB", values))
    for number in (3, 4):
        (tmp_path / f"p_{number:02d}.exr").write_bytes(b"no OpenEXR")
    with open_source(str(tmp_path / "p_%02d.exr")) as plate:
        frames = [(frame.index, frame.number, frame.pts) for frame in plate]
    kept = [0, 1, 2, *range(5, 12)]
    assert frames == [(at, number, number) for at, number in enumerate(kept)]
    assert (plate.damaged, plate.warnings()) == (2, ())
    monkeypatch.setattr(exr, "MOST_UNREADABLE", 2)
    with open_source(str(tmp_path / "p_%02d.exr")) as plate:
        assert sum(1 for _ in plate) == 3
    assert plate.warnings() == ("given up after 2 unreadable files in a row",)


def test_plate_that_stays_undecodable_stops_at_the_documented_limit(tmp_path, monkeypatch):
    monkeypatch.setattr(source, "MOST_UNDECODABLE", 10)
    clip = clip_of(tmp_path / "in.mov", 40, codec="png")
    data = bytearray(clip.read_bytes())
    starts = [at for at in range(len(data)) if data[at : at + 4] == b"\x89PNG"]
    for lost in starts[8:30]:
        data[lost : lost + 40] = bytes(40)
    (tmp_path / "bad.mov").write_bytes(data)
    frames, plate = read(tmp_path / "bad.mov")
    assert (len(frames), plate.damaged) == (8, 10)
    assert plate.warnings() == ("given up after 10 undecodable packets in a row",)


@pytest.mark.parametrize("piped", [False, True], ids=["file", "pipe"])
def test_raw_video_that_ends_amid_a_frame_has_one_damaged_packet(tmp_path, piped):
    whole = b"".join(bytes(plane) for n in range(3) for plane in flat(40 * n, (64, 48)).planes)
    cut = tmp_path / "cut.yuv"
    if piped:
        os.mkfifo(cut)
    data = whole[: -len(whole) // 6]  # half of the last frame
    writer = threading.Thread(target=cut.write_bytes, args=(data,), daemon=True)
    writer.start()
    if not piped:
        writer.join()
    with open_source(str(cut), input_format="yuv420p", input_size="64x48") as plate:
        assert len(list(plate)) == 2
        assert plate.damaged == 1
    writer.join(20)


def test_frames_of_another_size_or_format_are_converted_to_the_first(tmp_path):
    first = [noise_frame(64, 48, "yuv420p", seed) for seed in range(3)]
    other = [noise_frame(96, 80, "yuv420p", seed) for seed in range(3)]
    deep = [noise_frame(64, 48, "yuv444p", seed) for seed in range(3)]
    pieces = [write_clip(tmp_path / f"{at}.ts", frames, codec="libx264", pts=range(3),
                         time_base=Fraction(1, 25))
              for at, frames in enumerate((first, other, deep))]  # fmt: skip
    joined = tmp_path / "joined.ts"
    joined.write_bytes(b"".join(piece.read_bytes() for piece in pieces))
    with open_source(str(joined)) as plate:
        found = [(frame.picture.width, frame.picture.height, frame.picture.frame.format.name,
                  frame.pts) for frame in plate]  # fmt: skip
    assert len(found) >= 7
    assert {one[:3] for one in found} == {(64, 48, "yuv420p")}
    times = [one[3] for one in found]
    assert times == sorted(set(times))
    (said, *_) = plate.warnings()
    assert "another form" in said and "64x48 yuv420p" in said


@pytest.mark.needs_gl
def test_run_over_a_damaged_plate_writes_the_intact_frames_and_reports_it(tmp_path, capsys):
    shots.write_video(tmp_path / "whole.mp4", 24)
    noisy = filtered(tmp_path / "whole.mp4", tmp_path / "in.mkv", f"noise=amount={EACH_SEVENTH}")
    shots.cube_glb(tmp_path / "anim.glb")
    shots.fit_json(tmp_path / "fit.json")
    words = [str(noisy), str(tmp_path / "anim.glb"), str(tmp_path / "out.mkv"), "--preset",
             "realtime", "--fit", str(tmp_path / "fit.json")]  # fmt: skip
    assert main(words) == 0
    assert "damaged packets or frames in the source" in capsys.readouterr().err
    assert len(read_times(tmp_path / "out.mkv")) >= 12


def clock(length_s=None):
    frames = noise_frame(16, 16, "gray")
    from nlens_video.video.info import SourceInfo
    from nlens_video.video.pixels.samples import frame_tags

    return SourceClock(
        SourceInfo(
            name="x", kind="video", width=16, height=16, time_base=Fraction(1, 1000),
            average_rate=Fraction(25), frame_count=None, duration_s=length_s, codec="x",
            pixel_format="gray", tags=frame_tags(frames),
        )
    )  # fmt: skip


@pytest.mark.parametrize(
    ("stamps", "times"),
    [
        ([0, None, None, 120], [0, 40, 80, 120]),
        ([0, 40, 40, 40, 160], [0, 40, 41, 42, 160]),
        ([0, 40, 1 << 60, 120, 160], [0, 40, 80, 120, 160]),
        ([0, 40, -(1 << 60), 120, 160], [0, 40, 80, 120, 160]),
        ([0, 40, 80, 0 - 5000, 40 - 5000], [0, 40, 80, 120, 160]),
        ([None, None, 80], [0, 40, 80]),
        ([0, 40, 60_000, 60_040], [0, 40, 60_000, 60_040]),
        ([1400, 1440, 1480, 200, 1520, 1560, 1600], [1400, 1440, 1480, 1520, 1521, 1560, 1600]),
        ([1400, 1440, 0, 1480, 40, 1520, 1560], [1400, 1440, 1480, 1481, 1521, 1522, 1560]),
    ],
    ids=[
        "missing",
        "the same",
        "far ahead",
        "far back",
        "anew",
        "missing first",
        "a pause",
        "an earlier one again",
        "two earlier ones again",
    ],
)
def test_invalid_timestamps_are_repaired_in_place(stamps, times):
    assert list(map(clock().tick, stamps)) == times


def test_timestamp_far_beyond_the_stated_duration_is_ignored():
    ticking = clock(length_s=2.0)
    assert [ticking.tick(pts) for pts in (0, 40, 600_000, 120)] == [0, 40, 80, 120]
    assert ticking.repaired == 1


stamps = st.lists(st.one_of(st.none(), st.integers(-(2**63), 2**63 - 1), st.integers(0, 4000)))


@settings(max_examples=300, deadline=None)
@given(given_stamps=stamps, length_s=st.sampled_from([None, 0.0, 3.0]))
def test_output_times_always_increase(given_stamps, length_s):
    ticking = clock(length_s)
    times = [ticking.tick(pts) for pts in given_stamps]
    assert all(later > earlier for earlier, later in zip(times, times[1:], strict=False))


CUT = {
    "mp4": ("libx264", ".mp4"), "mkv": ("ffv1", ".mkv"), "mov": ("prores_ks", ".mov"),
    "webm": ("libvpx-vp9", ".webm"), "nut": ("rawvideo", ".nut"),
    "y4m": ("wrapped_avframe", ".y4m"),
}  # fmt: skip


@pytest.mark.parametrize("name", CUT)
def test_truncated_plate_gives_its_first_frames_or_a_one_line_error(tmp_path, name):
    codec, suffix = CUT[name]
    kind = "yuv422p10le" if codec == "prores_ks" else "yuv420p"
    frames = [noise_frame(48, 32, kind, seed) for seed in range(6)]
    base = Fraction(1, 25)
    clip = write_clip(tmp_path / f"in{suffix}", frames, codec=codec, pts=range(6), time_base=base)
    data = clip.read_bytes()
    rng = random.Random(name)
    counts = []
    for size in sorted([0, 1, 4, 8, 16, *rng.sample(range(len(data)), 30)]):
        cut = tmp_path / f"cut{suffix}"
        cut.write_bytes(data[:size])
        try:
            counts.append(len(read(cut)[0]))
        except InputError as error:
            assert "\n" not in str(error)
            counts.append(0)
    assert counts == sorted(counts)
    assert max(counts) <= 6

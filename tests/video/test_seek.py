"""Frames found by seeking are those of a reading from the beginning, bit for bit, or none are."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support import shots
from support.clips import planes

from nlens_video.cli.main import main
from nlens_video.run.frame_range import FrameRange
from nlens_video.video.info import SourceFrame
from nlens_video.video.input.seek import SeekableSource, open_seekable
from nlens_video.video.input.source import open_source

FRAMES = 180
X264 = {"preset": "ultrafast", "crf": "20", "g": "24"}
KINDS = {
    "h264 with B frames, mp4": (".mp4", "libx264", {**X264, "bf": "3"}, True),
    "h264 with open groups, mkv": (".mkv", "libx264", {
        **X264, "bf": "3", "x264-params": "open-gop=1:keyint=24:log-level=none"}, None),
    "h264 that is renewed part by part, ts": (".ts", "libx264", {
        **X264, "x264-params": "intra-refresh=1:keyint=24:log-level=none"}, False),
    "h264, ts": (".ts", "libx264", X264, True),
    "hevc with open groups, mp4": (".mp4", "libx265", {
        "preset": "ultrafast", "x265-params": "keyint=24:open-gop=1:bframes=3:log-level=none"},
        None),
    "hevc with closed groups, mkv": (".mkv", "libx265", {
        "preset": "ultrafast", "x265-params": "keyint=24:open-gop=0:bframes=3:log-level=none"},
        True),
    "prores, mov": (".mov", "prores_ks", {"profile": "proxy"}, True),
    "vp9, webm": (".webm", "libvpx-vp9", {
        "deadline": "realtime", "cpu-used": "8", "g": "24", "b": "500k"}, True),
    "vp8, webm": (".webm", "libvpx", {"deadline": "realtime", "cpu-used": "8", "g": "24"}, False),
    "mpeg2, ts": (".ts", "mpeg2video", {"g": "12", "bf": "2", "b": "2M"}, None),
    "ffv1, mkv": (".mkv", "ffv1", {"g": "10"}, True),
    "mjpeg, avi": (".avi", "mjpeg", {"q": "4"}, None),
}  # fmt: skip
"""Ending, encoder, its options, and whether seeking succeeds; None where either will do."""


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    made = {}

    def make(kind):
        if kind not in made:
            suffix, codec, options, _ = KINDS[kind]
            path = tmp_path_factory.mktemp("sought") / f"in{suffix}"
            write_moving(path, codec, options)
            made[kind] = path, read(open_source(str(path)), 0, None)
        return made[kind]

    return make


def write_moving(path, codec, options):
    """Texture that drifts, so that every frame leans on its neighbours; a tone beside it."""
    rng = np.random.default_rng(5)
    wide = np.repeat(np.repeat(rng.integers(30, 220, (12, 60), np.uint8), 8, 0), 8, 1)
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, 25, dict(options))
        stream.width, stream.height = 128, 96
        pixels = {"prores_ks": "yuv422p10le", "mjpeg": "yuvj420p"}.get(codec, "yuv420p")
        stream.pix_fmt = pixels
        for number in range(FRAMES):
            grey = np.ascontiguousarray(wide[:, number : number + 128])
            frame = av.VideoFrame.from_ndarray(grey, "gray").reformat(format=pixels)
            frame.pts, frame.time_base = number, Fraction(1, 25)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))


def read(source, first, end, *, skip=False):
    """Index, time and samples of each frame of a range; and whether frames were left out."""
    with source:
        trim = FrameRange(source, (first, end))
        trim.peek(3)  # as a run does
        passed = []
        trim.on_skipped = lambda frame: passed.append(frame.index)
        if skip:
            trim.skip_to = source.skip_to
        found = []
        for item in trim.items():
            if isinstance(item, SourceFrame):
                samples = [plane.tobytes() for plane in planes(item.picture.frame)]
                found.append((item.index, item.pts, item.time_s, item.duration, samples))
        return found, first - len(passed)


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
@settings(max_examples=6, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(first=st.integers(1, FRAMES - 1), length=st.integers(1, 12))
def test_range_read_by_seeking_equals_that_part_of_the_whole(clip, kind, first, length):
    path, (whole, _) = clip(kind)
    found, left_out = read(open_seekable(str(path)), first, first + length, skip=True)
    expected = whole[first : first + length]
    assert [one[0] for one in found] == [one[0] for one in expected]
    for (_, pts, time, duration, samples), (_, at, moment, lasts, also) in zip(
        found, expected, strict=True
    ):
        assert (pts, time, duration) == (at - expected[0][1], moment, lasts)
        assert samples == also
    if first < 48:
        assert left_out == 0


@pytest.mark.parametrize("kind", [kind for kind in KINDS if KINDS[kind][3] is not None])
def test_seeking_skips_frames_only_where_the_index_is_reliable(clip, kind):
    path, _ = clip(kind)
    _, left_out = read(open_seekable(str(path)), 150, 152, skip=True)
    assert (left_out > 80) is KINDS[kind][3]


def packets(source, *, skip):
    """What travels along with frames 120 to 139."""
    with source:
        trim = FrameRange(source, (120, 140))
        if skip:
            trim.skip_to = source.skip_to
        return [
            (item.pts, item.dts, bytes(item))
            for item in trim.items()
            if not isinstance(item, SourceFrame)
        ]


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".mp4", ".mkv", ".mov"])
def test_audio_of_a_range_read_by_seeking_equals_that_of_the_whole(suffix, tmp_path):
    path = shots.write_video(tmp_path / f"in{suffix}", 160, group=12)
    jumping = open_seekable(str(path))
    before = jumping._connection
    sought = packets(jumping, skip=True)
    assert jumping._connection is not before
    assert sought == packets(open_source(str(path)), skip=False) != []


def test_packets_without_times_disable_seeking(clip, tmp_path):
    path, (whole, _) = clip("h264, ts")
    bare = tmp_path / "bare.h264"
    with av.open(str(path)) as given, av.open(str(bare), "w") as made:
        stream = made.add_stream_from_template(given.streams.video[0])
        for packet in given.demux(given.streams.video[0]):
            if packet.size:
                packet.stream = stream
                made.mux(packet)
    found, left_out = read(open_seekable(str(bare)), 150, 152, skip=True)
    assert left_out == 0
    assert [one[4] for one in found] == [one[4] for one in whole[150:152]]


def test_packets_flagged_as_damaged_disable_seeking(clip, tmp_path):
    """A part of a transport stream is missing, which its counters tell."""
    path, _ = clip("h264, ts")
    data = path.read_bytes()
    middle = len(data) // 3 // 188 * 188
    torn = tmp_path / "torn.ts"
    torn.write_bytes(data[:middle] + data[middle + 5 * 188 :])
    plain, _ = read(open_source(str(torn)), 140, 144)
    found, left_out = read(open_seekable(str(torn)), 140, 144, skip=True)
    assert left_out == 0 and found == plain


@pytest.mark.slow
@pytest.mark.needs_gl
@pytest.mark.parametrize(
    ("effects", "light_given", "jumps"),
    [("defocus", True, 1), ("defocus", False, 0), ("defocus,exposure", True, 0)],
)
def test_range_is_read_by_seeking_unless_a_stage_needs_earlier_frames(
    effects, light_given, jumps, tmp_path, monkeypatch
):
    """The light is estimated from the first frame, unless a map gives it and its brightness."""
    shots.write_video(tmp_path / "in.mp4", 130, group=12)
    slide = {"start": (-0.3, 0.0, -1.6), "end": (0.3, 0.0, -1.4), "seconds": 5.2}
    shots.cube_glb(tmp_path / "anim.glb", **slide)
    shots.fit_json(tmp_path / "fit.json")
    jumped, go_over = [], SeekableSource._switch_to
    monkeypatch.setattr(
        SeekableSource, "_switch_to", lambda self, later: (jumped.append(1), go_over(self, later))
    )
    words = [str(tmp_path / "in.mp4"), str(tmp_path / "anim.glb")]
    asked = ["--fit", str(tmp_path / "fit.json"), "--codec", "ffv1", "--effects", effects, "-q"]
    asked += ["--preset", "realtime"]
    if light_given:
        cv2.imwrite(str(tmp_path / "map.hdr"), np.full((8, 16, 3), 0.5, np.float32))
        asked += ["--env-map", str(tmp_path / "map.hdr"), "--env-exposure", "0"]
    assert main([*words, str(tmp_path / "all.mkv"), *asked]) == 0
    assert main([*words, str(tmp_path / "part.mkv"), *asked, "--range", "120:123"]) == 0
    assert len(jumped) == jumps
    whole = shots.read_planes(tmp_path / "all.mkv")[120:123]
    for (_, one), (_, other) in zip(shots.read_planes(tmp_path / "part.mkv"), whole, strict=True):
        for plane, also in zip(one, other, strict=True):
            np.testing.assert_array_equal(plane, also)


@pytest.mark.parametrize("kind", ["h264 with B frames, mp4", "vp9, webm", "ffv1, mkv"])
def test_frames_of_a_sparse_reading_are_those_of_the_whole_at_their_times(clip, kind):
    path, (whole, _) = clip(kind)
    with open_source(str(path), sparse=True) as source:
        found = [
            (one.time_s, [plane.tobytes() for plane in planes(one.picture.frame)]) for one in source
        ]
    samples = {time: samples for _, _, time, _, samples in whole}
    assert len(found) < FRAMES or "B frames" not in kind
    assert all(samples[time] == seen for time, seen in found)
    assert np.diff([time for time, _ in found]).max() < 0.2

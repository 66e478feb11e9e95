"""Pictures that damage has taken are counted, so that numbered results go to the right frames."""

from fractions import Fraction

from support.clips import noise_frame, write_clip

from nlens_video.video.input.source import open_source

TICK = Fraction(1, 25)
PACKET = 188
"""Bytes of a packet of MPEG-TS [1]."""


def write_broadcast(path, steps=range(60)):
    """Noise in MPEG-TS, at multiples of a frame."""
    frames = [noise_frame(64, 48, "yuv420p", index) for index in range(len(steps))]
    return write_clip(path, frames, codec="mpeg2video", pts=list(steps), time_base=TICK,
                      options={"bf": "2"})  # fmt: skip


def damaged(path, share=0.4, packets=60):
    """The file with zeros in place of some of its packets."""
    data = bytearray(path.read_bytes())
    first = int(len(data) * share) // PACKET * PACKET
    data[first : first + packets * PACKET] = bytes(packets * PACKET)
    path.write_bytes(data)
    return path


def read(path):
    """Number and time of each frame, as multiples of a frame, and the source when it has ended."""
    with open_source(str(path)) as source:
        frames = [(frame.number, round(frame.time_s / TICK)) for frame in source]
    return frames, source


def test_pictures_that_are_missing_in_mpeg_ts_are_counted(tmp_path):
    frames, source = read(damaged(write_broadcast(tmp_path / "in.ts")))
    assert source.damaged > 0
    assert len(frames) < 60
    shown = {step: number for number, step in reversed(frames)}  # one comes out of turn
    assert all(number == step for step, number in shown.items())
    assert frames[-1] == (59, 59)


def test_gaps_of_a_varying_rate_far_from_the_damage_are_no_lost_pictures(tmp_path):
    steps = [*range(30), *range(30, 180, 5), *range(180, 240), *range(260, 290)]
    frames, _ = read(damaged(write_broadcast(tmp_path / "in.ts", steps), share=0.1, packets=40))
    assert frames[-1][1] == 289
    assert frames[-1][0] == len(steps) - 1


def test_joined_recordings_are_not_damaged(tmp_path):
    part = write_broadcast(tmp_path / "part.ts")
    whole = tmp_path / "joined.ts"
    whole.write_bytes(part.read_bytes() * 2)
    frames, source = read(whole)
    assert source.damaged == 0
    assert [number for number, _ in frames] == list(range(120))

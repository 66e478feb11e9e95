"""MPEG-2 of film shown at 29.97 frames a second by repeated fields: the plate's times stay."""

import re
from fractions import Fraction

import av
import pytest
from support.clips import copy, noise_frame, read_times, write_clip

SHOWN = Fraction(30000, 1001)
FIELDS = (3, 2)  # for which the pictures of a film are shown, in turn


def with_repeated_fields(stream):
    """An MPEG-2 stream of which every other picture is shown for three fields."""
    data = bytearray(stream)
    for start in re.finditer(rb"\x00\x00\x01\xb5[\x10-\x1f]", data):
        data[start.start() + 5] &= ~0x08  # the sequence is not progressive
    first = count = picture = 0
    for start in re.finditer(rb"\x00\x00\x01(?:\x00|\xb8|\xb5[\x80-\x8f])", data):
        at = start.start() + 3
        if data[at] == 0xB8:  # group of pictures
            first = count
        elif data[at] == 0x00:  # header of a picture, with its number in the order of display
            picture = first + ((data[at + 1] << 2) | (data[at + 2] >> 6))
            count += 1
        else:  # extension of the header: top field first, repeat first field, progressive
            top_first = picture % 4 in (0, 3)
            repeated = FIELDS[picture % 2] == 3
            data[at + 4] = (data[at + 4] & ~0x82) | (top_first << 7) | (repeated << 1)
            data[at + 5] |= 0x80
    return bytes(data)


@pytest.fixture
def plate(tmp_path):
    frames = [noise_frame(64, 48, "yuv420p", seed) for seed in range(24)]
    film = write_clip(
        tmp_path / "film.m2v", frames, codec="mpeg2video", rate=SHOWN, time_base=1 / SHOWN,
        pts=range(24), options={"bf": "2"}, format_="mpeg2video",
    )  # fmt: skip
    film.write_bytes(with_repeated_fields(film.read_bytes()))
    with av.open(str(film)) as given, av.open(str(tmp_path / "in.ts"), "w") as made:
        video = given.streams.video[0]
        stream = made.add_stream_from_template(video)
        for packet in given.demux(video):
            if packet.size:
                packet.stream = stream
                made.mux(packet)
    return tmp_path / "in.ts"


@pytest.mark.parametrize("ending", ["ts", "mpg", "mp4", "mov", "mkv"])
def test_times_of_pictures_with_repeated_fields_are_kept(plate, ending):
    out = plate.with_name(f"out.{ending}")
    copy(plate, out, codec="mpeg2video")
    times, found = read_times(plate), read_times(out)
    assert {round(1000 * (b - a)) for a, b in zip(times, times[1:], strict=False)} == {33, 50}
    assert len(found) == len(times)
    errors = [(b - found[0]) - (a - times[0]) for a, b in zip(times, found, strict=True)]
    assert max(map(abs, errors)) <= Fraction(1, 1000)


def test_avi_which_counts_frames_has_them_on_its_grid(plate):
    out = plate.with_name("out.avi")
    copy(plate, out, codec="mpeg2video")
    times = read_times(out)
    assert len(times) == 24
    assert all((time * SHOWN).denominator == 1 for time in times)


@pytest.mark.parametrize("ending", ["ts", "mpg", "mp4", "mov", "mkv"])
def test_pictures_of_nearly_one_time_stay_apart_in_containers_of_coarser_ticks(tmp_path, ending):
    pts = [3600 * index for index in range(12)]
    pts[6] = pts[5] + 1
    frames = [noise_frame(64, 48, "yuv420p", seed) for seed in range(12)]
    plate = write_clip(
        tmp_path / "in.ts", frames, codec="libx264", pts=pts, time_base=Fraction(1, 90000)
    )  # fmt: skip
    out = tmp_path / f"out.{ending}"
    copy(plate, out, codec="mpeg2video")
    times = read_times(out)
    assert len(times) == 12
    assert all(b - a > Fraction(1, 100) for a, b in zip(times, times[1:], strict=False))

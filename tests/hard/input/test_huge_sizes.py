"""Files of a few kilobytes that declare pictures of thousands of megapixels, or hold them."""

import json
import struct
import subprocess
import sys
import zlib

import av
import cv2
import numpy as np
import OpenEXR
import pytest
from support import shots
from support.clips import write_clip

from nlens_video.core.errors import InputError
from nlens_video.core.layers import MOST_PIXELS
from nlens_video.scene.environment import load_environment
from nlens_video.video.input.source import open_source

FAR_BEYOND, BEYOND = 65535, 16000  # a side: FFmpeg itself stops before the one, we the other
assert BEYOND**2 > MOST_PIXELS


def chunk(kind, data):
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(side, rows):
    """A black picture, of which some rows are there."""
    packer = zlib.compressobj()
    row = bytes(3 * side + 1)
    packed = b"".join([*(packer.compress(row) for _ in range(rows)), packer.flush()])
    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    parts = chunk(b"IHDR", head), chunk(b"IDAT", packed), chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


def jpg(side):
    data = cv2.imencode(".jpg", np.zeros((48, 64, 3), np.uint8))[1].tobytes()
    at = data.index(b"\xff\xc0") + 5
    return data[:at] + struct.pack(">HH", side, side) + data[at + 4 :]


def matroska(path, side):
    """FFV1, whose container alone says the size."""
    shots.write_video(path, 2, codec="ffv1", audio=False)
    data = path.read_bytes()
    for tag, value in ((b"\xb0\x82", shots.WIDTH), (b"\xba\x82", shots.HEIGHT)):
        data = data.replace(tag + struct.pack(">H", value), tag + struct.pack(">H", side))
    path.write_bytes(data)


def exr(path, side, *, whole=False):
    size = side if whole else 8
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(head, {"RGB": np.zeros((size, size, 3), np.float16)}) as file:
        file.write(str(path))
    box, last = struct.pack("<4i", 0, 0, size - 1, size - 1), side - 1
    path.write_bytes(path.read_bytes().replace(box, struct.pack("<4i", 0, 0, last, last)))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("huge")
    for side, name in ((FAR_BEYOND, "far"), (BEYOND, "beyond")):
        (folder / f"{name}.png").write_bytes(png(side, 400))
        (folder / f"{name}.jpg").write_bytes(jpg(side))
        (folder / f"{name}.ppm").write_bytes(f"P6 {side} {side} 255\n".encode() + bytes(1000))
        head = f"YUV4MPEG2 W{side} H{side} F25:1 Ip A1:1 C420jpeg\nFRAME\n"
        (folder / f"{name}.y4m").write_bytes(head.encode() + bytes(1000))
        head = struct.pack("<IiiHHIIiiII", 40, side, side, 1, 24, 0, 0, 0, 0, 0, 0)
        (folder / f"{name}.bmp").write_bytes(
            b"BM" + struct.pack("<IHHI", 1000, 0, 0, 54) + head + bytes(1000)
        )
        matroska(folder / f"{name}.mkv", side)
        exr(folder / f"{name}.exr", side)
    (folder / "whole.png").write_bytes(png(BEYOND, BEYOND))  # 768 MB in 0.7
    return folder


MEASURE = """
import json, resource, sys
from nlens_video.core.errors import InputError
from nlens_video.video.input.source import open_source

def most_mb():
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss >> 10

found, before = {}, most_mb()
for name in sys.argv[1:]:
    try:
        open_source(name)
    except InputError as error:
        found[name] = str(error)
print(json.dumps([found, most_mb() - before]))
"""


def test_huge_declared_size_is_refused_before_allocating_memory(files):
    names = [str(path) for path in sorted(files.iterdir())]
    done = subprocess.run(
        [sys.executable, "-c", MEASURE, *names], capture_output=True, text=True, check=True,
        timeout=120,
    )  # fmt: skip
    said, more_mb = json.loads(done.stdout)
    assert sorted(said) == names
    for line in said.values():
        assert "\n" not in line and "200 megapixels" in line
    assert more_mb < 64


def test_huge_size_in_the_error_is_the_containers(files):
    for name in ("beyond.y4m", "beyond.exr", "far.exr"):
        with pytest.raises(InputError, match="x.* pixels, at most 200 megapixels are read"):
            open_source(str(files / name))


def test_picture_that_becomes_huge_midway_is_skipped_and_counted(tmp_path):
    picture = np.full((48, 64, 3), 90, np.uint8)
    frames = [av.VideoFrame.from_ndarray(picture, "rgb24") for _ in range(5)]
    clip = write_clip(tmp_path / "in.mov", frames, codec="png")
    *before, third, fourth, fifth = clip.read_bytes().split(b"IHDR")
    grown = struct.pack(">II", BEYOND, BEYOND) + third[8:13]
    third = grown + struct.pack(">I", zlib.crc32(b"IHDR" + grown)) + third[17:]
    (tmp_path / "grown.mov").write_bytes(b"IHDR".join([*before, third, fourth, fifth]))
    with open_source(str(tmp_path / "grown.mov")) as source:
        assert [frame.number for frame in source] == [0, 1, 3, 4]
        assert source.damaged == 1


def test_radiance_map_of_huge_size_is_refused(tmp_path):
    path = tmp_path / "sky.hdr"
    path.write_bytes(b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 20000 +X 40000\n" + bytes(1000))
    with pytest.raises(InputError, match="40000x20000 pixels, at most 200 megapixels"):
        load_environment(path, 0.0, 0.0)

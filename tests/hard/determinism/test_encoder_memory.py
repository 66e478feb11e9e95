"""An encoder's output does not depend on uninitialised memory."""

import hashlib
import os
import subprocess
import sys

import av
import numpy as np
import pytest
from support.clips import write_clip

ENCODE = """
import sys
from nlens_video.video.output.sink import open_sink
from nlens_video.video.input.source import open_source

with open_source(sys.argv[1]) as source, open_sink(
    sys.argv[2], source.info, codec=sys.argv[3]
) as sink:
    for frame in source:
        sink.write(frame)
    sink.commit()
"""


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """Smooth noise that moves, with grain; 30 macroblocks wide."""
    rng = np.random.default_rng(0)
    coarse = rng.integers(0, 256, (48, 80)).astype(np.float32)
    wide = np.kron(coarse, np.ones((8, 8), np.float32))
    frames = []
    for number in range(60):
        part = wide[number // 2 :, 2 * number :][:270, :480] + rng.normal(0, 2, (270, 480))
        grey = np.clip(part, 0, 255).astype(np.uint8)
        rgb = np.repeat(grey[..., None], 3, axis=2)
        frames.append(av.VideoFrame.from_ndarray(rgb, "rgb24").reformat(format="yuv420p"))
    return write_clip(tmp_path_factory.mktemp("clip") / "in.mkv", frames, codec="ffv1")


def encoded(clip, out, codec, filled):
    """A hash of the packets of a process whose new memory is filled with a value."""
    fill = {"MALLOC_PERTURB_": str(filled), "MALLOC_MMAP_MAX_": "0"}  # glibc's; 0: not filled
    subprocess.run(
        [sys.executable, "-c", ENCODE, str(clip), str(out), codec], check=True, timeout=100,
        env={**os.environ, **fill},
    )  # fmt: skip
    digest = hashlib.sha256()
    with av.open(str(out)) as container:
        for packet in container.demux(video=0):
            digest.update(bytes(packet))
    return digest.hexdigest()


@pytest.mark.parametrize("codec", ["libx264", "libx265", "libvpx-vp9"])
def test_encoders_give_the_same_bytes_whatever_memory_held_before(clip, tmp_path, codec):
    found = {encoded(clip, tmp_path / "out.mkv", codec, filled) for filled in (0, 1, 2, 5)}
    assert len(found) == 1

"""Small sound files of every kind, made anew each time."""

from __future__ import annotations

import json
import struct
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np
from support.clips import noise_frame, write_clip
from support.glb_builder import GlbBuilder
from support.rich_glb import rich

from nlens_video.core.layers import Box
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.pipeline_file import shipped_pipelines
from nlens_video.run.frame_range import ChunkRange
from nlens_video.stages.r_lens_track import FitTrack, Keyframe
from nlens_video.video.chunk_file import ChunkWriter
from nlens_video.video.chunk_queue import ChunkFeed, ChunkMark
from nlens_video.video.exr import write_layers
from nlens_video.video.input.source import open_source

Make = Callable[[Path], list[Path]]
WIDTH, HEIGHT = 24, 16


def scenes(folder: Path) -> list[Path]:
    """All that the reader knows, in one file; and a plain one."""
    plain = GlbBuilder()
    plain.node(mesh=plain.mesh())
    plain.node(camera=plain.camera())
    return [rich().write(folder / "rich.glb"), plain.write(folder / "plain.glb")]


def parts_of_glb(data: bytes) -> tuple[object, bytes]:
    """JSON and binary chunk."""
    (length,) = struct.unpack_from("<I", data, 12)
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def glb_of(document: object, binary: bytes) -> bytes:
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
    chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def loose_scenes(folder: Path) -> list[Path]:
    """JSON, a buffer and a picture as files of their own."""
    builder = rich()
    (folder / "scene.bin").write_bytes(builder.binary)
    cv2.imwrite(str(folder / "paint.png"), np.full((2, 2, 3), 90, np.uint8))
    document = {**builder.document, "images": [{"uri": "paint.png"}]}
    document["buffers"] = [{"byteLength": len(builder.binary), "uri": "scene.bin"}]
    path = folder / "scene.gltf"
    path.write_text(json.dumps(document))
    return [path]


def fits(folder: Path) -> list[Path]:
    """One lens, and one that changes over two shots."""
    fit = LensFit(slope=24.0, intercept=-12.0, slope_stderr=0.3, width=480, height=270, n=900)
    keys = tuple(Keyframe(at, at // 20, fit) for at in (0, 9, 18, 24, 33))
    track = FitTrack(keys, 12.0, (20,))
    (folder / "fit.json").write_text(fit.to_json())
    (folder / "track.json").write_text(track.to_json())
    return [folder / "fit.json", folder / "track.json"]


def pipelines(folder: Path) -> list[Path]:
    """The shipped ones."""
    for name, path in shipped_pipelines().items():
        (folder / f"own_{name}.toml").write_bytes(path.read_bytes())
    return sorted(folder.glob("*.toml"))


def layers(folder: Path) -> list[Path]:
    """An object layer, and one on a part of the frame."""
    rng = np.random.default_rng(2)
    box = Box(4, 3, 20, 12)
    whole = {name: rng.random((HEIGHT, WIDTH)).astype(np.float32) for name in "RGBAZ"}
    part = {name: values[box.slices_in(Box(0, 0, WIDTH, HEIGHT))] for name, values in whole.items()}
    write_layers(folder / "layer.exr", whole)
    write_layers(folder / "part.exr", part, box, (WIDTH, HEIGHT))
    return [folder / "layer.exr", folder / "part.exr"]


def environments(folder: Path) -> list[Path]:
    """A sky with a sun, run-length encoded and not."""
    sky = np.random.default_rng(3).random((16, 32, 3)).astype(np.float32)
    sky[4, 9] = 900.0
    cv2.imwrite(str(folder / "sky.hdr"), sky)
    cv2.imwrite(str(folder / "flat.hdr"), sky, [cv2.IMWRITE_HDR_COMPRESSION, 0])
    return [folder / "flat.hdr", folder / "sky.hdr"]


def stills(suffix: str) -> Make:
    """Pictures of a format, with alpha and without where it has that."""

    def make(folder: Path) -> list[Path]:
        rng = np.random.default_rng(4)
        made = []
        for channels in (1, 3) if suffix == ".jpg" else (1, 3, 4):
            made.append(folder / f"still{channels}{suffix}")
            pixels = rng.integers(0, 256, (HEIGHT, WIDTH, channels), np.uint8)
            assert cv2.imwrite(str(made[-1]), pixels)
        return made

    return make


def clips(suffix: str, codec: str) -> Make:
    """Six frames, with sound where the format has any."""

    def make(folder: Path) -> list[Path]:
        formats = {"prores_ks": "yuv422p10le", "wrapped_avframe": "yuv420p"}
        size = (64, 64) if codec == "libx265" else (48, 32)
        frames = [noise_frame(*size, formats.get(codec, "yuv420p"), seed) for seed in range(6)]
        quick = {"libx264": {"preset": "ultrafast"}, "libvpx-vp9": {"cpu-used": "8"},
                 "libx265": {"preset": "ultrafast", "x265-params": "log-level=none"}}  # fmt: skip
        base = {"mpeg2video": Fraction(1, 25), "wrapped_avframe": Fraction(1, 25)}.get(codec)
        pts = range(6) if base else None
        path = write_clip(
            folder / f"clip{suffix}", frames, codec=codec, options=quick.get(codec), pts=pts,
            time_base=base or Fraction(1, 16000), audio=suffix in (".mp4", ".mkv", ".ts"),
        )  # fmt: skip
        return [path]

    return make


def chunks(folder: Path) -> list[Path]:
    """Two chunks of one row."""
    (clip,) = clips(".mkv", "ffv1")(folder)
    marks = [ChunkMark(key="0" * 16, plate="p", first=at, end=at + 3) for at in (0, 3)]
    feed = ChunkFeed(marks)
    feed.end()
    with open_source(str(clip)) as source, ChunkWriter(folder, source.info, feed) as row:
        for frame in ChunkRange(source, feed).items():
            row.write(frame)
    return [folder / mark.file_name for mark in marks]

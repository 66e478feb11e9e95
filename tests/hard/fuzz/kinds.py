"""Every kind of file that the program reads: sound ones to start from, and what reads them."""

from __future__ import annotations

import contextlib
import json
import random
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from hard.fuzz import seeds, texts
from hard.fuzz.mutate import NASTY_SHOT, changed_json, changed_text, damaged, json_bytes

from nlens_video.core.errors import OutputError
from nlens_video.video.info import Packet
from nlens_video.video.interfaces import Sink, Source

Mutate = Callable[[bytes, random.Random, bytes], bytes]


@dataclass(frozen=True)
class Kind:
    """A kind of file.

    Attributes:
        name: what the tables call it.
        suffix: of its files.
        make: writes some sound files into a folder.
        use: reads one as a run would; an NlensError is a fine answer.
        mutate: damages the bytes of a sound file.
        share: of all inputs of a long run [1].
        native: whether code outside Python decodes it.
    """

    name: str
    suffix: str
    make: Callable[[Path], list[Path]]
    use: Callable[[Path], None]
    mutate: Mutate = damaged
    share: float = 1.0
    native: bool = False


def _json_of(data: bytes, rng: random.Random, other: bytes) -> bytes:
    return json_bytes(changed_json(json.loads(data), rng))


def _glb_json(data: bytes, rng: random.Random, other: bytes) -> bytes:
    document, binary = seeds.parts_of_glb(data)
    return seeds.glb_of(changed_json(document, rng), binary)


def _text(data: bytes, rng: random.Random, other: bytes) -> bytes:
    return changed_text(data.decode(), rng).encode(errors="surrogatepass")


def _shot_text(data: bytes, rng: random.Random, other: bytes) -> bytes:
    return changed_text(data.decode(), rng, NASTY_SHOT).encode(errors="surrogatepass")


def _use_scene(path: Path) -> None:
    from nlens_video.scene import Scene

    scene = Scene.load(path)
    for time_s in (0.0, 0.5):
        scene.pose(time_s).vertices()
    scene.triangles(1.0)
    if scene.camera_names:
        scene.camera(0.5, 64, 48)


def _use_fit(path: Path) -> None:
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.stages.r_lens_track import FitTrack

    LensFit.load(path).for_width(960, 540)
    track = FitTrack.load(path)
    if track is not None:
        track = track.for_width(960, 540)
        for index in (0, 3, 10**6):
            track.at(index)
        track.describe()


def _use_pipeline(path: Path) -> None:
    from nlens_video.graph.pipeline_file import load_pipeline

    load_pipeline(str(path))


def _use_environment(path: Path) -> None:
    from nlens_video.scene.environment import load_environment

    load_environment(path, 30.0, 0.5)


def _use_layer(path: Path) -> None:
    from nlens_video.core.errors import InputError
    from nlens_video.video.exr import LayerReader

    LayerReader(str(path), (24, 16)).read(0)
    with contextlib.suppress(InputError):
        _use_matte(path)
    _use_video(path, "copy.exr")


def _use_matte(path: Path) -> None:
    from nlens_video.video.input.holdout import open_holdout

    holdout = open_holdout(str(path), (24, 16))
    try:
        holdout.read(0)
    finally:
        holdout.close()


def _use_still(path: Path) -> None:
    from nlens_video.core.errors import NlensError
    from nlens_video.kernels.scatter.shape import read_picture

    for use in (_use_matte, read_picture):
        with contextlib.suppress(NlensError):
            use(path)
    _use_video(path)


def _use_video(path: Path, target: str = "copy.mkv") -> None:
    """Through a whole copy: what a damaged file says of itself reaches the muxer too."""
    from nlens_video.video.input.source import open_source
    from nlens_video.video.output.sink import open_sink

    codec = "ffv1" if target.endswith(".mkv") else None
    out = str(path.with_name(target))
    with open_source(str(path)) as source, open_sink(out, source.info, codec=codec) as sink:
        source.packet_sink = _writing_to(sink)
        _copy(source, sink)


def _writing_to(sink: Sink) -> Callable[[Packet], None]:
    def write(packet: Packet) -> None:
        try:
            sink.write_packet(packet)
        except OutputError as error:
            raise AssertionError("a packet beside the pictures ends the run") from error

    return write


def _copy(source: Source, sink: Sink) -> None:
    last = None
    for frame in source:
        moment = frame.pts * frame.time_base
        assert last is None or moment > last, "times do not rise"
        last = moment
        if frame.index < 3:
            frame.picture.srgb()
        try:
            sink.write(frame)
        except OutputError as error:
            if not frame.index:
                raise  # the encoder does not take such pictures, and says so at once
            raise AssertionError(f"frame {frame.index} cannot be written") from error
        if frame.index >= 64:  # a damaged file may say that it goes on for ever
            break
    sink.commit()


def _use_chunk(path: Path) -> None:
    from nlens_video.video.chunk_file import ChunkFile

    for _ in ChunkFile(path).frames():
        pass


def _clip(name: str, suffix: str, codec: str, share: float = 1.0) -> Kind:
    make = seeds.clips(suffix, codec)
    return Kind(name, suffix, make, _use_video, share=share, native=True)


def _still(suffix: str, share: float = 1.0) -> Kind:
    make = seeds.stills(suffix)
    return Kind(suffix[1:], suffix, make, _use_still, share=share, native=True)


KINDS = {
    kind.name: kind
    for kind in (
        Kind("glb: bytes", ".glb", seeds.scenes, _use_scene, share=10.0),
        Kind("glb: its JSON", ".glb", seeds.scenes, _use_scene, _glb_json, share=12.0),
        Kind("gltf with files beside it", ".gltf", seeds.loose_scenes, _use_scene, _json_of, 6.0),
        Kind("fit.json: bytes", ".json", seeds.fits, _use_fit, share=8.0),
        Kind("fit.json: its values", ".json", seeds.fits, _use_fit, _json_of, 10.0),
        Kind("pipeline: bytes", ".toml", seeds.pipelines, _use_pipeline, share=5.0),
        Kind("pipeline: its lines", ".toml", seeds.pipelines, _use_pipeline, _text, 5.0),
        Kind("shot file: bytes", ".toml", texts.shots, texts.use_shot, share=2.0),
        Kind("shot file: its lines", ".toml", texts.shots, texts.use_shot, _shot_text, 3.0),
        Kind("list of shots", ".toml", texts.jobs, texts.use_jobs, _shot_text, 2.0),
        Kind("camera.json: bytes", ".json", texts.cameras(".json"), texts.use_camera, share=2.0),
        Kind(
            "camera.json: its values",
            ".json",
            texts.cameras(".json"),
            texts.use_camera,
            _json_of,
            3.0,
        ),
        Kind("camera of a .chan", ".chan", texts.cameras(".chan"), texts.use_camera, share=2.0),
        Kind("camera of fSpy", ".json", texts.fspy_files, texts.use_camera, _json_of, 2.0),
        Kind("camera of COLMAP", ".txt", texts.colmap_models, texts.use_colmap, share=2.0),
        Kind("camera of a .usda", ".usda", texts.cameras(".usda"), texts.use_camera, share=0.2),
        Kind("exr", ".exr", seeds.layers, _use_layer, share=3.0, native=True),
        Kind(
            "hdr environment", ".hdr", seeds.environments, _use_environment, share=3.0, native=True
        ),
        *(_still(suffix) for suffix in (".png", ".jpg")),
        *(_still(suffix, 0.5) for suffix in (".tif", ".webp")),
        _clip("mp4 (H.264, AAC)", ".mp4", "libx264"),
        _clip("mp4 (HEVC, AAC)", ".mp4", "libx265", 0.5),
        _clip("mov (ProRes)", ".mov", "prores_ks", 0.5),
        _clip("mkv (FFV1, AAC)", ".mkv", "ffv1"),
        _clip("webm (VP9)", ".webm", "libvpx-vp9", 0.5),
        _clip("nut (raw)", ".nut", "rawvideo"),
        _clip("ts (MPEG-2, AAC)", ".ts", "mpeg2video"),
        _clip("y4m", ".y4m", "wrapped_avframe"),
        Kind("chunk", ".nut", seeds.chunks, _use_chunk, share=3.0, native=True),
    )
}

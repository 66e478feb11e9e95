"""Small shots with a known lens, made by the tests: a textured ground, a blurred plate, a GLB."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
from support.glb_builder import GlbBuilder

from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.kernels.scatter.scatter import scatter
from nlens_video.scene.camera import Camera

WIDTH, HEIGHT = 480, 270
YFOV = 0.7
SLOPE, INTERCEPT = 24.0, -12.0  # in focus at 2 m; a CoC of 12 px at infinity
EYE_HEIGHT, TILT = 1.2, 0.35


def camera_pose():
    c, s = np.cos(TILT), np.sin(TILT)
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, c, s], [0, -s, c]]
    pose[1, 3] = EYE_HEIGHT
    return pose


def camera():
    return Camera.from_yfov(camera_pose(), YFOV, WIDTH, HEIGHT)


def plate(seed=0, slope=SLOPE, intercept=INTERCEPT):
    """A sharp-textured ground and a far wall, seen by a lens; uint8 sRGB RGB (H, W, 3)."""
    view = camera()
    disparity = np.maximum(view.plane_disparity(0.0), 0.12)
    rng = np.random.default_rng(seed)
    light = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    for octave in range(6):
        size = (max(2, WIDTH >> octave), max(2, HEIGHT >> octave))
        noise = rng.random((size[1], size[0], 3), np.float32) - 0.5
        light += cv2.resize(noise, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
    light = np.clip(0.3 + 0.25 * light, 0.02, 1.0)
    opaque = np.dstack([light, np.ones((HEIGHT, WIDTH), np.float32)])
    coc = (slope * disparity + intercept).astype(np.float32)
    blurred = scatter(opaque, coc)[..., :3]
    coded = np.where(blurred < 0.0031308, 12.92 * blurred, 1.055 * blurred ** (1 / 2.4) - 0.055)
    return np.clip(np.round(255 * coded), 0, 255).astype(np.uint8)


def grey():
    """A plate without any texture."""
    return np.full((HEIGHT, WIDTH, 3), 119, np.uint8)


def write_png(path: Path, rgb=None) -> Path:
    rgb = plate() if rgb is None else rgb
    assert cv2.imwrite(str(path), rgb[..., ::-1])
    return path


def write_video(  # the defaults are a common camera file
    path: Path, frames=12, *, codec="libx264", pix_fmt="yuv420p", rgb=None, rate=25, audio=True,
    pts=None, time_base=None, group=250,
):  # fmt: skip
    rgb = plate() if rgb is None else rgb
    rng = np.random.default_rng(1)
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        stream.width, stream.height, stream.pix_fmt = rgb.shape[1], rgb.shape[0], pix_fmt
        if codec == "libx264":
            stream.options = {"crf": "16", "preset": "ultrafast", "g": str(group)}
        if time_base is not None:
            stream.codec_context.time_base = time_base
        tones = container.add_stream("aac", rate=48000) if audio else None
        for number in range(frames):
            grain = rng.normal(0, 1.0, rgb.shape)
            noisy = np.clip(rgb + grain, 0, 255).astype(np.uint8)
            frame = av.VideoFrame.from_ndarray(noisy, "rgb24").reformat(
                format=pix_fmt, dst_colorspace="ITU709", dst_color_range="MPEG"
            )
            frame.pts = pts[number] if pts is not None else number
            frame.time_base = time_base or Fraction(1, rate)
            container.mux(stream.encode(frame))
            if tones is not None:
                container.mux(tones.encode(_tone(number, rate)))
        container.mux(stream.encode())
        if tones is not None:
            container.mux(tones.encode())
    return path


def _tone(number, rate):
    count = 48000 // rate
    wave = 0.1 * np.sin(0.05 * (np.arange(count) + number * count))
    frame = av.AudioFrame.from_ndarray(wave.astype(np.float32)[None], "fltp", "mono")
    frame.sample_rate, frame.pts, frame.time_base = 48000, number * count, Fraction(1, 48000)
    return frame


CUBE = np.array(
    [[x, y, z] for x in (-0.5, 0.5) for y in (0.0, 1.0) for z in (-0.5, 0.5)], np.float32
)
CUBE_FACES = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]], np.uint16
)  # fmt: skip


def cube_glb(
    path: Path,
    *,
    start=(0.0, 0.0, -1.6),
    end=None,
    seconds=1.0,
    size=0.35,
    camera=True,
    sun=True,
    sun_lx=2.0,
    origin=None,
    **named,
):
    """A cube on the ground that slides from `start` to `end`, a camera and a sun.

    `named` are further fields of its node. `origin` moves all of it to another place of the world.
    """
    builder = GlbBuilder()
    paint = builder.add(
        "materials",
        {"pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.25, 0.1, 1], "metallicFactor": 0}},
    )
    mesh = builder.mesh(CUBE, CUBE_FACES, material=paint)
    node = builder.node(mesh=mesh, translation=list(start), scale=[size] * 3, **named)
    if end is not None:
        path_keys = np.array([start, end], np.float32)
        builder.animation((node, "translation", [0.0, seconds], path_keys, "LINEAR"))
    if camera:
        lens = builder.camera(YFOV, name="Plate", aspect=WIDTH / HEIGHT)
        builder.node(camera=lens, matrix=camera_pose().T.ravel().tolist())
    if sun:
        builder.light(intensity=sun_lx, node={"rotation": [-0.5, 0.2, 0.0, 0.84]})
    if origin is not None:
        everything = builder.document["scenes"][0]["nodes"]
        builder.document["scenes"][0]["nodes"] = []
        builder.node(translation=list(origin), children=everything)
    return builder.write(path)


def fit_json(path: Path, width=WIDTH, height=HEIGHT) -> Path:
    scale = width / WIDTH
    path.write_text(
        f'{{"slope": {SLOPE * scale}, "intercept": {INTERCEPT * scale}, '
        f'"width": {width}, "height": {height}}}'
    )
    return path


def camera_json(path: Path, **values) -> Path:
    """The camera of the shots as `solve` writes it, with further `values` of `SolvedCamera`."""
    key = CameraKey(
        index=0, pts_s=0.0, world_to_camera=camera().camera_from_world,
        fov_x_deg=float(np.degrees(2.0 * np.arctan(0.5 * WIDTH / camera().fx))),
    )  # fmt: skip
    path.write_text(SolvedCamera(width=WIDTH, height=HEIGHT, keys=(key,), **values).to_json())
    return path


def write_shot(folder: Path, frames=12, *, still=True, fit=True, **cube) -> Path:
    """The files of a run: `in.mp4`, `anim.glb`, and unless left out `plate.png` and `fit.json`."""
    write_video(folder / "in.mp4", frames)
    cube_glb(folder / "anim.glb", **cube)
    if still:
        write_png(folder / "plate.png")
    if fit:
        fit_json(folder / "fit.json")
    return folder


def read_planes(path: Path):
    """Decoded planes of each frame, and its pts: [(pts, [plane, ...])]."""
    frames = []
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            planes = []
            for at, plane in enumerate(frame.planes):
                component = frame.format.components[at]
                rows = np.frombuffer(plane, np.uint8).reshape(component.height, plane.line_size)
                planes.append(rows[:, : component.width].copy())
            frames.append((frame.pts, planes))
    return frames


def assert_same_frames(one, other):
    """Two videos, as paths or as `read_planes` gives them, have equal times and equal samples."""
    one, other = (
        read_planes(video) if isinstance(video, Path) else video for video in (one, other)
    )
    assert [pts for pts, _ in one] == [pts for pts, _ in other] != []
    for (_, planes), (_, also) in zip(one, other, strict=True):
        assert all(map(np.array_equal, planes, also))


def audio_packets(path: Path):
    with av.open(str(path)) as container:
        if not container.streams.audio:
            return []
        return [bytes(p) for p in container.demux(audio=0) if p.dts is not None]

"""Make the samples again: python samples/make_samples.py [terrace] [park] [--work DIR].

Renders the light layers with Blender 3.4 or later (skipped where DIR already holds them), fits
the object's lights to a white sphere that stood in the plate's scene, writes the JSON and the
object, then mixes, grains and encodes the clip.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import Any

import ambience
import av
import develop
import make_object
import numpy as np
from scipy.optimize import nnls
from shot_list import FRAMES, HEIGHT, RATE, SENSOR_MM, SHOTS, WIDTH, Shot

HERE = Path(__file__).parent
PROBE_M = 0.05
X264 = {"crf": "16", "preset": "slow", "tune": "grain"}
FILLS = {"sky": (0.0, 1.0, 0.35), "bounce": (0.0, -0.25, 1.0)}
"""Directions towards the object's fill lights, glTF axes; `bounce` comes from the camera's side."""


def render_layers(shot: Shot, folder: Path, samples: int) -> None:
    """Run Blender on one scene; its Python takes numpy from this one's packages."""
    packages = [p for p in sys.path if p.endswith("site-packages")]
    command = ["blender", "-b", "--python-use-system-env", "--python-exit-code", "1"]
    command += ["-P", str(HERE / "make_plate.py"), "--"]
    command += [shot.name, "--out", str(folder), "--samples", str(samples)]
    path = os.pathsep.join([str(HERE), *packages])
    subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": path})


def fit_lights(shot: Shot, folder: Path) -> list[dict[str, Any]]:
    """Directional lights under which a white sphere looks as it did in the plate's scene.

    Radiance of a white Lambert surface is the sum of intensity / pi * cos over the lights; the
    key comes from the sun, the fills from FILLS, each with a colour of its own.
    """
    seen = shot.exposure * sum(develop.read_groups(folder / "probe.exr").values())
    normals, hit = _sphere_normals(shot)
    towards = {"key": (shot.sun[0], shot.sun[2], -shot.sun[1]), **FILLS}
    axes = np.array(list(towards.values()), float)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    cosines = np.clip(normals[hit] @ axes.T, 0.0, None) / np.pi
    power = np.stack([nnls(cosines, seen[hit][:, c])[0] for c in range(3)], axis=1)
    return [
        {
            "name": name,
            "towards": [round(float(v), 5) for v in axis],
            "colour": [round(float(v), 4) for v in rgb / max(rgb.max(), 1e-6)],
            "intensity": round(float(rgb.max()), 4),
        }
        for name, axis, rgb in zip(towards, axes, power, strict=True)
    ]


def _sphere_normals(shot: Shot) -> tuple[develop.Floats, Any]:
    """Normals (H, W, 3) of the probe in glTF axes, and where a pixel sees it, rim excluded."""
    pitch = np.radians(shot.pitch_deg)
    right, up = np.array([1.0, 0, 0]), np.array([0.0, np.cos(pitch), -np.sin(pitch)])
    ahead = np.array([0.0, -np.sin(pitch), -np.cos(pitch)])
    x = (np.arange(WIDTH) + 0.5 - 0.5 * WIDTH) / shot.focal_px
    y = -(np.arange(HEIGHT) + 0.5 - 0.5 * HEIGHT) / shot.focal_px
    rays = ahead + x[None, :, None] * right + y[:, None, None] * up
    rays /= np.linalg.norm(rays, axis=2, keepdims=True)
    to_centre = np.array([0.0, PROBE_M - shot.height_m, -shot.focus_m])
    nearest = rays @ to_centre
    miss = to_centre @ to_centre - nearest**2
    reach = np.sqrt(np.clip(PROBE_M**2 - miss, 0.0, None))
    normals = (rays * (nearest - reach)[..., None] - to_centre) / PROBE_M
    return normals, miss < (0.96 * PROBE_M) ** 2


def describe(shot: Shot, lights: list[dict[str, Any]]) -> str:
    """The plate's JSON: a lens fit that `--fit` takes, and what it follows from."""
    fit = {
        "model": "coc_px = slope * disparity + intercept",
        "slope": shot.slope,
        "intercept": shot.intercept,
        "width": WIDTH,
        "height": HEIGHT,
        "frame": 0,
        "sign": "resolved",
        "method": "true lens of the rendered plate",
    }
    lens = {
        "law": "coc_px = A * f / (zf - f) * width / sensor_width * (zf / z - 1), A = f / N",
        "focal_length_mm": shot.focal_mm,
        "f_number": shot.f_number,
        "focus_distance_m": shot.focus_m,
        "sensor_width_mm": SENSOR_MM,
        "focus_disparity": 1.0 / shot.focus_m,
    }
    camera = {
        "height_m": shot.height_m,
        "pitch_deg": shot.pitch_deg,
        "yfov_rad": shot.yfov,
        "ground_y": 0.0,
    }
    return json.dumps({**fit, "lens": lens, "camera": camera, "lights": lights}, indent=1) + "\n"


def encode(shot: Shot, folder: Path, path: Path) -> None:
    """Write the clip: H.264, BT.709 limited range, and AAC."""
    with av.open(str(path), "w", options={"movflags": "+faststart"}) as out:
        video = out.add_stream("libx264", rate=RATE, options=X264)
        video.width, video.height, video.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        context = video.codec_context
        context.colorspace = context.color_primaries = context.color_trc = 1
        context.color_range, context.gop_size, context.thread_count = 1, 48, 2
        audio = out.add_stream("aac", rate=ambience.SOUND_HZ, layout="stereo")
        audio.bit_rate = 128_000
        for index, planes in enumerate(develop.frames(shot, folder)):
            frame = av.VideoFrame.from_ndarray(planes, format="yuv420p")
            frame.pts, frame.time_base = index, Fraction(1, RATE)
            frame.colorspace = frame.color_primaries = frame.color_trc = frame.color_range = 1
            out.mux(video.encode(frame))
        out.mux(video.encode(None))
        sound = ambience.ambience(shot)
        for start in range(0, sound.shape[1], 1024):
            piece = np.ascontiguousarray(sound[:, start : start + 1024])
            chunk = av.AudioFrame.from_ndarray(piece, format="fltp", layout="stereo")
            chunk.sample_rate, chunk.pts = ambience.SOUND_HZ, start
            chunk.time_base = Fraction(1, ambience.SOUND_HZ)
            out.mux(audio.encode(chunk))
        out.mux(audio.encode(None))


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("scenes", nargs="*", default=sorted(SHOTS), help="terrace, park")
    parser.add_argument("--work", type=Path, default=Path("runs/samples"), help="light layers")
    parser.add_argument("--out", type=Path, default=HERE)
    parser.add_argument("--samples", type=int, default=384, help="rays per pixel")
    given = parser.parse_args()
    for name in given.scenes:
        if name not in SHOTS:
            parser.error(f"no scene {name!r}; expected one of {sorted(SHOTS)}")
        shot, folder = SHOTS[name], given.work / name
        if not (folder / "probe.exr").exists():
            render_layers(shot, folder, given.samples)
        lights = fit_lights(shot, folder)
        (given.out / shot.plate).with_suffix(".json").write_text(describe(shot, lights))
        make_object.write(name, lights, given.out / shot.glb)
        encode(shot, folder, given.out / shot.plate)
        print(f"{given.out / shot.plate}: {FRAMES} frames, with {shot.glb}")


if __name__ == "__main__":
    main()

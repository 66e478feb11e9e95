"""A small plate with a known lens, in the folder that `evaluate` reads; made without OpenGL."""

import json

import cv2
import numpy as np
from support.shots import camera_pose, cube_glb

from nlens_video.core.layers import Box, DefocusedLayer, ObjectLayer
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.scene.camera import Camera
from nlens_video.stages.l_reblur import ReblurLayer
from nlens_video.video.exr import write_layers
from nlens_video.video.pixels.picture import ArrayPicture

WIDTH, HEIGHT, YFOV = 320, 180, 0.7
SLOPE, INTERCEPT = 30.0, -6.0  # in focus at 5 m, far behind the object
SIZE, PLACE = 0.35, np.array([0.0, 0.0, -1.6])


def camera():
    return Camera.from_yfov(camera_pose(), YFOV, WIDTH, HEIGHT)


def cube_depth(view):
    """Camera-space depth of the cube at each pixel, 1e10 where it is not (slab method)."""
    columns = (np.arange(view.width) + 0.5 - view.cx) / view.fx
    rows = -(np.arange(view.height) + 0.5 - view.cy) / view.fy
    across, up = np.meshgrid(columns, rows)
    rays = np.stack([across, up, -np.ones_like(across)], -1) @ view.world_from_camera[:3, :3].T
    low = PLACE + SIZE * np.array([-0.5, 0.0, -0.5])
    high = PLACE + SIZE * np.array([0.5, 1.0, 0.5])
    eye = view.world_from_camera[:3, 3]
    with np.errstate(divide="ignore"):
        first, second = (low - eye) / rays, (high - eye) / rays
    enter, leave = np.minimum(first, second).max(-1), np.maximum(first, second).min(-1)
    return np.where((enter < leave) & (enter > 0), enter, 1e10)  # a ray's unit is one of depth


def texture(seed):
    """Opaque scene-linear noise of many sizes (H, W, 4)."""
    rng = np.random.default_rng(seed)
    light = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    for octave in range(6):
        noise = rng.random((max(2, HEIGHT >> octave), max(2, WIDTH >> octave), 3), np.float32) - 0.5
        light += cv2.resize(noise, (WIDTH, HEIGHT), interpolation=cv2.INTER_NEAREST)
    light = np.clip(0.3 + 0.25 * light, 0.02, 1.0)
    return np.dstack([light, np.ones((HEIGHT, WIDTH), np.float32)])


def write_plate(folder, *, seed=0, sharp=True):
    """One plate: ground and far wall under the lens SLOPE, INTERCEPT, and a cube to put on it."""
    folder.mkdir(parents=True)
    view = camera()
    coc = SLOPE * np.maximum(view.plane_disparity(0.0), 0.12) + INTERCEPT
    light = texture(seed)
    write_picture(folder / "bg.png", scatter(light, coc.astype(np.float32))[..., :3])
    if sharp:
        write_picture(folder / "bg_sharp.png", light[..., :3])
    depth = cube_depth(view)
    there = depth < 1e9
    np.save(folder / "bg_coc.npy", coc.astype(np.float16))
    object_coc = np.where(there, SLOPE / depth + INTERCEPT, 0)
    np.save(folder / "object_coc.npy", object_coc.astype(np.float16))
    np.savez_compressed(folder / "object_depth.npz", depth=depth.astype(np.float32))
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.uint8)
    rgba[there] = (40, 90, 200, 255)
    assert cv2.imwrite(str(folder / "object_rgba.png"), rgba)
    cube_glb(folder / "object.glb", start=PLACE, size=SIZE)
    (folder / "params.json").write_text(json.dumps({"ground_plane_y_gltf": 0.0}))
    return folder


def write_rendered(folder, *, seed=0, sharp=True):
    """A plate, its object as a layer, and the two blurred together with the true CoC."""
    write_plate(folder, seed=seed, sharp=sharp)
    depth = cube_depth(camera()).astype(np.float32)
    there = depth < 1e9
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    rgba[there] = (0.6, 0.1, 0.02, 1.0)
    channels = {name: rgba[..., at] for at, name in enumerate("RGBA")} | {"Z": depth}
    write_layers(folder / "object.exr", channels)
    frame = Box(0, 0, WIDTH, HEIGHT)
    layer = ObjectLayer(box=frame, rgba=rgba, depth=np.where(there, depth, np.float32(np.inf)))
    coc = np.where(there, SLOPE / depth + INTERCEPT, 0).astype(np.float32)
    stage = ReblurLayer(scatter=scatter, reach=blur_reach)
    blurred = stage(DefocusedLayer(layer=layer, coc_px=coc), frame)
    codes = cv2.imread(str(folder / "bg.png"))
    ArrayPicture(codes, "bgr").composite_over(blurred.box, blurred.rgba)
    assert cv2.imwrite(str(folder / "gt_noshadow.png"), codes)
    return folder


def write_picture(path, linear):
    coded = np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    codes = np.clip(np.round(255 * coded), 0, 255).astype(np.uint8)
    assert cv2.imwrite(str(path), codes[..., ::-1])

"""Two objects in one file and one fit: near over far at different blur, swapping their order.

The truth is the lens itself: the mean of 512 views from points of its aperture.
"""

import json

import cv2
import numpy as np
import pytest
from support import shots
from support.command import nlens
from support.glb_builder import GlbBuilder

from nlens_video.core.layers import Box
from nlens_video.core.lens_fit import LensFit
from nlens_video.render.select import choose_renderer
from nlens_video.scene import Scene
from nlens_video.stages.composite import composite
from nlens_video.stages.l_aperture_samples import bare_points
from nlens_video.stages.l_lens_sampling import LensSetup, lens_views
from nlens_video.video.pixels.picture import ArrayPicture

pytestmark = pytest.mark.needs_gl
SIZE = (shots.WIDTH, shots.HEIGHT)
FRAME = Box(0, 0, *SIZE)
FIT = LensFit(slope=60.0, intercept=-30.0, width=SIZE[0], height=SIZE[1])  # in focus at 2
NEAR, FAR = 1.6, 2.8  # depths [scene unit]: CoC +7.5 and -8.6 px
SWAP_S = 1.0


def paint(builder, seed):
    """A texture of soft spots, of one hue for each object."""
    rng = np.random.default_rng(seed)
    spots = cv2.resize(rng.random((12, 12), np.float32), (128, 128), interpolation=cv2.INTER_CUBIC)
    hue = np.array([[255, 120, 40], [40, 140, 255]])[seed]
    picture = np.clip((0.25 + spots)[..., None] * hue, 0, 255).astype(np.uint8)
    texture = builder.texture(picture, magFilter=9729, minFilter=9987)
    return builder.add(
        "materials",
        {
            "pbrMetallicRoughness": {"baseColorTexture": {"index": texture}, "metallicFactor": 0},
            "extensions": {"KHR_materials_unlit": {}},
        },
    )


def box_mesh(builder, seed):
    """A cube with a texture on each side."""
    corners = shots.CUBE[shots.CUBE_FACES].reshape(-1, 3, 3)
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 0], [1, 1], [0, 1]] * 6, np.float32)
    points = corners.reshape(-1, 3)
    faces = np.arange(36).reshape(-1, 3)
    return builder.mesh(points, faces, material=paint(builder, seed), TEXCOORD_0=uv)


def size(depth):
    """Twice as high as wide, and as large on the screen at any depth."""
    return [0.22 * depth, 0.44 * depth, 0.22 * depth]


def two_boxes(path):
    """`car` before `truck`, overlapping on the screen; after a second they have changed places."""
    builder = GlbBuilder()
    places = {}
    for seed, (name, x, depth) in enumerate([("car", -0.1, NEAR), ("truck", 0.15, FAR)]):
        mesh = box_mesh(builder, seed)
        places[name] = builder.node(
            mesh=mesh, name=name, translation=[x * depth / 2, 0, -depth], scale=size(depth)
        )
    for name, x, own, other in (("car", -0.1, NEAR, FAR), ("truck", 0.15, FAR, NEAR)):
        keys = [[x * own / 2, 0, -own], [x * other / 2, 0, -other]]
        scales = [size(own), size(other)]
        builder.animation(
            (places[name], "translation", [0.0, SWAP_S], keys, "LINEAR"),
            (places[name], "scale", [0.0, SWAP_S], scales, "LINEAR"),
            name=f"{name} drives",
        )
    lens = builder.camera(shots.YFOV, name="Plate")
    builder.node(camera=lens, matrix=shots.camera_pose().T.ravel().tolist())
    return builder.write(path)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("two")
    shots.write_png(folder / "plate.png")
    two_boxes(folder / "two.glb")
    (folder / "fit.json").write_text(FIT.to_json())
    return folder


@pytest.fixture(scope="module")
def truth(files):
    """The plate with both objects through the lens, at the start and after they have swapped."""
    scene, pictures = Scene.load(files / "two.glb"), {}
    plate = cv2.imread(str(files / "plate.png"))
    with choose_renderer(scene) as renderer:
        for time_s in (0.0, SWAP_S):
            camera = scene.camera(time_s, *SIZE)
            shot = LensSetup(time_s=time_s, camera=camera, fit=FIT, frame=FRAME)
            seen = lens_views(renderer, shot, bare_points(512))
            pictures[time_s] = plate.copy()
            composite(ArrayPicture(pictures[time_s]), seen)
    return pictures


def composite_run(files, out, *words):
    run = nlens(files / "plate.png", files / "two.glb", out, "--json", *words)
    assert run.returncode == 0, run.stderr
    return cv2.imread(str(out)), json.loads(run.stdout)


def error_db(got, true, plate):
    """PSNR where either picture shows the objects [dB]."""
    there = (got != plate).any(axis=2) | (true != plate).any(axis=2)
    off = (got[there].astype(float) - true[there]) / 255.0
    return -10.0 * float(np.log10((off**2).mean()))


@pytest.mark.slow
@pytest.mark.parametrize(("preset", "least_db"), [("standard", 42.0), ("reference", 53.0)])
@pytest.mark.parametrize("time_s", [0.0, SWAP_S])
def test_each_of_two_objects_has_its_own_blur_and_the_near_one_occludes(
    files, truth, tmp_path, preset, least_db, time_s
):
    words = ("--fit", files / "fit.json", "--animation-offset", time_s, "--preset", preset)
    got, _ = composite_run(files, tmp_path / "o.png", *words, "--effects", "defocus")
    plate = cv2.imread(str(files / "plate.png"))
    assert error_db(got, truth[time_s], plate) > least_db
    # the other order of the two is far off, so the measure tells them apart
    assert error_db(got, truth[SWAP_S - time_s], plate) < 20.0


@pytest.mark.parametrize("standing", ["car", "truck"])
def test_fit_found_under_either_of_two_objects_is_the_same(files, tmp_path, standing):
    words = ("--footprint", standing, "--effects", "defocus", "--preset", "realtime")
    _, summary = composite_run(files, tmp_path / "o.png", *words)
    fit = summary["fit"]
    for depth in (NEAR, FAR):
        found = fit["slope"] / depth + fit["intercept"]
        assert found == pytest.approx(shots.SLOPE / depth + shots.INTERCEPT, abs=1.5)

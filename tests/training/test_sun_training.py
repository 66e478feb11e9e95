import math
import platform

import numpy as np
import pytest

pytestmark = [
    pytest.mark.needs_torch,
    pytest.mark.skipif(
        platform.machine() not in ("x86_64", "AMD64"),
        reason="embreex, which casts the rays of the pictures, has wheels for x86-64 alone",
    ),
    pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning"),
]

COLUMNS, ROWS = 192, 112


def scene(azimuth_deg, elevation_deg, left=0.25, pitch_deg=25.0, tall=0.6, fov=1.0):
    """A block on the ground before a level camera, under a sun; azimuth 0 is where it looks."""
    from models.sun.scene import Camera, Light, Scene, Thing
    from models.sun.shapes import solid

    around, up = math.radians(azimuth_deg), math.radians(elevation_deg)
    toward = np.array([
        math.cos(up) * math.sin(around), math.sin(up), -math.cos(up) * math.cos(around),
    ])  # fmt: skip
    light = Light(toward, 0.005, left, np.zeros((0, 3)), np.zeros(0), 0.1, np.zeros(3), np.ones(3))
    block = solid("box", (0.3, tall, 0.3), (0.0, 0.5 * tall, -2.5))
    return Scene(Camera(math.radians(pitch_deg), 0.0, fov, 12 / 7), light, [Thing([block])])


def even_ground():
    from models.sun.ground import Ground, Texture

    texture = Texture.of(np.ones((256, 256, 3), np.float32))
    marks = np.ones((4, 4, 3), np.float32)
    return Ground(np.full(3, 0.3), texture, 1.0, 1.0, 0.0, marks, 10.0), [texture]


def rendered(scene):
    from models.sun.render import render

    ground, textures = even_ground()
    return render(scene, ground, textures, np.random.default_rng(3), COLUMNS, ROWS)


def examples(count=8, **fields):
    """Pictures of noise and random suns, one in four without."""
    from models.sun.data import Examples

    rng = np.random.default_rng(1)
    cameras = np.tile(np.float32([0.4, 0.0, 1.0, 12 / 7]), (count, 1))
    suns = rng.uniform((-3.0, 0.2, 0.1), (3.0, 1.3, 0.8), (count, 3)).astype(np.float32)
    suns[::4] = math.nan
    pictures = rng.integers(0, 255, (count, ROWS, COLUMNS, 3)).astype(np.uint8)
    labels = rng.integers(0, 255, (count, ROWS // 4, COLUMNS // 4, 2)).astype(np.uint8)
    return Examples(**({
        "pictures": pictures, "labels": labels, "cameras": cameras, "suns": suns,
    } | fields))  # fmt: skip


@pytest.mark.parametrize(
    ("azimuth", "where"), [(90.0, "left"), (-90.0, "right"), (0.0, "below"), (180.0, "above")]
)
def test_shadows_fall_away_from_the_sun(azimuth, where):
    _, labels = rendered(scene(azimuth, 10.0, tall=0.2))
    shaded, things = labels[..., 0] > 0.5, labels[..., 1] > 0.5
    (y, x), (thing_y, thing_x) = np.nonzero(shaded), np.nonzero(things)
    assert len(x) > 6
    beside = {
        "left": thing_x.min() - x.min(), "right": x.max() - thing_x.max(),
        "below": y.max() - thing_y.max(), "above": thing_y.max() - y.min(),
    }  # fmt: skip
    assert max(beside, key=beside.get) == where


@pytest.mark.parametrize("left", [0.2, 0.6])
def test_a_shadow_leaves_the_share_of_light_that_is_stated(left):
    import cv2

    made, labels = rendered(scene(90.0, 35.0, left=left, fov=0.5))
    light = cv2.resize(made.mean(axis=2), (COLUMNS // 4, ROWS // 4), interpolation=cv2.INTER_AREA)
    open_ground = light[-4:].mean()
    shaded = light[labels[..., 0] == 1.0]
    # what stands beside hides a part of the sky, too, and sends some light back
    assert len(shaded) > 5 and shaded.max() / open_ground == pytest.approx(left, rel=0.15)


def test_a_seed_names_a_picture():
    from models.sun.data import draw_example
    from models.sun.ground import load_textures

    textures = load_textures(np.random.default_rng(0), [], 4)
    one, other, another = (draw_example(seed, textures) for seed in (5, 5, 6))
    assert (one[0] == other[0]).all() and (one[1] == other[1]).all()
    assert not (one[0] == another[0]).all()


@pytest.mark.parametrize("roll", [0.0, 0.08])
def test_maps_of_the_training_are_those_of_a_run(roll):
    from scipy.spatial.transform import Rotation

    from models.sun.train import maps
    from nlens_video.scene.camera import Camera
    from nlens_video.scene.plate_sun import ground_map

    pitch, fov, heading = 0.35, 0.9, 1.2
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("YXZ", [heading, -pitch, roll]).as_matrix()
    focal = 0.5 * 800 / math.tan(0.5 * fov)
    camera = Camera(
        world_from_camera=pose, fx=focal, fy=focal, cx=400.0, cy=250.0, width=800, height=500
    )
    known = np.array([[pitch, roll, fov, 800 / 500]])
    trained = maps(known, np.array([[0.0, 0.0, 1.0, 1.0]]))
    found = ground_map(camera)
    # a rolled view looks aside by the product of roll and pitch, which the training leaves out
    off = 1.1 * roll * pitch + 1e-5
    np.testing.assert_allclose(found.distance, trained.distance, atol=1e-4)
    np.testing.assert_allclose(found.azimuth, trained.azimuth, atol=off)
    np.testing.assert_allclose(found.places, trained.places, atol=1e-4)


def test_crops_and_mirror_images_keep_places_labels_and_suns_together(monkeypatch):
    from models.sun import train

    monkeypatch.setattr(train, "PITCH_ERROR", 0.0)
    monkeypatch.setattr(train, "FOCAL_ERROR", 0.0)
    place = (np.arange(COLUMNS // 4) + 0.5) / (COLUMNS // 4)
    labels = np.broadcast_to(255.0 * place[None, None, :, None], (8, ROWS // 4, COLUMNS // 4, 2))
    suns = np.tile(np.float32([0.7, 0.5, 0.4]), (8, 1))
    known = examples(labels=labels.astype(np.uint8), suns=suns)
    batch = train.drawn(known, np.arange(8), np.random.default_rng(2))
    mirrored = (batch.azimuth < 0.0).numpy()
    assert mirrored.any() and not mirrored.all()
    for features, shown, turned in zip(batch.features, batch.labels, mirrored, strict=True):
        seen, distance, azimuth = (
            features[..., channel].unfold(0, 4, 4).unfold(1, 4, 4).mean((2, 3))
            for channel in (3, 4, 5)
        )
        inner = seen == 1.0
        assert inner.sum() > 20
        # level lens turned down by 0.4: depth of a point of the ground, and its column
        away = distance.exp()
        depth = away * azimuth.cos() * math.cos(0.4) + math.sin(0.4)
        column = 0.5 + 0.5 * away * azimuth.sin() / depth / math.tan(0.5)
        expected = 1.0 - column if turned else column
        np.testing.assert_allclose(shown[0][inner], expected[inner], atol=0.03)


def test_sun_training_resumes_from_a_checkpoint(resume):
    from models.sun.train import Recipe, Run, validate

    recipe, some = Recipe(minutes=1, batch=4), examples()
    run, again = Run(recipe), Run(recipe)
    resume(run, again, some, 2)
    assert validate(again.average, some) == validate(run.average, some)


def test_exported_sun_network_agrees_with_the_trained_one(tmp_path):
    import torch

    from models.sun.export import export
    from models.sun.network import SunNet
    from nlens_video.networks.sun_network import OnnxSunNetwork

    torch.manual_seed(0)
    network = SunNet().eval()
    export(network, tmp_path / "sun.onnx")
    exported = OnnxSunNetwork(tmp_path / "sun.onnx")
    features = np.random.default_rng(0).random((96, 128, 6), dtype=np.float32)
    with torch.inference_mode():
        answer = network(torch.from_numpy(features)[None])[0]
    np.testing.assert_allclose(exported(features), answer.numpy(), atol=5e-3)
    with pytest.raises(ValueError, match="features.shape"):
        exported(features[:, :4])


def test_torch_and_onnx_agree_on_the_shipped_sun_weights():
    import torch

    from models.sun.export import HERE, load_network
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.sun_network import OnnxSunNetwork

    features = np.random.default_rng(0).random((96, 128, 6), dtype=np.float32)
    with torch.inference_mode():
        answer = load_network(HERE / "weights.pt")(torch.from_numpy(features)[None])[0]
    shipped = OnnxSunNetwork(find_model("sun").path)(features)
    np.testing.assert_allclose(shipped, answer.numpy(), atol=0.05)


def test_shipped_weights_tell_the_sun_of_pictures_that_were_not_trained_on():
    """Three of four suns that are claimed are right, and some are claimed."""
    from models.sun.data import draw_example, sun_of
    from models.sun.ground import load_textures
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.sun_network import OnnxSunNetwork
    from nlens_video.scene.camera import Camera
    from nlens_video.scene.plate_sun import read_sun

    network = OnnxSunNetwork(find_model("sun").path)
    textures = load_textures(np.random.default_rng(9), [], 20)
    right, claimed = 0, 0
    for seed in range(900000, 900100):
        codes, _, drawn = draw_example(seed, textures)
        lens = drawn.camera
        pose = np.eye(4)
        pose[:3, :3] = lens.world_from_camera
        pose[1, 3] = 1.0
        focal = 0.5 * 960 / math.tan(0.5 * lens.fov)
        tall = round(960 / lens.aspect)
        camera = Camera(
            world_from_camera=pose, fx=focal, fy=focal, cx=480.0, cy=0.5 * tall, width=960,
            height=tall,
        )  # fmt: skip
        found = read_sun(network, (codes / np.float32(255.0)) ** 2, camera)
        if found is None or found.certainty < 0.6:
            continue
        claimed += 1
        off = (found.azimuth - sun_of(drawn)[0] + math.pi) % (2.0 * math.pi) - math.pi
        right += abs(off) < math.radians(25.0)
    assert claimed >= 10 and right >= 0.75 * claimed

import numpy as np
import pytest

pytestmark = [
    pytest.mark.needs_torch,
    pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning"),
]


def examples(count=8):
    """Random readings on grounds that were drawn."""
    from models.coc.long_ground import draw_ground_plane
    from models.lens.data import Examples, numbers_of
    from nlens_video.stages.whole_ground.patches import READINGS

    rng = np.random.default_rng(1)
    planes = []
    while len(planes) < count:
        plane = draw_ground_plane(rng)
        if plane.layout.offset < plane.layout.slope:
            planes.append(numbers_of(plane))
    return Examples(
        readings=rng.normal(0.5, 1.0, (count, 10, 10, READINGS)).astype(np.float16),
        planes=np.float64(planes),
    )


def test_a_seed_names_a_ground(photos):
    from models.lens.data import FINISHES, draw_pictures

    one, other, another = (draw_pictures(np.random.default_rng(seed), photos) for seed in (3, 3, 4))
    assert len(one[0]) == FINISHES
    assert all((a == b).all() for a, b in zip(one[0], other[0], strict=True))
    assert not (one[0][0] == another[0][0]).all()
    assert not (one[0][0] == one[0][1]).all()


@pytest.mark.parametrize("varied", [False, True])
def test_lens_and_places_of_a_batch_tell_the_coc_of_its_patches(varied):
    from models.coc.scene import MAX_COC_PX
    from models.lens.train import drawn

    batch = drawn(examples(), np.arange(8), np.random.default_rng(2), varied=varied)
    near = np.exp(batch.places[..., 0].double().numpy())
    a, b = batch.lens.double().numpy().T[..., None]
    coc = np.abs(2.0 * np.sinh(a) + np.exp(b) * (near - 1.0))
    expected = np.log1p(np.minimum(coc, MAX_COC_PX))
    used = batch.used.numpy()
    assert used.any(axis=1).all() and (varied or used.mean() > 0.5)
    np.testing.assert_allclose(batch.log_coc.numpy()[used], expected[used], atol=2e-3)


def test_places_of_the_training_are_those_of_a_run():
    from models.coc.scene import SIZE
    from models.lens.train import drawn
    from nlens_video.scene.camera import Camera
    from nlens_video.stages.whole_ground.patches import (
        CELL_PX,
        READINGS,
        ground_patches,
        patch_middles,
    )

    pitch, half = 0.4, 0.5 * SIZE
    pose = np.eye(4)
    pose[1:3, 1:3] = [[np.cos(pitch), np.sin(pitch)], [-np.sin(pitch), np.cos(pitch)]]
    pose[1, 3] = 1.3
    camera = Camera(
        world_from_camera=pose, fx=700.0, fy=700.0, cx=half, cy=half, width=SIZE, height=SIZE
    )
    middle, below = camera.disparity_at(np.array([half]), np.array([half, half + 1.0]), 0.0)[:, 0]
    known = examples(1)
    known.planes[0] = 0.0, below / middle - 1.0, 20.0, -5.0, 0.01
    batch = drawn(known, np.arange(1), np.random.default_rng(0), varied=False)
    columns, rows = patch_middles(SIZE, SIZE)
    there = camera.disparity_at(columns, rows, 0.0).ravel()
    used = batch.used[0].numpy()
    by_object = np.exp(batch.places[0, :, 0].numpy()[used])
    cells = np.zeros((SIZE // CELL_PX, SIZE // CELL_PX, READINGS), np.float32)
    object_at = float(np.median(there[used] / by_object))
    found = ground_patches(cells, (SIZE, SIZE), camera, 0.0, object_at)
    assert 20 < len(found.places) == used.sum()
    np.testing.assert_allclose(found.places, batch.places[0].numpy()[used], atol=1e-3)


def test_likelihood_is_that_of_a_probability():
    import torch

    from models.lens.network import negative_log_likelihood
    from nlens_video.stages.whole_ground.network_reading import CANDIDATES, NUMBERS

    torch.manual_seed(1)
    lenses = torch.randn(1, CANDIDATES, NUMBERS).double()
    side = torch.linspace(-30.0, 30.0, 1501, dtype=torch.float64)
    grid = torch.cartesian_prod(side, side)
    log_density = -negative_log_likelihood(lenses.expand(len(grid), -1, -1), grid) - np.log(
        2.0 * np.pi
    )
    whole = float(torch.exp(log_density).sum() * (side[1] - side[0]) ** 2)
    assert whole == pytest.approx(1.0, abs=2e-3)


def test_patches_left_out_change_no_answer():
    import torch

    from models.lens.network import LensNet
    from nlens_video.stages.whole_ground.patches import PLACE, READINGS

    torch.manual_seed(2)
    network = LensNet().eval()
    readings, where = torch.randn(1, 30, READINGS), torch.randn(1, 30, PLACE)
    used = torch.arange(30)[None] < 25
    with torch.inference_mode():
        masked = network(readings, where, used)
        fewer = network(readings[:, :25], where[:, :25])
    np.testing.assert_allclose(masked.numpy(), fewer.numpy(), atol=1e-5)


def test_lens_training_resumes_from_a_checkpoint(resume):
    from models.lens.train import Recipe, Run, validate

    recipe, some = Recipe(minutes=1, batch=4), examples()
    run, again = Run(recipe), Run(recipe)
    resume(run, again, some, 2)
    assert validate(again.average, some) == validate(run.average, some)


def test_exported_lens_network_agrees_with_the_trained_one(tmp_path):
    import torch

    from models.lens.export import export
    from models.lens.network import LensNet, told
    from nlens_video.networks.lens_network import OnnxLensNetwork
    from nlens_video.stages.whole_ground.patches import PLACE, READINGS, Patches

    torch.manual_seed(0)
    network = LensNet().eval()
    export(network, tmp_path / "lens.onnx")
    exported = OnnxLensNetwork(tmp_path / "lens.onnx")
    rng = np.random.default_rng(0)
    for count in (20, 47):
        patches = Patches(
            readings=rng.normal(size=(count, READINGS)).astype(np.float32),
            places=rng.normal(size=(count, PLACE)).astype(np.float32),
        )
        with torch.inference_mode():
            answer = told(network(*(torch.from_numpy(part)[None] for part in (
                patches.readings, patches.places,
            ))))[0]  # fmt: skip
        np.testing.assert_allclose(exported(patches), answer.numpy(), atol=5e-3)
    with pytest.raises(ValueError, match="at least 20"):
        exported(Patches(readings=patches.readings[:19], places=patches.places[:19]))


def test_torch_and_onnx_agree_on_the_shipped_lens_weights():
    import torch

    from models.lens.export import HERE, load_network
    from models.lens.network import told
    from nlens_video.networks.lens_network import OnnxLensNetwork
    from nlens_video.networks.model_store import find_model
    from nlens_video.stages.whole_ground.patches import PLACE, READINGS, Patches

    network = load_network(HERE / "weights.pt")
    rng = np.random.default_rng(0)
    readings = network.mean.numpy() + rng.normal(size=(60, READINGS)) * network.deviation.numpy()
    where = rng.normal(size=(60, PLACE)) * 0.3
    patches = Patches(readings=np.float32(readings), places=np.float32(where))
    with torch.inference_mode():
        answer = told(network(*(torch.from_numpy(part)[None] for part in (
            patches.readings, patches.places,
        ))))[0]  # fmt: skip
    shipped = OnnxLensNetwork(find_model("lens").path)(patches)
    np.testing.assert_allclose(shipped, answer.numpy(), atol=0.05)


def test_shipped_weights_tell_the_lens_of_grounds_that_were_not_trained_on(photos):
    from models.lens.data import Examples, draw_pictures, numbers_of, readings_of
    from models.lens.train import drawn
    from nlens_video.networks.lens_network import OnnxLensNetwork
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.onnx_networks import OnnxCocNetwork
    from nlens_video.stages.whole_ground.patches import Patches

    readings, planes = [], []
    with OnnxCocNetwork(find_model("coc").path) as f:
        for seed in range(14):
            pictures, plane = draw_pictures(np.random.default_rng([990, seed]), photos)
            if plane.layout.offset < plane.layout.slope:
                readings.append(readings_of(f, pictures[0]))
                planes.append(numbers_of(plane))
    known = Examples(readings=np.float16(readings), planes=np.float64(planes))
    batch = drawn(known, np.arange(len(planes)), np.random.default_rng(0), varied=False)
    network = OnnxLensNetwork(find_model("lens").path)
    errors, guesses = [], []
    for index, used in enumerate(batch.used):
        patches = Patches(
            readings=batch.readings[index][used].numpy(), places=batch.places[index][used].numpy()
        )
        answer = network(patches)
        likeliest = answer[answer[:, 0].argmax()]
        true = 2.0 * np.sinh(batch.lens[index, 0].item())
        errors.append(abs(2.0 * np.sinh(likeliest[1]) - true))
        guesses.append(abs(true))
    assert len(errors) > 8
    assert np.median(errors) < min(1.5, 0.4 * np.median(guesses))

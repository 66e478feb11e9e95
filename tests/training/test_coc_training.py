import cv2
import numpy as np
import pytest

pytestmark = pytest.mark.needs_torch


@pytest.fixture(scope="module")
def reservoir(photos, tmp_path_factory):
    from models.coc.data import Reservoir
    from models.coc.scene import draw_scene

    store = Reservoir(tmp_path_factory.mktemp("data"), capacity=3)
    for seed in range(4):  # one more than it holds: the oldest is replaced
        store.append(*draw_scene(np.random.default_rng(seed), photos))
    return store


@pytest.mark.parametrize("diameter", [1.0, 2.5, 6.0, 13.0, 30.0])
def test_scattered_point_has_the_energy_and_variance_of_its_disc(diameter):
    from models.coc.optics import polygon_aperture, round_aperture, scatter

    point = np.zeros((51, 51, 1), np.float32)
    point[25, 25] = 1
    axis = np.arange(51) - 25.0
    for aperture in (round_aperture(), polygon_aperture(8, 0.2)):
        spread = scatter(point, np.full((51, 51), diameter, np.float32), aperture)[..., 0]
        assert spread.sum() == pytest.approx(1, abs=1e-4)
        for profile in (spread.sum(0), spread.sum(1)):
            assert (profile * axis).sum() == pytest.approx(0, abs=0.02 + 0.003 * diameter)
            assert (profile * axis**2).sum() == pytest.approx(diameter**2 / 16, rel=0.09, abs=0.012)


@pytest.mark.parametrize("aperture", ["round", "hexagon", "cat's eye"])
def test_pixels_spread_together_give_what_each_gives_alone(aperture):
    from models.coc import optics

    shape = {
        "round": optics.round_aperture(),
        "hexagon": optics.polygon_aperture(6, 0.3),
        "cat's eye": optics.cat_eye_aperture(0.5, 1.0),
    }[aperture]
    rng = np.random.default_rng(4)
    source = rng.random((24, 30, 7), dtype=np.float32)
    source[3, 5] = 4e4  # a light
    y, x = np.mgrid[0:24, 0:30].astype(np.float32)
    steady = np.where(x < 15, 9.3, 0.9 * (y - 10))  # runs of one disc, discs of every size, none
    coc = np.float32(np.where(rng.random((24, 30)) < 0.1, rng.uniform(0, 70, (24, 30)), steady))
    alone = np.zeros(source.shape)
    for at in np.ndindex(*coc.shape):
        one = np.zeros_like(source)
        one[at] = source[at]
        alone += optics.scatter(one, np.full_like(coc, coc[at]), shape)
    together = optics.scatter(source, coc, shape)
    np.testing.assert_allclose(together, alone, rtol=2e-4, atol=2e-3)


def test_scattered_picture_agrees_with_a_supersampled_disc():
    from models.coc.optics import round_aperture, scatter

    diameter, fine = 9.0, 16
    axis = (np.arange(21 * fine) + 0.5) / fine - 10.5
    disc = np.float64(axis[:, None] ** 2 + axis**2 <= diameter**2 / 4)
    disc = disc.reshape(21, fine, 21, fine).mean((1, 3))
    texture = np.random.default_rng(0).random((64, 64), dtype=np.float32)
    truth = cv2.filter2D(texture.astype(np.float64), -1, disc / disc.sum())[12:-12, 12:-12]
    coc = np.full((64, 64), diameter, np.float32)
    found = scatter(texture[..., None], coc, round_aperture())[12:-12, 12:-12, 0]
    assert np.sqrt(np.mean((found - truth) ** 2)) < 0.05 * truth.std()


def test_seed_determines_the_training_scene(photos):
    from models.coc.scene import SIZE, draw_scene

    for seed in (1, 2):
        (first, coc), (second, again) = (
            draw_scene(np.random.default_rng([seed, 7]), photos) for _ in range(2)
        )
        np.testing.assert_array_equal(first, second)
        np.testing.assert_array_equal(coc, again)
        assert first.shape == (SIZE, SIZE, 3) and first.dtype == np.uint8
        assert coc.shape == (SIZE, SIZE) and coc.min() >= 0 and coc.max() <= 64


def test_blurred_photographs_are_rejected_as_training_pictures(photos):
    from models.coc.textures import sharp_tiles

    picture = photos.pictures[0]
    assert (sharp_tiles(picture) == 1).mean() > 0.9
    assert (sharp_tiles(cv2.GaussianBlur(picture, (0, 0), 1.5)) == 1).mean() < 0.1


def test_sample_reservoir_replaces_its_oldest_entries(reservoir):
    from models.coc.scene import SIZE

    assert reservoir.drawn == 4
    assert reservoir.pictures.shape == (3, SIZE, SIZE, 3)
    assert (np.asarray(reservoir.pictures).std((1, 2, 3)) > 0).all()


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")  # from 3.12 on
def test_several_workers_draw_what_one_draws(tmp_path):
    from models.coc.data import Reservoir, fill
    from models.coc.scene import SIZE

    def draw(index):
        return np.full((SIZE, SIZE, 3), index, np.uint8), np.full((SIZE, SIZE), index, np.float32)

    for workers in (1, 3):
        reservoir = Reservoir(tmp_path / str(workers), capacity=7)
        fill(reservoir, draw, 7, workers)
        assert reservoir.drawn == 7
        drawn = [int(picture[0, 0, 0]) for picture in reservoir.pictures]
        assert sorted(drawn) == list(range(7)) and (workers > 1 or drawn == list(range(7)))
        np.testing.assert_allclose(reservoir.labels[:, 0, 0], drawn, rtol=1e-3)


@pytest.mark.filterwarnings("ignore:.*multi-threaded.*fork:DeprecationWarning")  # from 3.12 on
def test_worker_that_fails_ends_the_drawing(tmp_path):
    from models.coc.data import Reservoir, fill
    from models.coc.scene import SIZE

    def draw(index):
        if index == 3:
            raise SystemExit(1)
        return np.zeros((SIZE, SIZE, 3), np.uint8), np.zeros((SIZE, SIZE), np.float32)

    with pytest.raises(RuntimeError, match="a process that draws ended with code 1"):
        fill(Reservoir(tmp_path, capacity=6), draw, 6, workers=2)


def test_training_resumes_from_a_checkpoint(reservoir, resume):
    import torch

    from models.coc.batches import Batches
    from models.coc.run import Recipe, Run
    from models.coc.train import validate

    recipe = Recipe(minutes=1, crop=64, pixels=2 * 64 * 64)
    run, again = Run(recipe), Run(recipe)
    resume(run, again, Batches(reservoir.folder, None, torch.device("cpu")), 2)
    likelihood, held_out = validate(again.average, reservoir)
    assert np.isfinite(likelihood) and held_out.rmse_px > 0
    assert likelihood == validate(run.average, reservoir)[0]


@pytest.mark.slow
def test_training_is_followed_on_two_held_out_sets(reservoir):
    from argparse import Namespace

    from models.coc.run import Recipe, Run
    from models.coc.train import held_out

    run = Run(Recipe())
    folders = {"validation": reservoir.folder, "hard_validation": reservoir.folder}
    row = held_out(run, Namespace(**folders, plates=None))
    assert row["hard_nll"] == row["held_out_nll"]
    folders["hard_validation"] = None
    assert not any(
        name.startswith("hard") for name in held_out(run, Namespace(**folders, plates=None))
    )


def test_rendered_pictures_are_mixed_into_batches_once_available(reservoir, tmp_path):
    import torch

    from models.coc.batches import Batches
    from models.coc.data import Reservoir
    from models.coc.scene import SIZE

    batches = Batches(reservoir.folder, tmp_path, torch.device("cpu"))
    rng = np.random.default_rng(0)

    def rendered(count):
        _, coc = batches.draw(rng, 64, count)
        return int((coc == 7.0).all((1, 2)).sum())

    assert rendered(60) == 0
    white = np.full((SIZE, SIZE, 3), 255, np.uint8)
    Reservoir(tmp_path, capacity=2).append(white, np.full((SIZE, SIZE), 7.0, np.float32))
    assert sum(rendered(1) for _ in range(Batches.REFRESH_STEPS - 1)) == 0
    assert 2 < rendered(60) < 30


def test_crop_and_its_coc_are_turned_alike(tmp_path):
    import torch

    from models.coc.batches import Batches
    from models.coc.data import Reservoir
    from models.coc.scene import SIZE

    y, x = np.mgrid[0:SIZE, 0:SIZE] // 4
    cell = np.stack([y, x, np.full_like(y, 128)], -1).astype(np.uint8)
    Reservoir(tmp_path, capacity=1).append(cell, np.float32(np.expm1(y / 40 + x / 400)))
    batches = Batches(tmp_path, None, torch.device("cpu"))
    pictures, coc = batches.draw(np.random.default_rng(3), 96, 40)
    assert pictures.shape == (40, 3, 96, 96) and coc.shape == (40, 24, 24)
    cells = pictures[:, :2, 2::4, 2::4]
    gain = pictures[:, 2].mean((1, 2)) / (128 / 255)
    corners, orientations = set(), set()
    for (rows, columns), truth, blue in zip(cells, coc, gain, strict=True):
        assert 0.7 < blue < 1.4
        expected = torch.log1p(truth) * 40
        down = [float(part[-1, 0] - part[0, 0]) for part in (rows, columns)]
        orientations.add((abs(down[0]) > abs(down[1]), max(down) > -min(down)))
        corners.add(round(float(expected.min())))
        found = torch.stack([rows.ravel(), columns.ravel()], -1) * 255
        weights = torch.linalg.lstsq(found, expected.ravel()[:, None]).solution.ravel()
        assert weights[1] / weights[0] == pytest.approx(0.1, abs=0.06)
    assert len(orientations) == 4 and len(corners) > 15


@pytest.mark.needs_cuda
def test_replayed_steps_on_a_gpu_train_as_single_ones_do(reservoir, resume, tmp_path):
    import torch

    from models.coc.batches import Batches
    from models.coc.recorded import RecordedRun
    from models.coc.run import Recipe, Run
    from models.coc.train import validate

    recipe = Recipe(minutes=60, rate=1e-3, warm_up_steps=1, crop=64, pixels=8 * 64 * 64)
    gpu, cpu = RecordedRun(recipe), Run(recipe)
    before = validate(cpu.network, reservoir)[0]
    for run in (gpu, cpu):
        batches = Batches(reservoir.folder, None, run.device)
        for _ in range(60):
            run.advance(batches)
    for name in ("network", "average"):
        after = [validate(getattr(run, name), reservoir)[0] for run in (gpu, cpu)]
        assert after[0] == pytest.approx(after[1], abs=0.3 * (before - after[1]))
    cpu.save(tmp_path / "of_a_cpu.pt")
    gpu.load(tmp_path / "of_a_cpu.pt")
    assert torch.isfinite(gpu.advance(Batches(reservoir.folder, None, gpu.device)))
    fresh = Batches(reservoir.folder, None, gpu.device)
    resume(RecordedRun(recipe), RecordedRun(recipe), fresh, 2)


def test_training_without_pictures_names_the_folder(tmp_path):
    import torch

    from models.coc.batches import Batches

    batches = Batches(tmp_path / "nothing", None, torch.device("cpu"))
    with pytest.raises(FileNotFoundError, match="nothing: no picture there"):
        batches.draw(np.random.default_rng(0), 64, 2)


def test_deepened_network_starts_with_the_output_of_the_shallow_one(tmp_path):
    import torch

    from models.coc.network import CocNet
    from models.coc.run import Recipe, Run

    torch.manual_seed(0)
    shallow = CocNet(depths=(0, 1, 1, 1, 1))
    torch.nn.init.normal_(shallow.answer.weight, std=0.3)
    path = tmp_path / "weights.pt"
    torch.save({name: value.half() for name, value in shallow.state_dict().items()}, path)
    shallow.load_state_dict({k: v.float() for k, v in torch.load(path).items()})
    run = Run(Recipe())
    run.begin_from(path)
    picture = torch.rand(1, 3, 64, 64)
    with torch.inference_mode():
        torch.testing.assert_close(run.average(picture), shallow(picture))


@pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning")
def test_exported_coc_network_agrees_with_the_trained_one_at_any_size(tmp_path):
    import torch

    from models.coc.export import export
    from models.coc.network import CocNet, coc_and_sigma
    from nlens_video.networks.onnx_networks import OnnxCocNetwork

    torch.manual_seed(0)
    network = CocNet().eval()
    torch.nn.init.normal_(network.answer.weight, std=0.3)
    export(network, tmp_path / "coc.onnx")
    exported = OnnxCocNetwork(tmp_path / "coc.onnx")
    for shape in [(32, 32), (64, 160), (160, 96)]:
        rgb = np.random.default_rng(0).random((*shape, 3), dtype=np.float32)
        with torch.inference_mode():
            batch = torch.from_numpy(rgb).permute(2, 0, 1)[None]
            coc, sigma = (part[0].numpy() for part in coc_and_sigma(network(batch)))
        found = exported(rgb)
        assert found.coc_px.shape == (shape[0] // 4, shape[1] // 4)
        np.testing.assert_allclose(found.coc_px, coc, atol=0.02)
        np.testing.assert_allclose(found.sigma_px, sigma, atol=0.02)


def test_network_with_other_outputs_is_refused(tmp_path):
    import onnx
    from onnx import TensorProto, helper

    from nlens_video.core.errors import NlensError
    from nlens_video.networks.onnx_networks import OnnxCocNetwork

    value = [helper.make_tensor_value_info(n, TensorProto.FLOAT, [1]) for n in ("a", "b")]
    graph = helper.make_graph([helper.make_node("Abs", ["a"], ["b"])], "g", value[:1], value[1:])
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=9)
    onnx.save(model, tmp_path / "other.onnx")
    with pytest.raises(NlensError, match=r"expected \['rgb', 'coc_px', 'sigma_px'\]"):
        OnnxCocNetwork(tmp_path / "other.onnx")

import numpy as np
import pytest

pytestmark = [
    pytest.mark.needs_torch,
    pytest.mark.filterwarnings("ignore::FutureWarning", "ignore::DeprecationWarning"),
]


@pytest.fixture(scope="module")
def reservoir(photos, tmp_path_factory):
    from models.reblur.data import Reservoir, draw_maps

    store = Reservoir(tmp_path_factory.mktemp("data") / "reservoir", capacity=2)
    for index in range(2):
        store.append(draw_maps(3, index, photos, held_out=index == 1, views=8))
    return store


def test_ground_truth_blur_of_a_flat_card_has_an_edge_as_wide_as_the_disc():
    from models.reblur.lens import CROP, FINE, GRID, Shape, pinhole, through_lens

    mask = np.zeros((FINE * GRID, FINE * GRID), np.uint8)
    mask[:, : FINE * GRID // 2] = 255
    white = np.ones((GRID, GRID, 3), np.float32)
    card = Shape(mask=mask, texture=white, coc_px=12.0, slope=(0.0, 0.0))
    sharp, coc = pinhole([card])
    assert sharp[50, : GRID // 2].min() == 1.0 and not sharp[50, GRID // 2 :].any()
    assert set(np.unique(coc)) == {0.0, 12.0}
    alpha = through_lens([card], 200)[CROP // 2, :, 3]
    x = (np.arange(CROP) + 0.5 - CROP / 2) / 6.0  # in radii from the edge
    inside = np.clip(x, -1, 1)
    expected = 0.5 - (inside * np.sqrt(1 - inside**2) + np.arcsin(inside)) / np.pi
    assert alpha == pytest.approx(expected, abs=0.02)


def test_near_surface_occludes_the_far_one_from_every_aperture_sample():
    from models.reblur.lens import CROP, FINE, GRID, Shape, through_lens

    everywhere = np.full((FINE * GRID, FINE * GRID), 255, np.uint8)
    red, blue = (np.float32(np.ones((GRID, GRID, 3)) * c) for c in ((1, 0, 0), (0, 0, 1)))
    near = Shape(mask=everywhere, texture=red, coc_px=9.0, slope=(0.0, 0.0))
    far = Shape(mask=everywhere, texture=blue, coc_px=-9.0, slope=(0.0, 0.0))
    for order in ([near, far], [far, near]):
        seen = through_lens(order, 32)
        assert seen.shape == (CROP, CROP, 4) and np.all(seen == np.float32([1, 0, 0, 1]))


def test_seed_determines_an_object_of_every_category(photos):
    from models.reblur.data import draw_maps
    from models.reblur.shapes import CATEGORIES

    for index in range(len(CATEGORIES)):
        first, again = (draw_maps(1, index, photos, held_out=True, views=4) for _ in range(2))
        for name, part in first.items():
            np.testing.assert_array_equal(part, again[name])
            assert np.isfinite(part).all()
        assert first["where"].mean() > 0.01


def test_reblur_training_resumes_from_a_checkpoint(reservoir, resume):
    from models.reblur.train import Recipe, Run, validate

    recipe = Recipe(minutes=1, batch=2)
    run, again = Run(recipe), Run(recipe)
    resume(run, again, reservoir, 2)
    assert validate(again.average, reservoir) == validate(run.average, reservoir)


def test_exported_repair_network_agrees_with_the_trained_one_at_any_size(tmp_path):
    import torch

    from models.reblur.export import export
    from models.reblur.network import RepairNet
    from nlens_video.networks.onnx_networks import OnnxRepairNetwork
    from nlens_video.stages.l_depth_order import CHANNELS

    torch.manual_seed(0)
    network = RepairNet().eval()
    torch.nn.init.normal_(network.answer.weight, std=0.1)
    export(network, tmp_path / "reblur.onnx")
    exported = OnnxRepairNetwork(tmp_path / "reblur.onnx")
    for shape in [(4, 4), (64, 120), (132, 40)]:
        maps = np.random.default_rng(0).random((*shape, CHANNELS), dtype=np.float32)
        with torch.inference_mode():
            answer = network(torch.from_numpy(maps).permute(2, 0, 1)[None])[0]
        np.testing.assert_allclose(exported(maps), answer.permute(1, 2, 0).numpy(), atol=2e-3)


def test_torch_and_onnx_agree_on_the_shipped_repair_weights():
    import torch

    from models.reblur.export import HERE, load_network
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.onnx_networks import OnnxRepairNetwork
    from nlens_video.stages.l_depth_order import CHANNELS

    maps = np.random.default_rng(1).random((48, 64, CHANNELS), dtype=np.float32)
    with torch.inference_mode():
        answer = load_network(HERE / "weights.pt")(torch.from_numpy(maps).permute(2, 0, 1)[None])
    shipped = OnnxRepairNetwork(find_model("reblur").path)(maps)
    # biases are stored in half precision in the one and in single precision in the other
    np.testing.assert_allclose(shipped, answer[0].permute(1, 2, 0).numpy(), atol=1e-3)


def test_training_loss_applies_the_repair_as_the_program_does(reservoir):
    import torch

    from models.reblur.data import split_maps
    from models.reblur.network import resolve
    from models.reblur.train import to_tensors
    from nlens_video.stages.l_depth_order import Candidates

    maps = split_maps(reservoir.maps[:1])
    judgement = np.random.default_rng(2).random((*maps["where"].shape[1:3], 2), dtype=np.float32)
    names = ("scattered", "near", "back", "covariance", "geometry")
    made = Candidates(**{name: maps[name][0] for name in names})
    expected = made.resolve(judgement, maps["where"][0, ..., 0])
    batch = torch.from_numpy(judgement).permute(2, 0, 1)[None]
    found = resolve(to_tensors(maps), batch)[0].permute(1, 2, 0).clamp_min(0).numpy()
    found[..., 3] = np.minimum(found[..., 3], 1.0)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def test_papers_networks_have_the_published_sizes_and_can_be_trained(photos, tmp_path, resume):
    from models.paper.data import PARTS, draw_maps
    from models.paper.train import Recipe, Run, validate
    from models.reblur.data import Reservoir

    store = Reservoir(tmp_path / "composites", 2, PARTS)
    for index in range(2):
        store.append(draw_maps(1, index, photos, held_out=False))
    run, again = (Run(Recipe(minutes=1, batch=1)) for _ in range(2))
    assert sum(p.numel() for p in run.network.arnet.parameters()) == 923_664
    assert sum(p.numel() for p in run.network.iunet.parameters()) == 240_076
    resume(run, again, store, 2)
    assert validate(again.network, store) == validate(run.network, store)


def test_torch_and_onnx_agree_on_the_papers_shipped_weights():
    import torch

    from models.paper.export import HERE, load_networks
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.onnx_networks import OnnxPaperNetworks

    rng = np.random.default_rng(3)
    code = rng.random((48, 64, 3), dtype=np.float32)
    defocus = rng.uniform(-1, 1, (48, 64)).astype(np.float32)
    coarse = rng.random((24, 32, 3), dtype=np.float32)
    nets = load_networks(HERE / "weights.pt")
    parts = [torch.from_numpy(a).permute(2, 0, 1)[None] for a in (code, defocus[..., None], coarse)]
    with torch.inference_mode():
        rendered = nets.arnet(*parts[:2])[0].permute(1, 2, 0).numpy()
        refined = nets.iunet(*parts)[0].permute(1, 2, 0).numpy()
    shipped = OnnxPaperNetworks(find_model("paper-arnet").path, find_model("paper-iunet").path)
    picture, error = shipped.render(code, defocus)
    np.testing.assert_allclose(picture, rendered[..., :3], atol=1e-4)
    np.testing.assert_allclose(error, rendered[..., 3], atol=1e-4)
    np.testing.assert_allclose(shipped.refine(code, defocus, coarse), refined, atol=1e-4)

"""The shipped networks, and an int8 one, on input far from the training data."""

from pathlib import Path

import numpy as np
import pytest
from hard.catalogue import Outcome, at_least, at_most, case, exactly
from hard.drawing import heat, panels, srgb8
from hard.objects import folder

from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxCocNetwork, OnnxPaperNetworks, OnnxRepairNetwork
from nlens_video.stages.f_coc import LARGEST_COC_PX
from nlens_video.stages.l_depth_order import CHANNELS

SHAPE = (64, 96)


def _pictures() -> dict[str, np.ndarray]:
    """Extreme pictures (H, W, 3); all finite."""
    rng = np.random.default_rng(0)
    noise = rng.random((*SHAPE, 3))
    checks = np.indices(SHAPE).sum(axis=0)[..., None] % 2 * np.ones(3)
    return {
        "all 0": np.zeros((*SHAPE, 3)),
        "all 1": np.ones((*SHAPE, 3)),
        "noise": noise,
        "checks of one pixel": checks,
        "one white pixel": np.pad(np.ones((1, 1, 3)), ((31, 32), (47, 48), (0, 0))),
        "HDR, up to 1e4": noise**8 * 1e4,
        "below 0": -noise,
        "next to nothing": noise * 1e-38,
    }


def _read(network) -> tuple[dict[str, tuple[np.ndarray, np.ndarray]], list]:
    """What a CoC network says of each, and the figures that any must keep."""
    made, figures = {}, []
    for name, picture in _pictures().items():
        coc = network(picture.astype(np.float32))
        made[name] = (coc.coc_px, coc.sigma_px)
        finite = np.isfinite(coc.coc_px).all() and np.isfinite(coc.sigma_px).all()
        figures += [
            exactly(f"{name}: finite", str(bool(finite)), "True"),
            at_least(f"{name}: least CoC [px]", coc.coc_px.min(), 0.0),
            at_least(f"{name}: least expected error [px]", coc.sigma_px.min(), 1e-6),
        ]
        if name not in ("HDR, up to 1e4", "below 0"):  # what a display shows
            figures.append(at_most(f"{name}: largest CoC [px]", coc.coc_px.max(), LARGEST_COC_PX))
    return made, figures


def _outcome(made, figures):
    shown = {name: heat(coc, 32.0) for name, (coc, _) in made.items()}
    return Outcome(tuple(figures), lambda: panels(shown, height=70))


@case
def test_extreme_pictures_for_the_coc_network():
    """The CoC network gives numbers, never below 0, for every finite picture."""
    with OnnxCocNetwork(find_model("coc").path) as network:
        return _outcome(*_read(network))


def _int8(folder: Path) -> Path:
    """The CoC network with its weights and activations in int8, as ONNX Runtime makes them."""
    import onnxruntime
    from onnxruntime.quantization import QuantType, quantize_dynamic

    plain, path = folder / "plain.onnx", folder / "int8.onnx"
    options = onnxruntime.SessionOptions()
    options.graph_optimization_level = onnxruntime.GraphOptimizationLevel.ORT_ENABLE_BASIC
    options.optimized_model_filepath = str(plain)  # weights as plain numbers, not from float16
    onnxruntime.InferenceSession(
        find_model("coc").path, options, providers=["CPUExecutionProvider"]
    )  # fmt: skip
    quantize_dynamic(plain, path, weight_type=QuantType.QUInt8)
    return path


@pytest.mark.needs_torch  # the quantiser comes with what trains
@case
def test_coc_network_quantised_to_int8():
    """The same network quantised to 8 bits stays finite, and close on ordinary pictures."""
    with (
        folder() as place,
        OnnxCocNetwork(_int8(place)) as network,
        OnnxCocNetwork(find_model("coc").path) as plain,
    ):
        made, figures = _read(network)
        usual = np.kron(np.random.default_rng(1).random((16, 24, 3)), np.ones((4, 4, 1)))
        picture = usual.astype(np.float32)
        ours, theirs = network(picture).coc_px, plain(picture).coc_px
    off = np.abs(ours - theirs).mean()
    figures.append(at_most("ordinary picture, mean difference [px]", off, 1.5))
    return _outcome(made, figures)


@case
def test_extreme_geometry_for_the_repair_network():
    """The depth-order network's output stays within [0, 1] and [-0.5, 0.5] for any geometry."""
    network = OnnxRepairNetwork(find_model("reblur").path)
    rng = np.random.default_rng(2)
    asked = {
        "all 0": np.zeros((*SHAPE, CHANNELS)),
        "all 1": np.ones((*SHAPE, CHANNELS)),
        "all -1": -np.ones((*SHAPE, CHANNELS)),
        "noise": rng.normal(0, 1, (*SHAPE, CHANNELS)),
        "up to 1e4": rng.normal(0, 1e4, (*SHAPE, CHANNELS)),
        "next to nothing": rng.normal(0, 1e-40, (*SHAPE, CHANNELS)),
    }
    figures, shown = [], {}
    for name, geometry in asked.items():
        said = network(geometry.astype(np.float32))
        shown[name] = heat(said[..., 0], 1.0)
        figures += [
            at_least(f"{name}: least share", said[..., 0].min(), 0.0),
            at_most(f"{name}: greatest share", said[..., 0].max(), 1.0),
            at_most(f"{name}: change of coverage", np.abs(said[..., 1]).max(), 0.5),
        ]
    return Outcome(tuple(figures), lambda: panels(shown, height=70))


@case
def test_extreme_inputs_for_the_papers_networks():
    """The paper's two networks give finite numbers for extreme pictures and CoC."""
    networks = OnnxPaperNetworks(find_model("paper-arnet").path, find_model("paper-iunet").path)
    figures, shown = [], {}
    for name, picture in _pictures().items():
        code = picture.astype(np.float32)
        for coc_px in (0.0, 60.0, -60.0):
            defocus = np.full(SHAPE, coc_px / 100.0, np.float32)
            rendered, error = networks.render(code, defocus)
            refined = networks.refine(code, defocus, rendered)
            finite = all(np.isfinite(part).all() for part in (rendered, error, refined))
            if not finite:
                figures.append(exactly(f"{name}, CoC {coc_px:g} px: finite", "False", "True"))
        shown[name] = srgb8(np.clip(refined, 0, 1))
    return Outcome(
        (exactly("pictures and CoC whose answer is not finite", len(figures), 0),),
        lambda: panels(shown, height=70),
    )

"""Plates without texture, and plates of extreme contrast."""

import cv2
import numpy as np
from hard.catalogue import Outcome, at_least, at_most, case, exactly
from hard.drawing import heat, panels, srgb8
from hard.objects import LENS, PRESETS, SIZE, composited, cube, folder
from hard.quality_levels import Card, cards, lens_of_coc, sharp, through
from support import shots

from nlens_video.core.color import ColorTags
from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Box
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxCocNetwork
from nlens_video.stages.f_coc import estimate_coc
from nlens_video.video.pixels.picture import ArrayPicture

LINEAR = ColorTags(matrix="gbr", transfer="linear", primaries="bt709", full_range=True)


def _grey(code: int) -> np.ndarray:
    return np.full((SIZE[1], SIZE[0], 3), code, np.uint8)


def _noise() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (SIZE[1], SIZE[0], 3), dtype=np.uint8)


def _edge() -> np.ndarray:
    plate = _grey(40)
    plate[:, SIZE[0] // 2 :] = 210
    return plate


def _saturated() -> np.ndarray:
    """Large parts clipped to black and to white, in each channel elsewhere."""
    light = shots.plate().astype(float) - 150.0
    return np.clip(light * 4.0 + 150.0, 0, 255).astype(np.uint8)


PLATES = {
    "black": lambda: _grey(0),
    "white": lambda: _grey(255),
    "constant": lambda: _grey(119),
    "pure noise": _noise,
    "one edge": _edge,
    "saturated": _saturated,
}


def _given_lens(name: str) -> Outcome:
    """With a given lens: nothing but the object changes, in every preset."""
    plate = np.ascontiguousarray(PLATES[name]()[..., ::-1])
    with folder() as place:
        glb = cube(place / "cube.glb")
        seen = {
            preset: composited(glb, preset, LENS, plate, effects="defocus")[0] for preset in PRESETS
        }
        bare = composited(glb, "draft", LENS, plate, effects="none")[0]
    there = (bare != plate).any(axis=2).astype(np.uint8)
    near = cv2.dilate(there, np.ones((25, 25), np.uint8)) > 0  # 12 px: a CoC of 24 px
    figures = []
    for preset, picture in seen.items():
        changed = (picture != plate).any(axis=2)
        figures += [
            exactly(f"samples changed beside the object, {preset}", (changed & ~near).sum(), 0),
            at_least(f"pixels of the object, {preset}", changed.sum(), 4000),
        ]
    apart = np.abs(seen["standard"].astype(int) - seen["reference"]).mean(axis=2)[near].mean()
    figures.append(at_most("standard and reference, mean difference [codes]", apart, 1.0))
    return Outcome(
        tuple(figures), lambda: panels({p: v[..., ::-1] for p, v in seen.items()}, height=120)
    )


def _found_lens(
    name: str, coc_px: tuple[float, float] | None = None, ends: str = "LensFitError"
) -> Outcome:
    """What F reads, and how the search for a lens ends: with a CoC of the cube, or in vain."""
    plate = PLATES[name]()
    with OnnxCocNetwork(find_model("coc").path) as network:
        coc = estimate_coc(network, plate.astype(np.float32) / 255.0)
    try:
        with folder() as place:
            _, fit = composited(
                cube(place / "cube.glb"), "realtime", None, np.ascontiguousarray(plate[..., ::-1])
            )
        ended = "no lens" if fit is None else "fit"
        found = np.nan if fit is None else float(fit.coc_px(np.float32(1 / 1.6)))
    except LensFitError as error:
        assert len(str(error).splitlines()) == 1
        ended, found = "LensFitError", np.nan
    finite = np.isfinite(coc.coc_px).all() and np.isfinite(coc.sigma_px).all()
    return Outcome(
        (
            exactly("CoC and its error are numbers", str(bool(finite)), "True"),
            at_least("least CoC [px]", coc.coc_px.min(), 0.0),
            at_least("least expected error [px]", coc.sigma_px.min(), 1e-3),
            at_most("largest CoC [px]", coc.coc_px.max(), 64.0),
            exactly("the search for a lens ends with", ended,
                    ends if coc_px is None else "fit"),
            *([] if coc_px is None else [at_most("CoC of the cube, off by [px]",
                                                 abs(found - coc_px[0]), coc_px[1])]),
        ),
        lambda: panels({"plate": plate, "CoC": heat(coc.coc_px, 32.0),
                        "expected error": heat(coc.sigma_px, 32.0)}, height=120),
    )  # fmt: skip


@case
def test_black_plate_with_a_given_lens():
    """On a black plate the object stands alone, and no other sample changes."""
    return _given_lens("black")


@case
def test_white_plate_with_a_given_lens():
    """On a white plate, where nothing can get lighter, no other sample changes."""
    return _given_lens("white")


@case
def test_noise_plate_with_a_given_lens():
    """On noise of full contrast no sample beside the object changes."""
    return _given_lens("pure noise")


@case
def test_clipped_plate_with_a_given_lens():
    """On a plate clipped to black and white no sample beside the object changes."""
    return _given_lens("saturated")


@case
def test_black_plate():
    """The blur of a black plate cannot be measured: no lens is found, no object is shown."""
    return _found_lens("black", ends="no lens")


@case
def test_white_plate():
    """The blur of a white plate cannot be measured: no lens is found, no object is shown."""
    return _found_lens("white", ends="no lens")


@case
def test_grey_plate():
    """The blur of a grey plate cannot be measured: no lens is found, no object is shown."""
    return _found_lens("constant", ends="no lens")


@case
def test_plate_of_pure_noise():
    """Pure noise is measured as sharp everywhere, so the object is in focus, too.

    Below 1.5 px the network cannot distinguish defocus from the softness of a lens.
    """
    return _found_lens("pure noise", (0.0, 1.0))


@case
def test_plate_with_a_single_edge():
    """A single sharp edge shows no blur of the ground: the fit ends with an error of one line."""
    return _found_lens("one edge")


@case
def test_clipped_plate():
    """With contrast fourfold and most of the plate clipped, the rest is enough to fit the lens."""
    return _found_lens("saturated", (shots.SLOPE / 1.6 + shots.INTERCEPT, 1.5))


@case
def test_light_above_one_and_below_zero():
    """Linear light from -0.5 to 60 keeps its bits beside the object and mixes in under its rim."""
    rng = np.random.default_rng(4)
    light = rng.uniform(-0.5, 1.5, (88, 112, 3)).astype(np.float32)
    light[20:40, 30:50] = 60.0
    scene = cards(Card(2.0))
    layer = through("realtime", scene, lens_of_coc(9.0, 2.0))
    plate = light.copy()
    ArrayPicture(plate, "rgb", LINEAR).composite_over(Box(0, 0, 112, 88), layer)
    exact = layer[..., :3] + (1.0 - layer[..., 3:]) * light.astype(np.float64)
    touched = layer.any(axis=2)
    off = np.abs(plate - exact) / (1.0 + np.abs(exact))
    back = ArrayPicture(light.copy(), "rgb", LINEAR).linear(Box(0, 0, 112, 88))
    return Outcome(
        (
            exactly("samples changed beside the object", (plate != light)[~touched].sum(), 0),
            at_most("composite, off by a share of", off[touched].max(), 2e-5),
            at_most("decoding and coding back, off by", np.abs(back - light).max(), 1e-5),
            at_least("pixels of the object", sharp(scene)[..., 3].sum(), 1000),
        ),
        lambda: panels({"plate / 4": _shade(light), "composite / 4": _shade(plate)}),
    )


def _shade(light: np.ndarray) -> np.ndarray:
    return srgb8(light / 4.0)

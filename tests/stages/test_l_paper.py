import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.definitions import paper_scatter_by_pixels

from nlens_video.core.layers import Box, DefocusedLayer, ObjectLayer
from nlens_video.kernels.scatter.paper_scatter import paper_scatter
from nlens_video.networks import onnx_networks
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxPaperNetworks
from nlens_video.stages.l_paper import (
    GAMMA,
    PaperReblur,
    level_sizes,
    paper_reblur,
)
from nlens_video.video.pixels.picture import ArrayPicture

FRAME = Box(0, 0, 128, 96)
BOX = Box(40, 30, 90, 70)


@pytest.fixture(scope="module")
def networks():
    return OnnxPaperNetworks(find_model("paper-arnet").path, find_model("paper-iunet").path)


@pytest.mark.slow
@settings(max_examples=15)
@given(seed=st.integers(0, 10**6), height=st.integers(1, 21), width=st.integers(1, 21))
def test_classical_renderer_is_the_papers_formula(seed, height, width):
    rng = np.random.default_rng(seed)
    light = rng.random((height, width, 3), dtype=np.float32)
    radius = np.float32(rng.choice([0.0, 0.4, 1.7, 6.2], (height, width)))
    found, dilated = paper_scatter(light, radius)
    true, true_dilated = paper_scatter_by_pixels(light, radius)
    assert found == pytest.approx(true, abs=1e-3)  # tanh from a table
    assert dilated == pytest.approx(true_dilated)


def test_paper_scatter_is_bit_identical_on_any_number_of_threads():
    rng = np.random.default_rng(1)
    light, radius = rng.random((70, 40, 3), dtype=np.float32), np.full((70, 40), 5.5, np.float32)
    one, three = (paper_scatter(light, radius, threads=n) for n in (1, 3))
    assert np.array_equal(one[0], three[0]) and np.array_equal(one[1], three[1])


def test_invalid_radii_are_refused():
    light = np.zeros((4, 4, 3), np.float32)
    for bad in (-1.0, np.nan):
        with pytest.raises(ValueError, match="finite and not negative"):
            paper_scatter(light, np.full((4, 4), bad, np.float32))


def test_network_resolution_starts_at_radius_ten_and_doubles_to_full_size():
    assert level_sizes((90, 160), 0.0) == [(90, 160)]
    assert level_sizes((90, 160), 10.0) == [(90, 160)]
    assert level_sizes((90, 160), 10.1) == [(45, 80), (90, 160)]
    assert level_sizes((90, 160), 30.0) == [(23, 40), (45, 80), (90, 160)]


class Plain:
    """Networks that blur nothing and are sure of it where they are told to be."""

    def __init__(self, error):
        self.error = error

    def render(self, code, defocus):
        return code, np.full(defocus.shape, self.error, np.float32)

    def refine(self, code, defocus, coarse):
        return code


def composite(coc=12.0):
    rng = np.random.default_rng(2)
    light = cv2.GaussianBlur(rng.random((96, 128, 3), dtype=np.float32), (0, 0), 1.0)
    radius = np.zeros((96, 128), np.float32)
    radius[30:70, 40:90] = coc
    return light, radius


@pytest.mark.parametrize("coc", [-18.0, 6.0, 50.0])
def test_error_map_blends_the_classical_and_the_neural_picture(coc):
    light, coc_px = composite(coc)
    classical, _ = paper_scatter(light, np.abs(0.5 * coc_px))
    trusted = paper_reblur(light, coc_px, paper_scatter, Plain(0.0))
    assert trusted == pytest.approx(classical, abs=1e-5)
    neural = paper_reblur(light, coc_px, paper_scatter, Plain(1.0))
    if abs(coc) <= 20:
        assert neural == pytest.approx(light, abs=1e-5)
    half = paper_reblur(light, coc_px, paper_scatter, Plain(0.5))
    between = (0.5 * (trusted ** (1 / GAMMA) + neural ** (1 / GAMMA))) ** GAMMA
    assert half == pytest.approx(between, abs=1e-4)


def test_light_above_white_is_kept(networks):
    light, coc_px = composite()
    bright = light.copy()
    bright[50, 60] = 40.0
    without, blurred = (
        paper_reblur(picture, coc_px, paper_scatter, networks) for picture in (light, bright)
    )
    assert np.isfinite(blurred).all()
    assert (blurred - without)[50, 60].min() > 0.6 * 40 / (np.pi * 6**2)  # spread over its disc


def sharp(coc=10.0):
    rgba = np.zeros((BOX.height, BOX.width, 4), np.float32)
    rgba[4:-4, 4:-4] = (0.5, 0.3, 0.1, 1.0)
    depth = np.where(rgba[..., 3] > 0, np.float32(1), np.float32(np.inf))
    coc_px = np.where(rgba[..., 3] > 0, np.float32(coc), np.float32(0))
    return DefocusedLayer(layer=ObjectLayer(box=BOX, rgba=rgba, depth=depth), coc_px=coc_px)


def test_plate_is_unchanged_out_of_the_objects_reach(networks):
    plate = np.random.default_rng(3).integers(0, 256, (96, 128, 3), dtype=np.uint8)
    picture = ArrayPicture(plate.copy(), "rgb")
    stage = PaperReblur(scatter=paper_scatter, networks=networks)
    layer = stage(picture, sharp(), FRAME)
    assert set(np.unique(layer.rgba[..., 3])) == {0.0, 1.0}
    picture.composite_over(layer.box, layer.rgba)
    reach = Box(44, 34, 86, 66).expanded(10).slices_in(FRAME)
    outside = np.ones((96, 128), bool)
    outside[reach] = False
    assert np.array_equal(picture.array[outside], plate[outside])
    assert (picture.array[reach] != plate[reach]).any(axis=-1).mean() > 0.5


def test_object_out_of_the_frame_gives_an_empty_layer(networks):
    stage = PaperReblur(scatter=paper_scatter, networks=networks)
    far = DefocusedLayer(
        layer=ObjectLayer(
            box=Box(300, 300, 350, 340), rgba=sharp().layer.rgba, depth=sharp().layer.depth
        ),
        coc_px=sharp().coc_px,
    )
    picture = ArrayPicture(np.zeros((96, 128, 3), np.uint8), "rgb")
    assert stage(picture, far, FRAME).box.empty


def test_processing_in_strips_leaves_no_seam_at_any_size(networks, monkeypatch):
    rng = np.random.default_rng(4)
    code = rng.random((95, 61, 3), dtype=np.float32)
    defocus = rng.uniform(-1, 1, (95, 61)).astype(np.float32)
    coarse = rng.random((48, 31, 3), dtype=np.float32)
    whole = (*networks.render(code, defocus), networks.refine(code, defocus, coarse))
    monkeypatch.setattr(onnx_networks, "STRIP_ROWS", 32)
    strips = (*networks.render(code, defocus), networks.refine(code, defocus, coarse))
    for one, other in zip(whole, strips, strict=True):
        assert other == pytest.approx(one, abs=2e-5)

import time

import numpy as np
import pytest
from support import lens_truth

from nlens_video.core.errors import NlensError
from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    DefocusedLayer,
    HiddenLayer,
    ObjectLayer,
)
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxRepairNetwork
from nlens_video.stages import l_depth_order
from nlens_video.stages.l_depth_order import CELL, CHANNELS, RepairDepthOrder
from nlens_video.stages.l_reblur import ReblurLayer

FRAME = Box(0, 0, 400, 320)
BOX = Box(100, 60, 240, 200)
FAR = lens_truth.Slab(corners=(8.3, 8.3, 131.6, 131.6), coc_px=-14.0, seed=1.0)
NEAR = lens_truth.Slab(corners=(40.4, 36.2, 90.7, 104.9), coc_px=3.0, slope=(0.03, 0.02), seed=2.0)


@pytest.fixture(scope="module")
def network():
    return OnnxRepairNetwork(find_model("reblur").path)


@pytest.fixture
def repair(network):
    return RepairDepthOrder(network=network, scatter=scatter, reach=blur_reach)


def defocused(slabs, box=BOX, light=1.0):
    rgba, coc = lens_truth.pinhole(slabs, (box.height, box.width))
    rgba[..., :3] *= light
    depth = np.where(rgba[..., 3] > 0, np.float32(1), np.float32(np.inf))
    return DefocusedLayer(layer=ObjectLayer(box=box, rgba=rgba, depth=depth), coc_px=coc)


def scattered(sharp, frame=FRAME):
    return ReblurLayer(scatter=scatter, reach=blur_reach)(sharp, frame)


def moved(slab, by):
    x0, y0, x1, y1 = slab.corners
    gx, gy = slab.slope
    coc = slab.coc_px - gx * by
    return lens_truth.Slab(
        corners=(x0 + by, y0, x1 + by, y1), coc_px=coc, slope=(gx, gy), seed=slab.seed
    )


def rod(x, coc_px):
    return lens_truth.Slab(corners=(x, 12.0, x + 5.4, 128.0), coc_px=coc_px, seed=x)


def no_network(geometry):
    raise AssertionError("what lies behind is known: nothing is left to judge")


SCENES = {
    "sharp over blurred": [FAR, NEAR],
    "blurred over sharp": [
        lens_truth.Slab(corners=FAR.corners, coc_px=0.5, seed=1.0),
        lens_truth.Slab(corners=NEAR.corners, coc_px=16.0, seed=2.0),
    ],
    "rods before a wall": [FAR, *(rod(x, 2.0) for x in (24.6, 50.2, 77.7, 101.3))],
    "both tilted": [
        lens_truth.Slab(corners=FAR.corners, coc_px=-12, slope=(0.05, 0.02), seed=1.0),
        lens_truth.Slab(corners=NEAR.corners, coc_px=10, slope=(0.05, -0.03), seed=2.0),
    ],
}
LEAST_GAIN_DB = {  # strong texture goes on behind every edge, and nobody can know it
    "sharp over blurred": 2.5,
    "blurred over sharp": 1.5,
    "rods before a wall": 5.0,
    "both tilted": 1.5,
}


@pytest.mark.slow
@pytest.mark.parametrize("scene", SCENES)
def test_repair_network_is_closer_to_a_sampled_lens_than_scatter(repair, scene):
    sharp = defocused(SCENES[scene])
    before = scattered(sharp)
    after = repair(sharp, before)
    truth = lens_truth.lens(SCENES[scene], (BOX.height, BOX.width), views=256)
    inside = BOX.slices_in(before.box)
    gain = lens_truth.psnr_over_plate(after.rgba[inside], truth) - lens_truth.psnr_over_plate(
        before.rgba[inside], truth
    )
    assert gain > LEAST_GAIN_DB[scene]


@pytest.mark.slow
def test_object_without_a_depth_discontinuity_is_returned_unchanged(repair):
    sharp = defocused([FAR])
    before = scattered(sharp)
    assert repair(sharp, before) is before


def test_pixels_out_of_reach_of_a_discontinuity_keep_the_scatters_bits(repair):
    sharp = defocused([FAR, NEAR])
    before = scattered(sharp)
    after = repair(sharp, before)
    far_off = np.ones(before.rgba.shape[:2], bool)
    reach = Box(140, 96, 191, 165).expanded(14).slices_in(before.box)
    far_off[reach] = False
    assert np.array_equal(before.rgba[far_off], after.rgba[far_off])
    assert not np.array_equal(before.rgba[reach], after.rgba[reach])


@pytest.mark.slow
def test_repair_is_linear_in_light_and_does_not_clip(repair):
    one, ten = (defocused([FAR, NEAR], light=light) for light in (1.0, 10.0))
    dim, bright = (repair(sharp, scattered(sharp)) for sharp in (one, ten))
    assert bright.rgba[..., :3].max() > 3.0
    assert bright.rgba[..., :3] == pytest.approx(10.0 * dim.rgba[..., :3], rel=1e-4, abs=1e-4)
    assert bright.rgba[..., 3] == pytest.approx(dim.rgba[..., 3], abs=1e-5)


def test_repaired_alpha_stays_in_range_and_light_is_not_negative(repair):
    for slabs in SCENES.values():
        sharp = defocused(slabs)
        after = repair(sharp, scattered(sharp)).rgba
        assert after.min() >= 0.0 and after[..., 3].max() <= 1.0


def test_repair_in_a_smaller_frame_agrees_where_both_see_the_object(repair):
    sharp = defocused([FAR, NEAR])
    whole = repair(sharp, scattered(sharp))
    frame = Box(0, 0, 170, 140)  # its corner cuts the object, and the region around the step
    before = scattered(sharp, frame)
    part = repair(sharp, before)
    assert part.box == before.box
    common = whole.box.intersection(part.box)
    seen = part.rgba[common.slices_in(part.box)]
    # what is hidden is filled from means of the region at hand: half a code value
    assert seen == pytest.approx(whole.rgba[common.slices_in(whole.box)], abs=2e-3)


def test_repair_of_an_object_shifted_by_64_px_is_shifted(repair):
    pictures = []
    for shift in (0, 64):
        box = Box(BOX.x0 + shift, BOX.y0 + shift, BOX.x1 + shift, BOX.y1 + shift)
        sharp = defocused([FAR, NEAR], box)
        pictures.append(repair(sharp, scattered(sharp)).rgba)
    assert pictures[1] == pytest.approx(pictures[0], abs=2e-6)


@pytest.mark.slow
def test_repair_does_not_flicker_while_the_object_slides(repair):
    pictures, before = [], []
    for step in range(24):
        sharp = defocused([FAR, moved(NEAR, 0.1 * step)])
        blurred = scattered(sharp)
        before.append(blurred.rgba)
        pictures.append(repair(sharp, blurred).rgba)

    # Edges enter the scatter's own pixels one by one. The repair is about as smooth as that, save
    # for a pixel at a corner.
    rough, rougher = (np.abs(np.diff(frames, n=2, axis=0)) for frames in (before, pictures))
    for share in (0.99, 0.999):
        assert np.quantile(rougher, share) < 1.3 * np.quantile(rough, share)
    assert rougher.max() < 2.0 * rough.max()


@pytest.mark.slow
def test_repair_does_not_flicker_while_a_discontinuity_appears(repair):
    frames = []
    for near in np.linspace(1.2, 6.0, 49):
        slabs = [
            lens_truth.Slab(corners=FAR.corners, coc_px=1.0, seed=1.0),
            lens_truth.Slab(corners=NEAR.corners, coc_px=near, seed=2.0),
        ]
        sharp = defocused(slabs)
        blurred = scattered(sharp)
        frames.append(repair(sharp, blurred).rgba[BOX.slices_in(blurred.box)])
    assert np.abs(np.diff(frames, n=2, axis=0)).max() < 0.05


def test_repair_network_does_not_depend_on_the_crop(network):
    rng = np.random.default_rng(0)
    maps = rng.random((96, 112, CHANNELS), dtype=np.float32)
    whole, part = network(maps), network(np.ascontiguousarray(maps[8:80, 12:104]))
    assert part[24:-24, 24:-24] == pytest.approx(whole[32:56, 36:80], abs=1e-5)


def test_regions_that_are_not_multiples_of_the_cell_are_refused(network):
    with pytest.raises(ValueError, match="multiples of 4"):
        network(np.zeros((CELL + 1, CELL, CHANNELS), np.float32))


def test_repair_of_a_layer_out_of_the_frame_is_empty(repair):
    sharp = defocused([FAR, NEAR])
    nothing = BlurredLayer(box=Box(0, 0, 0, 0), rgba=np.zeros((0, 0, 4), np.float32))
    assert repair(sharp, nothing) is nothing


def test_weights_of_another_network_are_refused():
    with pytest.raises(NlensError, match="expected"):
        OnnxRepairNetwork(find_model("coc").path)


def three_behind_each_other(near_coc, middle_coc, far_coc):
    """Three upright stripes' surfaces, with the second one known, and the middle one's columns."""
    box, ends = Box(100, 60, 290, 180), (90, 106, 160)  # each is hidden left of the nearer's end
    column = np.broadcast_to(np.arange(box.width), (box.height, box.width))
    rows = (np.arange(box.height) >= 30) & (np.arange(box.height) < 90)
    colours = np.float32([[0.8, 0.2, 0.1, 1.0], [0.1, 0.7, 0.2, 1.0], [0.2, 0.1, 0.9, 1.0]])
    cocs = np.float32([near_coc, middle_coc, far_coc])
    at = np.searchsorted(ends, column, side="right")  # 3 where nothing is
    covered = (at < 3) & (column >= 30) & rows[:, None]
    hides = covered & (at < 2)
    first, second = np.minimum(at, 2), np.minimum(at + 1, 2)
    front = colours[first] * covered[..., None]
    behind = HiddenLayer(
        box=box, rgba=colours[second] * hides[..., None], coc_px=cocs[second] * hides,
        front_rgba=front,
    )  # fmt: skip
    layer = ObjectLayer(box=box, rgba=front, depth=np.ones_like(cocs[first]))
    sharp = DefocusedLayer(layer=layer, coc_px=cocs[first] * covered, behind=behind)
    return sharp, slice(box.x0 + 94, box.x0 + 102)


@pytest.mark.parametrize(("cocs", "ordered"), [((84, 60, 20), False), ((27, 18, 9), True)])
def test_surface_cut_between_two_layers_is_ordered_under_small_discs_alone(cocs, ordered):
    sharp, columns = three_behind_each_other(*cocs)
    before = scattered(sharp, Box(0, 0, 400, 240))
    in_order = RepairDepthOrder(network=no_network, scatter=scatter, reach=blur_reach)
    after = in_order(sharp, before)
    change = np.abs(after.rgba - before.rgba)
    rows = slice(110, 130)  # the cut runs down the middle of the second surface
    across = change[rows.start - before.box.y0 : rows.stop - before.box.y0]
    middle = across[:, columns.start - before.box.x0 : columns.stop - before.box.x0]
    assert change.max() > 0.05
    assert (middle.max() > 0.05) if ordered else (middle.max() < 1e-6)


def test_large_discs_over_a_thin_part_behind_them_show_no_specks(monkeypatch):
    height, width = 200, 260
    y, x = np.indices((height, width))
    front = np.float32([0.8, 0.7, 0.6, 1.0]) * (x < 130)[..., None]
    leans = (np.abs(x - 122 - 0.3 * (y - 100)) < 4) & (y > 50) & (y < 150)
    thin = np.float32([0.8, 0.2, 0.1, 1.0]) * leans[..., None]
    box, behind = Box(100, 60, 100 + width, 60 + height), np.full((height, width), 20.0, np.float32)
    sharp = DefocusedLayer(
        layer=ObjectLayer(box=box, rgba=np.where(x[..., None] < 130, front, thin), depth=behind),
        coc_px=np.where(x < 130, np.float32(56.0), behind),
        behind=HiddenLayer(
            box=box, rgba=thin * (x < 130)[..., None], coc_px=behind, front_rgba=front
        ),
    )
    in_order = RepairDepthOrder(network=no_network, scatter=scatter, reach=blur_reach)
    blurred = scattered(sharp, Box(0, 0, 500, 400))
    found = in_order(sharp, blurred).rgba
    monkeypatch.setattr(l_depth_order, "POINTS", (256,))
    assert np.abs(found - in_order(sharp, blurred).rgba).max() < 0.04  # 0.08 by 16 points


def test_layers_of_a_photograph_are_scattered_one_after_the_other(network, monkeypatch):
    """Each takes several times the memory of its layer meanwhile."""
    monkeypatch.setattr(l_depth_order, "_BESIDE_PX", 1000)
    running, at_once = [], []

    def counted(*layer, **options):
        running.append(1)
        time.sleep(0.1)
        at_once.append(len(running))
        made = scatter(*layer, **options)
        running.pop()
        return made

    sharp = defocused(SCENES["both tilted"])
    RepairDepthOrder(network=network, scatter=counted, reach=blur_reach)(sharp, scattered(sharp))
    assert at_once == [1, 1]

"""How far beyond the frame the object is looked for and rendered."""

import numpy as np
import pytest
from support.glb_builder import QUAD, QUAD_FACES, GlbBuilder

from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Shutter
from nlens_video.effects.shadow.cast import blur_margin
from nlens_video.graph.base.object_source import RenderedObject
from nlens_video.graph.base.view import View, bounds_near_frame
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene

WIDTH, HEIGHT, DEPTH, FOCAL = 320, 180, 2.0, 200.0


class Margins:
    """Stands in for a renderer and notes how far beyond the frame it is to draw."""

    def __init__(self):
        self.asked = []

    def render(self, time_s, camera, margin, *, plate_light=None):
        self.asked.append(margin)


def card_above(path, rows, pixel_aspect=1.0):
    """A card of 20 rows whose middle lies so many rows above the frame's top."""
    builder = GlbBuilder()
    up = (rows + HEIGHT / 2) * DEPTH / FOCAL
    mesh = builder.mesh((QUAD * 10.0 * DEPTH / FOCAL).astype(np.float32), QUAD_FACES)
    builder.node(mesh=mesh, translation=[0.0, up, -DEPTH])
    builder.node(camera=builder.camera(2.0 * np.arctan(HEIGHT / 2 / FOCAL)))
    scene = Scene.load(builder.write(path))
    return scene, View(width=WIDTH, height=HEIGHT, pixel_aspect=pixel_aspect)


@pytest.mark.parametrize(("pixel_aspect", "rows"), [(1.0, 300.0), (2.0, 500.0)])
def test_object_within_reach_of_the_largest_disc_is_not_out_of_view(tmp_path, pixel_aspect, rows):
    scene, view = card_above(tmp_path / "card.glb", rows, pixel_aspect)
    assert bounds_near_frame(scene, view, 0.0) is not None
    far, _ = card_above(tmp_path / "far.glb", 2.5 * rows)
    assert bounds_near_frame(far, view, 0.0) is None


def test_object_far_out_half_way_counts_where_it_is_in_view_while_the_shutter_is_open(tmp_path):
    builder = GlbBuilder()
    mesh = builder.mesh((QUAD * 10.0 * DEPTH / FOCAL).astype(np.float32), QUAD_FACES)
    node = builder.node(mesh=mesh)
    builder.node(camera=builder.camera(2.0 * np.arctan(HEIGHT / 2 / FOCAL)))
    columns = np.array([-700.0, 0.0])  # of the frame's middle, in a fiftieth of a second
    way = np.stack([columns * DEPTH / FOCAL, 0.0 * columns, 0.0 * columns - DEPTH], axis=1)
    builder.animation((node, "translation", [0.0, 0.02], way, "LINEAR"))
    scene = Scene.load(builder.write(tmp_path / "passes.glb"))
    bounds = bounds_near_frame(scene, View(width=WIDTH, height=HEIGHT, frame_s=0.04), 0.0)
    assert bounds is not None and bounds.box.x1 < -500
    assert bounds_near_frame(scene, View(width=WIDTH, height=HEIGHT, frame_s=0.01), 0.0) is None


@pytest.mark.parametrize(("pixel_aspect", "margin"), [(1.0, 251), (2.0, 501)])
def test_margin_of_a_disc_counts_its_rows_where_pixels_are_wide(tmp_path, pixel_aspect, margin):
    scene, view = card_above(tmp_path / "card.glb", 0.0, pixel_aspect)
    renderer = Margins()
    source = RenderedObject(scene=scene, view=view, renderer=renderer)
    fit = LensFit(slope=0.0, intercept=500.0, width=WIDTH, height=HEIGHT)
    source.render(source.locate(0, 0.0), fit)
    assert renderer.asked == [margin]


@pytest.mark.parametrize(("pixel_aspect", "margin"), [(1.0, 250), (2.0, 500)])
def test_shadow_is_cast_as_far_beyond_the_frame_as_its_blur_has_rows(pixel_aspect, margin):
    camera = Camera.from_yfov(np.eye(4), 0.8, WIDTH, HEIGHT, pixel_aspect)
    assert blur_margin(500.0, camera) == margin
    assert blur_margin(5000.0, camera) < 5000.0


@pytest.mark.parametrize(("path", "shorter"), [("scale", True), ("translation", False)])
def test_shutter_closes_where_a_part_appears_and_stays_where_one_jumps_unseen(
    tmp_path, path, shorter
):
    builder = GlbBuilder()
    mesh = builder.mesh((0.1 * QUAD).astype(np.float32), QUAD_FACES)
    builder.node(mesh=mesh, translation=[0, 0, -DEPTH])
    hidden = builder.node(mesh=mesh, translation=[0, 0, -DEPTH], scale=[0, 0, 0])
    keys = {"scale": [[0, 0, 0], [1, 1, 1]], "translation": [[0, 0, -DEPTH], [0.2, 0, -DEPTH]]}
    builder.animation((hidden, path, [0.0, 1.005], keys[path], "STEP"))
    builder.node(camera=builder.camera(2.0 * np.arctan(HEIGHT / 2 / FOCAL)))
    scene = Scene.load(builder.write(tmp_path / "appears.glb"))
    source = RenderedObject(scene=scene, view=View(width=WIDTH, height=HEIGHT), renderer=None)
    shutter = Shutter(angle_deg=360.0, frame_s=0.04)
    assert (source.shutter_at(shutter, 1.0) != shutter) is shorter

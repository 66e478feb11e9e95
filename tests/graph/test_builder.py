"""A graph of the shipped pipelines, run node by node on a small shot."""

import numpy as np
import pytest
from support import shots

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    CocMap,
    ObjectLayer,
)
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.planner import decide
from nlens_video.graph.base.context import NodeContext
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import ScreenBounds
from nlens_video.graph.builder import build
from nlens_video.graph.executor import GraphExecutor
from nlens_video.graph.pipeline_file import load_pipeline
from nlens_video.video.pixels.picture import ArrayPicture

BOX = Box(200, 120, 260, 180)
FIT = LensFit(slope=shots.SLOPE, intercept=shots.INTERCEPT, width=shots.WIDTH, height=shots.HEIGHT)


class Slab:
    """An object source of a flat square, with a second one half as far behind its left half."""

    description = "a slab"

    def __init__(self, near=1.2, far=1.2, visible=lambda index: True):
        self.near, self.far, self.visible = near, far, visible

    def locate(self, index, time_s):
        if not self.visible(index):
            return None
        return ScreenBounds(
            time_s=time_s, camera=shots.camera(), box=BOX, nearest=self.near, farthest=self.far
        )

    def footprint(self, time_s):
        square = np.array([[-0.2, 0, -1.5], [0.2, 0, -1.5], [0.2, 0, -1.9], [-0.2, 0, -1.9]])
        return square[[[0, 1, 2], [0, 2, 3]]]

    def render(self, placement, fit):
        depth = np.full((60, 60), self.near, np.float32)
        depth[:, :30] = self.far
        rgba = np.ones((60, 60, 4), np.float32) * np.float32([0.3, 0.2, 0.1, 1])
        return ObjectLayer(box=BOX, rgba=rgba, depth=depth)


class Frame:
    def __init__(self, index):
        self.index = self.number = index
        self.time_s = index / 25
        self.picture = ArrayPicture(shots.plate().copy(), "rgb")


def exact_coc(picture, following):
    disparity = np.maximum(shots.camera().plane_disparity(0.0), 0.12)
    coc = np.abs(shots.SLOPE * disparity + shots.INTERCEPT).astype(np.float32)
    return CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.5))


def steps(preset="standard", effects="auto", fit=None, **tools):
    context = NodeContext(
        **{
            "objects": Slab(), "estimate_coc": exact_coc, "ground_y": None,
            "fallback_constant": False, "pixel_aspect": 1.0, **tools,
        }
    )  # fmt: skip
    graph = build(load_pipeline(preset), decide(effects), context, fit_given=fit is not None)
    executor = GraphExecutor(graph, Profiler(), fit)
    return executor, executor.shot


def run(runner, index):
    state = runner.begin_frame(Frame(index))
    return runner.run(state, runner.graph.nodes)


def ran(runner, state):
    return set(runner.profiler.close_frame(state.frame.index, 0).nodes)


@pytest.mark.parametrize("preset", ["standard", "realtime"])
def test_fit_is_estimated_once_and_used_on_every_later_frame(preset):
    runner, shot = steps(preset)
    first, second = run(runner, 0), run(runner, 1)
    assert first.fitted_here and not second.fitted_here
    assert {"estimate-coc", "ground-footprint", "fit", "reblur"} <= ran(runner, first)
    assert not {"estimate-coc", "ground-footprint", "fit"} & ran(runner, second)
    assert first.values.fit is second.values.fit
    assert runner.fit.slope == pytest.approx(shots.SLOPE, rel=0.03)
    assert shot.found_lens.regression.fit is runner.fit


@pytest.mark.parametrize("kept", [False, True])
def test_maps_that_the_lens_is_found_from_are_freed_unless_a_report_shows_them(kept):
    runner, shot = steps()
    shot.keeps_maps = kept
    first = run(runner, 0)
    assert first.fitted_here and shot.found_lens is not None
    assert first.values.plate_coc is first.values.ground is None
    assert (shot.plate_coc is not None, shot.ground is not None) == (kept, kept)


def test_saved_fit_reproduces_edge_parallax():
    runner, _ = steps()
    first = run(runner, 0)
    assert "edge-parallax" in ran(runner, first) and runner.fit.ground_seen
    given, _ = steps(fit=LensFit.from_json(runner.fit.to_json()))
    again = run(given, 0)
    assert np.array_equal(again.values.blurred.rgba, first.values.blurred.rgba)


def test_fit_waits_for_the_first_frame_with_the_object_in_view():
    runner, _ = steps(objects=Slab(visible=lambda index: index >= 2))
    states = [run(runner, index) for index in range(4)]
    assert [state.fitted_here for state in states] == [False, False, True, False]
    assert ran(runner, states[0]) == {"object-bounds"}
    assert runner.fit.frame == 2


def test_given_fit_removes_the_estimating_nodes_from_the_graph():
    runner, _ = steps(fit=FIT)
    assert not {"estimate-coc", "ground-footprint", "fit"} & {
        node.name for node in runner.graph.nodes
    }
    assert ("fit", "the lens fit is given") in runner.graph.left_out
    assert "reblur" in ran(runner, run(runner, 0))


def test_object_in_focus_is_not_reblurred():
    runner, _ = steps(objects=Slab(near=2.0, far=2.0), fit=FIT)
    nodes = ran(runner, run(runner, 0))
    assert "reblur" not in nodes and "composite" in nodes


class Resting(Slab):
    """A slab that comes nearer on frame 2 and rests on the others; its layer may be kept."""

    def __init__(self, *, kept):
        super().__init__()
        self.kept, self.drawn = kept, {}

    def render(self, placement, fit):
        self.near = 1.2 if placement.time_s < 2 / 25 else 1.1
        if self.near not in self.drawn or not self.kept:
            self.drawn[self.near] = super().render(placement, fit)
        return self.drawn[self.near]


@pytest.mark.parametrize("preset", ["draft", "standard"])
def test_an_object_that_rests_is_blurred_once_and_looks_as_if_it_were_blurred_on_each_frame(preset):
    kept, redrawn = (steps(preset, objects=Resting(kept=one), fit=FIT)[0] for one in (True, False))
    seen = [run(kept, index).values for index in range(4)]
    drawn_again = [run(redrawn, index).values for index in range(4)]
    each = [values.defocused for values in seen]
    assert each[0] is each[1] and each[1] is not each[2] and each[2] is each[3]
    assert len({id(values.defocused) for values in drawn_again}) == 4
    for one, other in zip(seen, drawn_again, strict=True):
        assert np.array_equal(one.blurred.rgba, other.blurred.rgba)
    assert not np.array_equal(seen[1].blurred.rgba, seen[2].blurred.rgba)


def test_effects_none_builds_no_defocus_node():
    runner, _ = steps(effects="none")
    assert {node.name for node in runner.graph.nodes} == {
        "object-bounds",
        "render",
        "crop-sharp",
        "composite",
    }
    assert isinstance(run(runner, 0).values.blurred, BlurredLayer)


def test_plate_pixels_out_of_the_blurs_reach_are_unchanged():
    runner, _ = steps(fit=FIT)
    state = run(runner, 0)
    reach = BOX.expanded(12)
    before, after = shots.plate(), state.frame.picture.array
    outside = np.ones(before.shape[:2], bool)
    outside[reach.y0 : reach.y1, reach.x0 : reach.x1] = False
    assert np.array_equal(before[outside], after[outside])
    assert (before[~outside] != after[~outside]).mean() > 0.5


def test_repair_network_runs_after_the_scatter_and_only_on_depth_discontinuities():
    calls = []

    def network(defocused, blurred):
        calls.append(defocused.largest_step_px)
        return BlurredLayer(box=blurred.box, rgba=0 * blurred.rgba)

    runner, _ = steps(objects=Slab(near=1.2, far=3.0), fit=FIT, repair=network)
    state = run(runner, 0)
    assert calls and calls[0] > 2 and not state.values.blurred.rgba.any()
    flat, _ = steps(objects=Slab(), fit=FIT, repair=network)
    run(flat, 0)
    assert len(calls) == 1


def test_plan_without_a_repair_network_states_that_scatter_is_used():
    runner, _ = steps(fit=FIT)
    assert "scatter" in dict(runner.graph.left_out)["depth-order"]


def unknowing(picture, following):
    coc = np.full((shots.HEIGHT, shots.WIDTH), 9.0, np.float32)
    return CocMap(coc_px=coc, sigma_px=np.full_like(coc, 40.0))


def test_unusable_coc_estimate_is_an_error_unless_the_constant_fallback_is_allowed():
    runner, _ = steps(estimate_coc=unknowing)
    with pytest.raises(LensFitError):
        run(runner, 0)
    runner, shot = steps(estimate_coc=unknowing, fallback_constant=True)
    run(runner, 0)
    assert (runner.fit.slope, runner.fit.intercept) == (0.0, -9.0)
    assert "constant CoC" in shot.found_lens.warning

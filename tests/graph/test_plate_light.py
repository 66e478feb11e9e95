"""Light estimated from the plate is a value of the graph and not a state of the renderer."""

import contextlib

import numpy as np
import pytest
from msgspec.structs import replace
from support import shots
from support.glb_builder import GlbBuilder

from nlens_video.core.settings import ObjectSettings
from nlens_video.effects.planner import decide
from nlens_video.graph.base.context import NodeContext
from nlens_video.graph.base.object_source import open_object
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import View
from nlens_video.graph.builder import build, shadow_scene
from nlens_video.graph.effect_plan import LensRequest
from nlens_video.graph.executor import GraphExecutor
from nlens_video.graph.nodes.plate_light import EstimateLight
from nlens_video.graph.pipeline_file import load_pipeline
from nlens_video.graph.session import open_session
from nlens_video.scene.scene import Scene
from nlens_video.video.info import SourceFrame
from nlens_video.video.pixels.picture import ArrayPicture


@pytest.fixture
def context(tmp_path):
    """Nodes' dependencies for a cube without lights, with one renderer for all graphs."""
    with context_of(shots.cube_glb(tmp_path / "cube.glb", sun=False)) as context:
        yield context


@contextlib.contextmanager
def context_of(glb):
    settings = ObjectSettings(glb=glb)
    scene = Scene.load(settings.glb)
    shadow = shadow_scene(settings, scene)
    view = View(width=shots.WIDTH, height=shots.HEIGHT)
    source = open_object(settings, scene, view, shadow.light)
    with source.opened():
        yield NodeContext(
            objects=source, estimate_coc=None, ground_y=0.0, fallback_constant=False,
            pixel_aspect=1.0, renderer=source.renderer, shadow_scene=shadow,
        )  # fmt: skip


def executor(context):
    graph = build(load_pipeline("standard"), decide("shadow"), context, fit_given=True)
    return GraphExecutor(graph, Profiler())


def run(runner, level, index=0):
    picture = ArrayPicture(np.full((shots.HEIGHT, shots.WIDTH, 3), level, np.uint8), "rgb")
    state = runner.begin_frame(SourceFrame(index=index, time_s=index / 25, picture=picture))
    return runner.run(state, runner.graph.nodes).values


def test_estimated_plate_light_reaches_the_rendered_object(context):
    bright, dark = run(executor(context), 200), run(executor(context), 40)
    for values in (bright, dark):
        assert values.plate_light is not None
        assert values.bounds.plate_light is values.plate_light
    assert bright.layer.rgba[..., :3].mean() > 2 * dark.layer.rgba[..., :3].mean()


def test_estimated_plate_light_casts_a_shadow(context):
    values = run(executor(context), 200)
    assert values.shadow is not None and values.shadow.loss.any()


def test_renderer_keeps_no_light_of_another_shot(context):
    first = run(executor(context), 200).layer
    run(executor(context), 40)
    again = run(executor(context), 200).layer
    assert np.array_equal(first.rgba, again.rgba)


def test_light_of_the_first_frame_holds_for_the_shot(context):
    runner = executor(context)
    first, later = run(runner, 200), run(runner, 40, index=1)
    assert later.plate_light is first.plate_light
    assert np.array_equal(first.layer.rgba, later.layer.rgba)


@pytest.mark.parametrize(("sun_lx", "told"), [(2.0, 0), (2000.0, 1)])
def test_lights_that_are_exposed_for_the_plate_are_told_once(tmp_path, sun_lx, told):
    glb = shots.cube_glb(tmp_path / "lit.glb", sun_lx=sun_lx)
    with context_of(glb) as context:
        runner = executor(context)
        for index in range(2):
            run(runner, 120, index)
        found = [note for note in context.objects.notes if "exposed for the plate" in note]
    assert len(found) == told


def test_how_dark_the_plates_own_shadows_are_is_told_once_where_it_is_used(context):
    values = run(executor(context), 120)
    assert not [note for note in context.objects.notes if "shadow leaves" in note]
    seen = replace(values.plate_light, shadow_left=np.array([0.4, 0.42, 0.5]))
    for _ in range(2):
        context.renderer.render(0.0, values.bounds.camera, plate_light=seen)
    (note,) = (note for note in context.objects.notes if "shadow leaves" in note)
    assert "leaves 42 % of the light" in note


def test_light_is_found_with_the_camera_of_the_frame_that_tells_it(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh(shots.CUBE, shots.CUBE_FACES), translation=[0, 0, -1.6])
    matrix = shots.camera_pose()
    turned = builder.node(camera=builder.camera(shots.YFOV), translation=matrix[:3, 3].tolist())
    half_turn = [[0, 0, 0, 1], [0, 1, 0, 0]]
    builder.animation((turned, "rotation", [0.0, 1.0], half_turn, "STEP"))
    ramp = np.linspace(40, 220, shots.WIDTH)[:, None].repeat(3, 1).astype(np.uint8)
    bright_right = ArrayPicture(ramp[None].repeat(shots.HEIGHT, 0), "rgb")
    black = ArrayPicture(np.zeros((shots.HEIGHT, shots.WIDTH, 3), np.uint8), "rgb")
    with context_of(builder.write(tmp_path / "turning.glb")) as context:
        found = []
        for time_s in (0.0, 1.0):
            told = SourceFrame(index=round(25 * time_s), time_s=time_s, picture=bright_right)
            node = EstimateLight(replace(context, first_lit_frame=lambda told=told: told))
            light = node(black)
            right, left = np.array([1.0, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0])
            found.append(light.irradiance_around(right)[1] - light.irradiance_around(left)[1])
    assert found[0] > 0.05 and found[1] < -0.05


def exposure_of(path, places, times=(0.0, 1.0)):
    """Factor on a lamp of 5000 cd that moves between places, over a plate of two seconds."""
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh(shots.CUBE, shots.CUBE_FACES), translation=[0, 0, -1.6])
    matrix = shots.camera_pose().T.ravel().tolist()
    builder.node(camera=builder.camera(shots.YFOV), matrix=matrix)
    lamp = builder.light("point", intensity=5000.0)
    builder.animation((lamp, "translation", times, places, "LINEAR"))
    view = View(width=shots.WIDTH, height=shots.HEIGHT, length_s=2.0)
    objects, lens = ObjectSettings(glb=builder.write(path)), LensRequest(effects="none")
    session = open_session(objects, lens, view, Profiler(), PlatePreview(lambda: ()))
    (node,) = [one for one in session.graph.nodes if isinstance(one, EstimateLight)]
    return node(ArrayPicture(shots.grey(), "rgb")).exposure


def test_lamps_are_exposed_as_their_strongest_moment_of_the_plate_asks_for(tmp_path):
    near, far = [0.5, 1.5, -0.6], [20.0, 30.0, 20.0]
    always = exposure_of(tmp_path / "always.glb", [near, near])
    assert always < 0.01
    arrives, leaves = (exposure_of(tmp_path / "a.glb", way) for way in ([far, near], [near, far]))
    assert arrives == pytest.approx(always, rel=0.01) and leaves == pytest.approx(always, rel=0.01)
    assert exposure_of(tmp_path / "late.glb", [far, near], (5.0, 6.0)) == 1.0


def test_lamp_that_passes_through_the_object_leaves_light(tmp_path):
    inside = [0.0, 0.0, -1.6]
    assert exposure_of(tmp_path / "inside.glb", [inside, inside]) > 1e-6

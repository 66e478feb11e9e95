import numpy as np
import pytest

from nlens_video.evaluate.bench.case import built_case
from nlens_video.evaluate.bench.methods import one_frame, opened, preset_rungs
from nlens_video.evaluate.bench.scenes import plate, write_scenes
from nlens_video.evaluate.bench.shapes import Place, SceneLens
from nlens_video.graph.base.profiler import Profiler
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.scene import Scene
from nlens_video.stages.l_reblur import object_coc

SIZE = (960, 512)


@pytest.fixture(scope="module")
def scenes(tmp_path_factory):
    return {scene.name: scene for scene in write_scenes(tmp_path_factory.mktemp("scenes"), SIZE)}


@pytest.fixture(scope="module")
def seen(scenes):
    """Each scene as the lens' centre sees it."""
    found = {}
    for name, scene in scenes.items():
        loaded = Scene.load(scene.glb)
        assert not loaded.warnings
        with PyrenderObjectRenderer(loaded) as renderer:
            found[name] = object_coc(renderer.render(0.0, loaded.camera(0.0, *SIZE)), scene.fit)
    return found


def test_surface_point_projects_to_its_stated_pixel_and_coc():
    optics = SceneLens(slope=112.0, intercept=-56.0)
    x, y, z = optics.point(Place(580, 156, 28.0))
    assert -1 / z == pytest.approx((28 + 56) / 112)
    assert (480 + 900 * x / -z, 256 - 900 * y / -z) == pytest.approx((580, 156))
    assert optics.size(Place(0, 0, 28.0), 90.0) == pytest.approx(0.1 * -z)


@pytest.mark.slow
@pytest.mark.needs_gl
@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("tilted slab", -28.0, 28.0),
        ("near over far", -6.0, 27.0),
        ("far over near", -28.0, 2.0),
        ("thin rods", -28.0, 28.0),
        ("skinned figure", -20.0, 26.8),
    ],
)
def test_bench_scene_has_its_stated_size_and_coc(seen, name, low, high):
    defocused = seen[name]
    coc = defocused.coc_px[defocused.layer.rgba[..., 3] > 0]
    assert (coc.min(), coc.max()) == pytest.approx((low, high), abs=1.0)
    box = defocused.layer.box
    assert 190 <= box.width <= 280 and 390 <= box.height <= 420
    assert (defocused.layer.rgba[..., 3] > 0).sum() > 20_000


@pytest.mark.slow
@pytest.mark.needs_gl
def test_only_the_slab_scene_has_no_self_occlusion(seen):
    steps = {name: defocused.largest_step_px for name, defocused in seen.items()}
    assert steps.pop("tilted slab") < 1.0
    assert min(steps.values()) > 10.0


@pytest.mark.slow
@pytest.mark.needs_gl
def test_parts_of_a_bench_scene_differ_in_colour(seen):
    for defocused in seen.values():
        rgba = defocused.layer.rgba
        solid = rgba[rgba[..., 3] > 0.999]
        assert solid[:, :3].std(axis=0).min() > 0.05
        assert solid[:, :3].mean() > 0.1


def test_bench_scene_in_a_smaller_frame_has_the_scaled_lens(tmp_path, scenes):
    for small in write_scenes(tmp_path, (240, 128)):
        assert small.fit.slope == pytest.approx(0.25 * scenes[small.name].fit.slope)
        assert (small.fit.width, small.fit.height) == (240, 128)


def test_bench_plate_is_deterministic_and_textured():
    first = plate((240, 128))
    assert np.array_equal(first, plate((240, 128)))
    assert first.shape == (128, 240, 3) and first.dtype == np.uint8 and first.std() > 10


@pytest.mark.slow
def test_run_lights_a_bench_scene_as_its_truth_is_lit(scenes):
    case = built_case(scenes["skinned figure"], SIZE, 16)
    rung = next(one for one in preset_rungs() if one.name == "standard")
    with opened(rung, case, Profiler(), case.fit) as steps:
        picture = one_frame(steps, case, 0)[0]
    assert case.score(picture)["psnr_db"] > 40.0

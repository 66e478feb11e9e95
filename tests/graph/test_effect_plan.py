"""Notes on options whose effect the pipeline lacks, or `--effects` leaves out."""

import numpy as np
import pytest
from support import shots

from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.optics import ROUND, Aperture, LensOverrides
from nlens_video.core.settings import LightSettings, ObjectSettings, RealSettings
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import View
from nlens_video.graph.effect_plan import LensRequest
from nlens_video.graph.session import open_session

BARE = """
nodes = ["object-bounds", "estimate-coc", "ground-footprint", "fit", "render", "object-coc",
         "reblur", "crop-sharp", "composite"]
"""


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    return shots.cube_glb(tmp_path_factory.mktemp("scene") / "cube.glb")


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """A pipeline of defocus alone."""
    path = tmp_path_factory.mktemp("pipeline") / "bare.toml"
    path.write_text(BARE)
    return str(path)


def notes(glb, preset, light=None, real=None, optics=None, solved=None, effects="auto", **lens):
    objects = ObjectSettings(glb=glb, light=light or LightSettings(), real=real or RealSettings())
    lens = LensRequest(preset=preset, effects=effects, optics=optics or LensOverrides(), **lens)
    view = View(width=shots.WIDTH, height=shots.HEIGHT, solved=solved)
    session = open_session(objects, lens, view, Profiler(), PlatePreview(lambda: ()))
    return [note for note in session.notes if "has no node for" in note or "leaves" in note]


@pytest.mark.parametrize(
    ("given", "option", "effect"),
    [
        ({"light": LightSettings(shadow_strength=2.0)}, "--shadow-strength 2", "shadow"),
        ({"real": RealSettings(reflectance=0.1)}, "--ground-reflectance 0.1", "reflection"),
        ({"real": RealSettings(occlusion="auto")}, "--occlusion auto", "occlusion"),
        ({"optics": LensOverrides(vignetting_stops=1.5)}, "--vignetting 1.5", "vignetting"),
        ({"optics": LensOverrides(distortion=(0.1, 0.0))}, "--distortion 0.1,0", "distortion"),
    ],
)
def test_an_option_without_a_node_is_noted_in_one_line(cube, bare, given, option, effect):
    note = f"{option}: the pipeline 'bare' has no node for {effect}; use --preset standard"
    assert notes(cube, bare, **given) == [note]


@pytest.mark.parametrize(("k1", "said"), [(-0.1, 1), (-1e-4, 0), (0.0, 0)])
def test_a_solved_distortion_that_the_pipeline_does_not_follow_is_noted(cube, bare, k1, said):
    key = CameraKey(index=0, pts_s=0.0, world_to_camera=np.eye(4), fov_x_deg=60.0)
    solved = SolvedCamera(
        width=shots.WIDTH, height=shots.HEIGHT, keys=(key,), distortion_k1=k1, path="moving"
    )
    found = notes(cube, bare, solved=solved)
    # The corner lies 275 px from the middle, 0.66 focal lengths: 0.1 * 0.66^2 * 275 px.
    assert len(found) == said and all("k1 -0.100" in one and "12 px" in one for one in found)


@pytest.mark.parametrize("effects", ["grain", "none", "auto,-defocus,-motion-blur,-vignetting"])
def test_options_whose_effect_is_left_out_by_effects_are_noted_one_by_one(cube, effects):
    optics = LensOverrides(vignetting_stops=1.0)
    given = {"optics": optics, "shutter_deg": 90.0, "aperture": Aperture(blades=6)}
    assert notes(cube, "standard", effects=effects, **given) == [
        f"{option}: --effects {effects} leaves {effect} out; add it there"
        for option, effect in (
            ("--vignetting 1", "vignetting"),
            ("--shutter-angle 90", "motion-blur"),
            ("--aperture", "defocus"),
        )
    ]


@pytest.mark.parametrize(
    ("given", "option", "effect"),
    [
        ({"light": LightSettings(shadow_strength=2.0)}, "--shadow-strength 2", "shadow"),
        ({"real": RealSettings(reflectance=0.1)}, "--ground-reflectance 0.1", "reflection"),
        ({"real": RealSettings(occlusion="auto")}, "--occlusion auto", "occlusion"),
        ({"optics": LensOverrides(distortion=(0.1, 0.0))}, "--distortion 0.1,0", "distortion"),
        ({"aperture": Aperture(cat_eye=0.5)}, "--cat-eye", "defocus"),
    ],
)
def test_an_option_whose_effect_is_not_in_the_list_is_noted(cube, given, option, effect):
    note = f"{option}: --effects grain leaves {effect} out; add it there"
    assert notes(cube, "standard", effects="grain", **given) == [note]


def test_options_that_ask_for_nothing_are_not_noted_where_their_effect_is_left_out(cube):
    given = {
        "light": LightSettings(shadow_strength=0.0),
        "real": RealSettings(reflectance=0.0),
        "optics": LensOverrides(vignetting_stops=0.0, distortion=(0.0, 0.0)),
        "shutter_deg": 0.0,
        "aperture": ROUND,
    }
    assert not notes(cube, "standard", effects="grain", **given)


def test_the_preset_draft_has_no_shadow(cube):
    (note,) = notes(cube, "draft", light=LightSettings(shadow_strength=2.0))
    assert note.startswith("--shadow-strength 2: the pipeline 'draft' has no node for shadow;")


def test_nothing_is_noted_where_no_option_or_no_effect_is_asked_for(cube, bare):
    assert not notes(cube, bare)
    assert not notes(cube, bare, light=LightSettings(shadow_strength=0.0))


def test_nothing_is_noted_where_the_pipeline_has_the_node(cube):
    real = RealSettings(reflectance=0.1, occlusion="auto")
    assert not notes(cube, "reference", light=LightSettings(shadow_strength=2.0), real=real)

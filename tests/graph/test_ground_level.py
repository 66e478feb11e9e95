"""The ground that nobody gave is told, and doubted where the object does not stand on it."""

import pytest
from support import shots
from support.glb_builder import GlbBuilder

from nlens_video.core.errors import NoteKind
from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import View
from nlens_video.graph.effect_plan import LensRequest
from nlens_video.graph.session import describe, open_session

PLACE = (0.0, 0.0, -1.6)


def told(path, ground_y=None, footprint=None):
    """The session's note on the ground, from its plan, and the height that it takes."""
    objects = ObjectSettings(glb=path, ground_y=ground_y, footprint=footprint)
    view = View(width=shots.WIDTH, height=shots.HEIGHT, length_s=2.0)
    session = open_session(objects, LensRequest(), view, Profiler(), PlatePreview(lambda: ()))
    (note,) = [one for one in session.notes if "ground" in one] or [None]
    assert note is None or f"note: {note}" in list(describe(session))
    return note, session.context.ground_height


def cubes(path, *parts):
    """Cubes of 0.35: places, and fields of their nodes."""
    builder = GlbBuilder()
    mesh = builder.mesh(shots.CUBE, shots.CUBE_FACES)
    for place, fields in parts:
        builder.node(mesh=mesh, translation=list(place), **{"scale": [0.35] * 3, **fields})
    matrix = shots.camera_pose().T.ravel().tolist()
    builder.node(camera=builder.camera(shots.YFOV), matrix=matrix)
    return builder.write(path)


def test_ground_by_default_is_told_and_a_given_one_is_not(tmp_path):
    path = shots.cube_glb(tmp_path / "cube.glb")
    note, height = told(path)
    assert note.kind is NoteKind.INFORMATION and height == pytest.approx(0.0, abs=1e-6)
    assert note == (
        "ground at y = 0, the object's lowest point on the first frame; --ground-y gives another"
    )
    assert told(path, ground_y=0.0)[0] is None


@pytest.mark.parametrize(("start", "end"), [(0.3, 0.0), (0.0, -0.1)])
def test_object_that_comes_to_lie_below_its_first_height_is_told_with_the_ground(
    tmp_path, start, end
):
    path = shots.cube_glb(tmp_path / "cube.glb", start=(0, start, -1.6), end=(0, end, -1.6))
    note, height = told(path)
    assert height == pytest.approx(start) and note.kind is NoteKind.UNCERTAIN
    assert f"{start - end:g} below the ground" in note
    assert note.endswith(f"give --ground-y {end:g}")


@pytest.mark.parametrize("end", [0.3, -0.005])
def test_object_that_rises_or_sinks_by_a_trace_is_not_doubted(tmp_path, end):
    path = shots.cube_glb(tmp_path / "cube.glb", end=(0, end, -1.6))
    assert told(path)[0].kind is NoteKind.INFORMATION


def test_what_sinks_out_of_view_is_not_doubted(tmp_path):
    builder = GlbBuilder()
    mesh = builder.mesh(shots.CUBE, shots.CUBE_FACES)
    node = builder.node(mesh=mesh, translation=list(PLACE), scale=[0.35] * 3)
    away = [PLACE, (9.0, 0.0, -1.6), (9.0, -5.0, -1.6)]
    builder.animation((node, "translation", [0.0, 0.01, 1.0], away, "LINEAR"))
    matrix = shots.camera_pose().T.ravel().tolist()
    builder.node(camera=builder.camera(shots.YFOV), matrix=matrix)
    assert told(builder.write(tmp_path / "away.glb"))[0].kind is NoteKind.INFORMATION


def test_part_far_below_the_frame_is_told_and_a_part_of_no_size_sets_no_ground(tmp_path):
    far = (0.0, -10.0, -1.6)
    parked, height = told(cubes(tmp_path / "parked.glb", (PLACE, {}), (far, {})))
    assert height == pytest.approx(-10.0) and parked.kind is NoteKind.UNCERTAIN
    assert "stays 10 above the ground (y = -10," in parked
    assert parked.endswith("give --ground-y 0")
    hidden = cubes(tmp_path / "hidden.glb", (PLACE, {}), (far, {"scale": [0, 0, 0]}))
    note, height = told(hidden)
    assert height == pytest.approx(0.0, abs=1e-6) and note.kind is NoteKind.INFORMATION


def test_body_whose_feet_are_out_of_view_stands_on_them(tmp_path):
    column = [((0.0, -0.34 * k, -0.3), {}) for k in range(8)]
    note, height = told(cubes(tmp_path / "body.glb", *column))
    assert height < -2.0 and note.kind is NoteKind.INFORMATION


def test_ground_of_a_footprint_node_is_told_as_such(tmp_path):
    path = cubes(tmp_path / "two.glb", (PLACE, {"name": "foot"}), ((0.4, -0.2, -1.6), {}))
    note, _ = told(path, footprint="foot")
    assert "y = 0, the lowest point of --footprint-node" in note

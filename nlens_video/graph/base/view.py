"""The camera that sees the object, and the object's bounds on the screen."""

from __future__ import annotations

import math

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.cameras.doubt import doubt, what_was_found
from nlens_video.cameras.placed import PlacedCamera, in_solved_world, stand_on_ground
from nlens_video.cameras.placement import contact_point, place_camera
from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.errors import InputError, NoGroundError, Note, NoteKind, UsageError
from nlens_video.core.layers import Box, ObjectLayer
from nlens_video.core.optics import Distortion
from nlens_video.core.placement import ASSUMED_FOCAL_MM, GroundPlacing, Placement, focal_of_fov
from nlens_video.core.settings import ObjectSettings
from nlens_video.kernels.scatter.furthest import furthest_reach
from nlens_video.scene.camera import Camera
from nlens_video.scene.gltf.animations import listed
from nlens_video.scene.illumination import Illumination
from nlens_video.scene.posed import PosedScene
from nlens_video.scene.scene import Scene
from nlens_video.scene.screen_projection import extent, misses

_NEAREST = 1e-3  # of the object's greatest depth: nearer than that is taken for behind the camera

_MOST_UNEVEN = 8
"""Limit of a pixel's width by its height, or the other way round: memory of the blur grows by its
square."""
_BELOW, _SIZE_BELOW = (0.5, 0.85), 0.35
"""Where an object stands on a plate that shows no ground, and its height [frame]."""


class View(Struct, frozen=True, kw_only=True):
    """How the frame's pixels see the scene.

    Attributes:
        width: columns [px].
        height: rows [px].
        pixel_aspect: width of a pixel by its height [1].
        camera: name of the camera in the file, None for the first perspective one.
        focal_35mm: 35 mm equivalent focal length of the plate, None where it is unknown [mm].
        placed: a camera that stands in for those of the file, None where there is none.
        solved: the plate's cameras, None where they are not known.
        cameras: those, in the world of the file, None before `choose_camera`.
        distortion: that the object is given, and that its place in the frame takes into account;
            None for none.
        overscan_px: how far beyond the frame the object is rendered, without its blur [px].
        frame_s: from one frame to the next on average, 0 for a still or where unknown [s].
        length_s: of the plate, None where it is not known [s].

    Raises:
        InputError: pixels that are farther from square than any camera's.
    """

    width: int
    height: int
    pixel_aspect: float = 1.0
    camera: str | None = None
    focal_35mm: float | None = None
    placed: Camera | None = None
    solved: SolvedCamera | None = None
    cameras: PlacedCamera | None = None
    distortion: Distortion | None = None
    overscan_px: int = 0
    frame_s: float = 0.0
    length_s: float | None = None

    def __post_init__(self) -> None:
        if not 1.0 / _MOST_UNEVEN <= self.pixel_aspect <= _MOST_UNEVEN:
            raise InputError(
                f"the plate's pixels are {self.pixel_aspect:.3g} times as wide as high; expected "
                f"1/{_MOST_UNEVEN} to {_MOST_UNEVEN}; ffmpeg -i IN -vf setsar=1 OUT makes them "
                "square"
            )

    @property
    def unit_m(self) -> float | None:
        """A unit of the scene, None where the plate's scale is not known [m]."""
        if self.cameras is None:
            return None if self.placed is not None else 1.0  # glTF is in metres
        return 1.0 / self.cameras.scale if self.cameras.solved.scale == "metres" else None

    @property
    def box(self) -> Box:
        """The whole frame."""
        return Box(0, 0, self.width, self.height)

    def camera_at(self, scene: Scene, time_s: float) -> Camera:
        """The camera at a moment of the plate [s]."""
        if self.placed is not None:
            return self.placed
        if self.cameras is not None:
            return self.cameras.at(time_s)
        return scene.camera(
            time_s, self.width, self.height, name=self.camera, pixel_aspect=self.pixel_aspect
        )

    def zoom_ends(self, scene: Scene) -> tuple[float, ...]:
        """Times of the narrowest and the widest field of view [s], none where it stays."""
        if self.placed is not None:
            return ()
        if self.cameras is None:
            return scene.zoom_ends(self.camera)
        keys = sorted(self.cameras.solved.keys, key=lambda key: key.fov_x_deg)
        ends = keys[0], keys[-1]
        return tuple(key.pts_s for key in ends) if ends[0].fov_x_deg < ends[1].fov_x_deg else ()


class ScreenBounds(Struct, frozen=True, kw_only=True):
    """Camera, screen bounds and depth range of the object at one moment.

    Attributes:
        time_s: moment of the animation [s].
        camera: that moment's camera.
        box: the object's bounds on the frame's pixel grid; may reach beyond the frame.
        nearest: least depth of the object in front of the camera [scene unit].
        farthest: greatest depth [scene unit].
        layer: the object's layer, where it was read rather than rendered.
        plate_light: lighting estimated from the plate, None for a default light.
    """

    time_s: float
    camera: Camera
    box: Box
    nearest: float
    farthest: float
    layer: ObjectLayer | None = None
    plate_light: Illumination | None = None


def choose_camera(
    objects: ObjectSettings, scene: Scene, view: View, moment: float | None = None
) -> tuple[View, tuple[str, ...]]:
    """The file's camera, or one that sees the object, as it is at time 0, where it is placed.

    Args:
        objects: the object.
        scene: its file alone.
        view: the frame, with the plate's solved camera if there is one.
        moment: that its place in the frame is of; None: that of `at_frame` [s].

    Returns:
        The view with that camera, and a note on it.

    Raises:
        SceneError: no camera sees it so, or the file has none.
        UsageError: layers were rendered through another camera.
    """
    if view.solved is not None:
        return _with_solved_camera(objects, scene, view, view.solved, moment)
    placing = objects.placing
    if objects.on_ground is not None:
        placing = objects.on_ground.under()
    if placing is None:
        view.camera_at(scene, 0.0)
        if objects.fov_deg is not None:
            raise UsageError("--fov is of an object without a camera; leave it out")
        return view, _other_cameras(scene, view)
    if objects.layers is not None:
        raise UsageError("--layers were rendered through the GLB's own camera; leave --at out")
    view, note = _placed_by_eye(objects, scene, view, placing)
    return view, (note,)


def _other_cameras(scene: Scene, view: View) -> tuple[Note, ...]:
    """A note on the cameras of the file that are not used, where none of several was asked for."""
    used, *others = scene.camera_names
    if view.camera is not None or not others:
        return ()
    text = f"of {1 + len(others)} cameras '{used}' is used; --camera NAME uses another"
    return (Note(f"{text}: {listed(others)}", NoteKind.INFORMATION),)


def _placed_by_eye(
    objects: ObjectSettings, scene: Scene, view: View, placing: Placement
) -> tuple[View, Note]:
    """A camera under a given horizon, and a note on it."""
    size = (view.width, view.height)
    focal = view.focal_35mm or ASSUMED_FOCAL_MM
    known = "as the plate says" if view.focal_35mm else "assumed"
    if objects.fov_deg is not None:
        focal = focal_of_fov(objects.fov_deg, size, view.pixel_aspect)
        known = f"by --fov {objects.fov_deg:g}"
    unused = "; the file's own camera is not used" if scene.camera_names else ""
    note = Note(
        f"placed by {placing.describe()}, focal length {focal:.4g} mm "
        f"(35 mm equivalent, {known}){unused}",
        NoteKind.INFORMATION,
    )
    vertices = scene.pose(0.0).vertices()
    contact = contact_point(vertices, objects.ground_y)
    camera = place_camera(
        vertices, contact, placing, focal, size, view.pixel_aspect, view.distortion
    )
    return replace(view, placed=camera), note


def _with_solved_camera(
    objects: ObjectSettings, scene: Scene, view: View, solved: SolvedCamera, moment: float | None
) -> tuple[View, tuple[str, ...]]:
    """The plate's cameras in the file's world, and a note on where the object stands."""
    if objects.layers is not None:
        raise UsageError("--layers were rendered through a camera of their own; leave them out")
    wish = objects.on_ground
    if wish is None and scene.camera_names:
        return replace(view, cameras=in_solved_world(solved)), ()
    keys = [key.pts_s for key in solved.keys if key.index == objects.at_frame]
    if objects.at_frame and len(solved.keys) > 1 and not keys:
        raise UsageError(f"--at-frame {objects.at_frame}: the camera file has no such frame")
    vertices = scene.pose(0.0).vertices()
    contact = contact_point(vertices, objects.ground_y)
    time_s = moment
    if time_s is None:
        time_s = keys[0] if keys else solved.keys[0].pts_s
    wish = wish or GroundPlacing()
    try:
        cameras, said = stand_on_ground(vertices, contact, wish, solved, time_s, view.distortion)
    except NoGroundError:
        if len(solved.keys) > 1 or wish.height_m is not None:
            raise
        below = replace(wish, at=_BELOW, size=wish.size or _SIZE_BELOW).under()
        view, note = _placed_by_eye(objects, scene, replace(view, solved=None), below)
        pitch = f"pitch {solved.keys[0].pitch_deg:.1f} degrees, {solved.horizon}"
        unseen = f"the plate's camera ({pitch}) sees no ground: the horizon is assumed"
        return view, (Note(unseen, NoteKind.UNCERTAIN), note)
    guessed = solved.place_guessed and not wish.at
    why = "a guess: no line or blur tells that this is ground" if guessed else "chosen"
    chosen = "" if wish.at else f" ({why}; --at X,Y and --size S place it elsewhere)"
    found = what_was_found(solved)
    given = objects.camera_from is not None and not objects.camera_solved
    uncertain = doubt(solved, from_file=given)
    placed = {"--at": wish.at, "--size": wish.size, "--height": wish.height_m}
    option = next((name for name, value in placed.items() if value is not None), "--yaw")
    unused = (
        f"the file's own camera is not used: {option} places the object; leave {option} out to "
        "use that camera"
    )
    return replace(view, cameras=cameras), (
        *([Note(unused, NoteKind.INFORMATION)] if scene.camera_names else []),
        *([Note(found, NoteKind.INFORMATION)] if found else []),
        *([Note(uncertain, NoteKind.UNCERTAIN)] if uncertain else []),
        Note(f"placed by {said}{chosen}", NoteKind.UNCERTAIN if guessed else NoteKind.INFORMATION),
    )


def bounds_near_frame(scene: Scene, view: View, time_s: float) -> ScreenBounds | None:
    """Bounds of an object at a moment [s]; None when it misses the frame and all that blurs in.

    What passes by quickly may be far off half way: it counts where it is seen half a frame's time
    before or after, between which the shutter is open.
    """
    camera = view.camera_at(scene, time_s)
    surroundings = view.box.expanded(furthest_reach(view.pixel_aspect))
    half_s = 0.5 * view.frame_s
    ends = (time_s - half_s, time_s + half_s) if half_s > 0.0 else ()

    def missed(moment: float) -> bool:
        """Certainly, without moving a vertex."""
        return misses(scene.hull(moment), view.camera_at(scene, moment), surroundings)

    if misses(scene.hull(time_s), camera, surroundings) and all(map(missed, ends)):
        return None
    bounds = _bounds(scene.pose(time_s), camera)
    if bounds is None:
        return None
    box, nearest, farthest = bounds

    def seen(moment: float) -> bool:
        there = _bounds(scene.pose(moment), view.camera_at(scene, moment))
        return there is not None and not there[0].intersection(surroundings).empty

    if box.intersection(surroundings).empty and not any(map(seen, ends)):
        return None
    return ScreenBounds(time_s=time_s, camera=camera, box=box, nearest=nearest, farthest=farthest)


def begins_in_frame(scene: Scene, view: View) -> bool:
    """Whether the objects are in the frame at time 0."""
    bounds = bounds_near_frame(scene, view, 0.0)
    return bounds is not None and not bounds.box.intersection(view.box).empty


def _bounds(posed: PosedScene, camera: Camera) -> tuple[Box, float, float] | None:
    """Screen bounds and depth range of what lies in front of the camera; None if nothing does.

    A body that reaches behind the camera may cover any pixel: its bounds are the whole frame.
    """
    seen = extent(posed, camera)
    if not seen.farthest > 0:
        return None
    nearest = max(seen.nearest, _NEAREST * seen.farthest)
    if seen.nearest < nearest:
        return Box(0, 0, camera.width, camera.height), nearest, seen.farthest
    limit = 1e6  # far off is far off: keeps whole numbers small
    x0, y0 = (math.floor(min(max(v, -limit), limit)) for v in seen.low)
    x1, y1 = (math.ceil(min(max(v, -limit), limit)) for v in seen.high)
    return Box(x0, y0, x1 + 1, y1 + 1), nearest, seen.farthest

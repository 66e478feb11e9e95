"""Options of the object: its file, animation, placement, lighting, occlusion and reflection."""

from __future__ import annotations

from nlens_video.core.objects import ALL
from nlens_video.core.settings import REFLECTANCE
from nlens_video.options import files
from nlens_video.options import readers as read
from nlens_video.options.commands import PLACED, SEEN, SHOT, SOLVED
from nlens_video.options.object_tables import INTERPOLATIONS, key_word, object_word
from nlens_video.options.option import Option

_SMALL = read.between(-1e4, 1e4, "a number from -10000 to 10000")

# fmt: off
OBJECT_OPTIONS: dict[str, tuple[Option, ...]] = {
    "the object": (
        Option("--camera", SHOT, "NAME", help="camera of the GLB (default: its first)",
               feeds="scene.camera", parameter=True),
        Option("--camera-from", (*SHOT, "check", "place"), "CAMERA", read.input_path,
               files=files.READ, parameter=True,
               help="file of the plate's camera: camera.json, glTF, USD, .chan, fSpy .json, COLMAP "
               "folder",
               feeds="scene.camera_from"),
        Option("--scene", PLACED, "NAME", help="scene of the GLB (default: its default scene)",
               feeds="scene.scene", parameter=True),
        Option("--layers", SHOT, "P.exr", read.input_pattern,
               "pre-rendered layers of RGBA and Z in place of the rendering: one file, or "
               "P.%%04d.exr",
               feeds="scene.layers", files=files.READ),
        Option("--ground-y", PLACED, "Y", read.number,
               "height of the ground plane in the GLB's units (default: the object's lowest point "
               "on the first frame)",
               feeds="scene.ground_y", parameter=True),
        Option("--footprint-node --footprint", SHOT, "NODE",
               help="fit the lens under this node of the GLB (default: the whole object)",
               dest="footprint", feeds="scene.footprint", parameter=True),
        Option("--object", SHOT, "TABLE", object_word, repeats=True, dest="others",
               feeds="scene.others",
               help="another object, with the keys of [[object]] in a shot file: '{file = "
               "\"b.glb\", at = [0.7, 0.8], size = 0.2}'; may be repeated"),
    ),
    "animation of the object (a camera of the GLB follows the plate's time)": (
        Option("--animation", PLACED, "NAME",
               help="animation to play: a name, a number, or all (default)", default=ALL,
               feeds="playback.animation", parameter=True, often=True),
        Option("--loop", PLACED, help="repeat the animation (default: hold its last pose)",
               feeds="playback.loop", parameter=True),
        Option("--animation-speed", PLACED, "S", read.positive, "playback speed (default 1)",
               default=1.0, feeds="playback.speed", parameter=True),
        Option("--animation-offset", PLACED, "SEC", read.number,
               "start this many seconds into the animation (default 0)", default=0.0,
               feeds="playback.offset_s", parameter=True),
    ),
    "placement (replaces the GLB's camera; positions and sizes in fractions of the frame)": (
        Option("--at", PLACED, "X,Y", read.point,
               "contact with the ground; 0,0: upper left corner",
               feeds="placing.at", parameter=True, often=True),
        Option("--at-frame", SHOT, "N", read.frame_index,
               "frame that --at refers to, if the camera moves (default 0)",
               feeds="scene.at_frame", parameter=True),
        Option("--size", PLACED, "S", read.number, "height of the object; 1: as high as the frame",
               feeds="placing.size", parameter=True),
        Option("--height", SHOT, "H", read.length,
               "height of the object as a length such as 0.4m, if the plate's scale is known",
               feeds="ground.height_m", parameter=True),
        Option("--yaw", PLACED, "D", read.number,
               "rotation about the vertical in degrees (default 0: the object's +Z faces the "
               "camera)",
               feeds="placing.yaw_deg", parameter=True),
        Option("--key", SHOT, "TABLE", key_word, repeats=True, dest="keys",
               help="keyframe of at, size, height or yaw: '{time = 2, at = [0.7, 0.8]}', or with "
               "frame = 48; may be repeated"),
        Option("--interpolation", SHOT, choices=INTERPOLATIONS, default="smooth",
               help="interpolation between keys: smooth (default; no overshoot) or linear"),
        Option("--horizon", PLACED, "H", read.number,
               "height of the horizon in the frame: 0 top, 1 bottom (default: as the camera is "
               "solved; 0.5 for streams)",
               feeds="placing.horizon", parameter=True),
        Option("--roll", PLACED, "DEG", read.between(-45, 45, "an angle from -45 to 45 degrees"),
               "angle by which that horizon falls to the right, in degrees (default 0)",
               feeds="placing.roll_deg", parameter=True),
    ),
    "scale of the camera solve": (
        Option("--marker", SOLVED, "SIDE", read.length,
               "side of the ArUco or AprilTag markers that lie on the ground, such as 0.2m",
               feeds="scale.marker_m"),
        Option("--person-height", SOLVED, "H", read.length,
               "height of a person who stands on the ground, such as 1.75m",
               feeds="scale.person_m"),
        Option("--person", SOLVED, "X,Y", read.person,
               "a point on that person in the first frame, or X0,Y0,X1,Y1 from head to feet",
               feeds="scale.person"),
    ),
    "camera solve": (
        Option("--fov", SEEN, "DEG", read.between(1, 170, "an angle from 1 to 170 degrees"),
               "horizontal field of view of the plate in degrees, 1 to 170 (default: solved)",
               feeds="scene.fov_deg", parameter=True),
        Option("--ignore-lines", SOLVED, "X0,Y0,X1,Y1", read.segments,
               "ignore the lines along this segment of the first frame, or along several",
               feeds="source.ignored_lines"),
    ),
    "lighting, in addition to the GLB's lights": (
        Option("--env-map --env", SHOT, "MAP.hdr", read.light_around,
               "environment map, or plate (default): from the plate",
               dest="env", feeds="light.env", parameter=True, often=True, files=files.READ),
        Option("--env-rotation", SHOT, "D", _SMALL,
               "rotation of the map about the vertical, counter-clockwise from above, in degrees",
               feeds="light.env_rotation_deg", parameter=True),
        Option("--env-exposure", SHOT, "EV", _SMALL,
               "exposure of the map in stops (default: matched to the plate)",
               feeds="light.env_exposure_ev", parameter=True),
        Option("--sun", SHOT, "AZ,EL", read.sun,
               "sun, in place of the GLB's: azimuth right of the view and elevation, in degrees; "
               "AZ,EL,S: S times the other light (default: measured from the plate's shadows, else "
               "2); none: no sun, not even one that is detected in the plate",
               feeds="light.sun", parameter=True),
        Option("--shadow-strength", SHOT, "S", read.between(0, 2, "a number from 0 to 2"),
               "strength of the shadow on the ground, 0 to 2 (default 1: physical); also enables "
               "shadows of --layers",
               feeds="light.shadow_strength", parameter=True, often=True),
    ),
    "occlusion and reflection": (
        Option("--holdout", SHOT, "PATH", read.input_pattern,
               "holdout matte (white: in front), or EXR with depth Z",
               feeds="real.holdout", parameter=True, often=True, files=files.READ),
        Option("--occlusion", SHOT, choices=("none", "moving", "auto"), default="moving",
               help="occlusion of the object by moving foreground (default: moving), also by blur "
               "(auto), or none",
               feeds="real.occlusion", parameter=True),
        Option("--ground-reflectance --reflect", SHOT, "R",
               read.between(0, 1, "a number from 0 to 1"),
               f"ground reflectance at normal incidence, 0 to 1 (without a value: {REFLECTANCE:g})",
               nargs="?", const=REFLECTANCE, dest="reflect", feeds="real.reflectance",
               parameter=True),
    ),
}
# fmt: on

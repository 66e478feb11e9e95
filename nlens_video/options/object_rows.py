"""Options of the object: its file, animation, place, light, what hides and mirrors it."""

from __future__ import annotations

from nlens_video.core.objects import ALL
from nlens_video.core.settings import REFLECTANCE
from nlens_video.options import files
from nlens_video.options import readers as read
from nlens_video.options.commands import PLACED, SEEN, SHOT, SOLVED
from nlens_video.options.object_tables import INTERPOLATIONS, key_word, object_word
from nlens_video.options.option import Option

_SMALL = read.between(-1e4, 1e4, "a number of usual size")

# fmt: off
OBJECT_OPTIONS: dict[str, tuple[Option, ...]] = {
    "the object": (
        Option("--camera", SHOT, "NAME", help="the GLB's camera (default: its first)",
               feeds="scene.camera", parameter=True),
        Option("--camera-from", (*SHOT, "check", "place"), "CAMERA", read.path,
               files=files.READ, parameter=True,
               help="the plate's camera: camera.json, glTF, USD, .chan, fSpy .json, COLMAP folder",
               feeds="scene.camera_from"),
        Option("--scene", PLACED, "NAME", help="the GLB's scene (default: as it says)",
               feeds="scene.scene", parameter=True),
        Option("--layers", SHOT, "P.exr", read.pattern, "pre-rendered RGBA + Z layers, or %%04d",
               feeds="scene.layers", files=files.READ),
        Option("--ground-y", PLACED, "Y", read.number,
               "height of the ground plane in the GLB's units (default: the object's lowest point)",
               feeds="scene.ground_y", parameter=True),
        Option("--footprint-node --footprint", SHOT, "NODE",
               help="fit under this object (default: all)",
               dest="footprint", feeds="scene.footprint", parameter=True),
        Option("--object", SHOT, "TABLE", object_word, repeats=True, dest="others",
               feeds="scene.others",
               help="one more, as [[object]] of a shot file has it: '{file = \"b.glb\", at = [0.7, "
               "0.8], size = 0.2}'; may be repeated"),
    ),
    "its animation (a moving camera keeps the plate's time)": (
        Option("--animation", PLACED, "NAME",
               help="which one plays: name, number, or all", default=ALL,
               feeds="playback.animation", parameter=True, often=True),
        Option("--loop", PLACED, help="start again, not rest at the end",
               feeds="playback.loop", parameter=True),
        Option("--animation-speed", PLACED, "S", read.positive, "times its own speed (1)",
               default=1.0, feeds="playback.speed", parameter=True),
        Option("--animation-offset", PLACED, "SEC", read.number,
               "start so many seconds into it", default=0.0,
               feeds="playback.offset_s", parameter=True),
    ),
    "its place on the plate; the GLB's camera is then not used (fractions of the frame)": (
        Option("--at", PLACED, "X,Y", read.point,
               "contact with the ground, 0,0 (upper left) to 1,1",
               feeds="placing.at", parameter=True, often=True),
        Option("--at-frame", SHOT, "N", read.frame_index,
               "frame that --at is of, where the camera moves (default 0)",
               feeds="scene.at_frame", parameter=True),
        Option("--size", PLACED, "S", read.number, "its height, 1 is all of the frame's",
               feeds="placing.size", parameter=True),
        Option("--height", SHOT, "H", read.length,
               "its height where the plate's scale is known, such as 0.4m",
               feeds="ground.height_m", parameter=True),
        Option("--yaw", PLACED, "D", read.number,
               "turn about the vertical in degrees (default 0: its front faces the viewer)",
               feeds="placing.yaw_deg", parameter=True),
        Option("--key", SHOT, "TABLE", key_word, repeats=True, dest="keys",
               help="its at, size, height or yaw at a moment: '{time = 2, at = [0.7, 0.8]}', or "
               "frame = 48; may be repeated"),
        Option("--interpolation", SHOT, choices=INTERPOLATIONS, default="smooth",
               help="between keys: smooth, never beyond their values, or linear"),
        Option("--fov", SEEN, "DEG", read.between(1, 170, "an angle from 1 to 170 degrees"),
               "the plate's field of view across the frame, 1 to 170",
               feeds="scene.fov_deg", parameter=True),
        Option("--horizon", PLACED, "H", read.number,
               "row of the plate's horizon (default: that of its solved camera; of streams 0.5)",
               feeds="placing.horizon", parameter=True),
        Option("--roll", PLACED, "DEG", read.between(-45, 45, "an angle from -45 to 45 degrees"),
               "how steeply that horizon falls to the right, in degrees (default 0)",
               feeds="placing.roll_deg", parameter=True),
    ),
    "the plate's scale, where its camera is solved": (
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
    "what tells the plate's camera": (
        Option("--ignore-lines", SOLVED, "X0,Y0,X1,Y1", read.segments,
               "solve without the lines along this one, or along several, in the first frame",
               feeds="source.ignored_lines"),
    ),
    "its light, beside the lights of its file": (
        Option("--env-map --env", SHOT, "MAP.hdr", read.light_around,
               "light from around: an equirectangular map; plate (default): by the plate",
               dest="env", feeds="light.env", parameter=True, often=True, files=files.READ),
        Option("--env-rotation", SHOT, "D", _SMALL,
               "turn the map about the vertical, in degrees",
               feeds="light.env_rotation_deg", parameter=True),
        Option("--env-exposure", SHOT, "EV", _SMALL,
               "brighten the map by so many stops (default: to the plate's level)",
               feeds="light.env_exposure_ev", parameter=True),
        Option("--sun", SHOT, "AZ,EL", read.sun,
               "a sun in place of the file's: degrees right of the view, and up; AZ,EL,S: S "
               "times other light (default: as the plate's shadows show, else 2); none: no sun, "
               "not even one that the plate's shadows tell",
               feeds="light.sun", parameter=True),
        Option("--shadow-strength", SHOT, "S", read.between(0, 2, "a number from 0 to 2"),
               "0 none, 1 as the light has it, up to 2; a shadow even of layers",
               feeds="light.shadow_strength", parameter=True, often=True),
    ),
    "occlusion and reflection": (
        Option("--holdout", SHOT, "PATH", read.pattern,
               "matte of what is in front (white), or EXR with depth Z",
               feeds="real.holdout", parameter=True, often=True, files=files.READ),
        Option("--occlusion", SHOT, choices=("none", "moving", "auto"), default="moving",
               help="by what moves, if certain; auto: or by blur",
               feeds="real.occlusion", parameter=True),
        Option("--ground-reflectance --reflect", SHOT, "R",
               read.between(0, 1, "a number from 0 to 1"),
               f"the ground mirrors so much from above (default {REFLECTANCE:g}), more at a slant",
               nargs="?", const=REFLECTANCE, dest="reflect", feeds="real.reflectance",
               parameter=True),
    ),
}
# fmt: on

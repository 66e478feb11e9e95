"""Rows of words that several commands share, and what a row is.

In the words `{tmp}` is an empty folder for what is written; the others lie in the folder that the
run starts in (`test_every_option.files`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

NOT_NUMBERS = ("", "abc", "nan", "inf", "1e400", "9" * 400)
NO_FILE = ("", "missing.file", "x" * 300, "folder/", "text.txt", "empty.file")


@dataclass(frozen=True)
class Row:
    """One word of a command.

    Attributes:
        sense: the words that give it a value, or replace the command's own word of that place.
        nonsense: values that it must refuse.
        codes: exit codes of those.
        elsewhere: test that runs it with sense, where that takes long.
        placed: whether the object is one without a camera, which the command places.
        words: the command's own words, where others are needed.
        code: of the run with sense.
    """

    sense: tuple[str, ...] = ()
    nonsense: tuple[str, ...] = ()
    codes: tuple[int, ...] = (2,)
    elsewhere: str = ""
    placed: bool = False
    words: tuple[str, ...] | None = None
    code: int = 0


@dataclass(frozen=True)
class Command:
    """A command: the words that it needs, and a row for each word that its help lists.

    Attributes:
        words: of a run that succeeds.
        places: index in `words` of each positional.
        rows: by the name that argparse keeps the word under.
    """

    words: tuple[str, ...]
    places: dict[str, int]
    rows: dict[str, Row]


def option(
    *sense: str, nonsense: tuple[str, ...] = (), codes: tuple[int, ...] = (2,), **more
) -> Row:
    """A row of an option; a flag's nonsense is any value."""
    return Row(sense=sense, nonsense=nonsense, codes=codes, **more)


PLACED = {"--at": "0.5,0.8", "--size": "0.3", "--horizon": "0.3"}
TALK = {
    "help": option("--help"),
    "version": option("--version"),
    "verbose": option("-v"),
    "quiet": option("-q"),
    "json": option("--json"),
}
PLATE = {
    "input_format": option(
        "--input-format", "png_pipe", nonsense=("", "nosuch", "ü", "in.png"), codes=(2, 3)
    ),
    "input_size": option(
        "--input-size", "480x270", nonsense=("", "480", "0x0", "-1x4", "axb", "9" * 30 + "x1"),
        code=2,
    ),
    "input_rate": option("--input-rate", "25", nonsense=("abc", "0", "-5", "nan"), codes=(2, 3)),
    "input_transfer": option("--input-transfer", "linear", nonsense=("", "purple", "SRGB")),
}  # fmt: skip
RANGE = {
    "range": option(
        "--range",
        "0:1",
        nonsense=("", "5", "5-7", "3:1", "-1:2", "a:b", "1:1", "nan:2", "9:"),
        codes=(2,),
    ),
    "frame": option("--frame", "0", nonsense=("", "-1", "1.5", "abc", "0:1", "9" * 400)),
}
PLAYBACK = {
    "animation": option("--animation", "0", nonsense=("", "nosuch", "99", "-1"), codes=(2, 4)),
    "loop": option("--loop"),
    "animation_speed": option("--animation-speed", "2", nonsense=(*NOT_NUMBERS, "0", "-1")),
    "animation_offset": option("--animation-offset", "-0.5", nonsense=NOT_NUMBERS),
}
PLACING = {
    "at": option(
        "--at", "0.4,0.8", nonsense=(*NOT_NUMBERS, "0.5", "0.5;0.8", "nan,nan", "0.5,0.1"),
        placed=True,
    ),
    "size": option("--size", "0.4", nonsense=(*NOT_NUMBERS, "0", "-1", "50%"), placed=True),
    "yaw": option("--yaw", "-30", nonsense=NOT_NUMBERS, placed=True),
    "fov": option("--fov", "50", nonsense=(*NOT_NUMBERS, "0", "180", "-40"), placed=True),
    "horizon": option("--horizon", "0.2", nonsense=(*NOT_NUMBERS, "0.9"), placed=True),
    "roll": option("--roll", "-5", nonsense=(*NOT_NUMBERS, "46", "-46"), placed=True),
}  # fmt: skip
LENGTHS = (*NOT_NUMBERS, "0", "-1", "2ft", "1e9m")
PERSON = ("--person-height", "1.75m", "--person", "0.4,0.3,0.5,0.95")
SCALE = {
    "marker": option("--marker", "0.2m", nonsense=LENGTHS, code=3),  # no plate here has one
    "person_height": option(*PERSON, nonsense=LENGTHS),
    "person": option(
        *PERSON, nonsense=("", "0.5,1.8", "0.5,0.9,0.4,0.2", "40,20,50,90", "a,b,c,d")
    ),
}
LINES = {
    "ignore_lines": option(
        "--ignore-lines", "0.1,0.2,0.5,0.6,0,0,1,1",
        nonsense=(*NOT_NUMBERS, "0.5", "0,0,1", "0,0,9,1"),
    ),
}  # fmt: skip
SCALE_ELSEWHERE = {
    name: replace(row, elsewhere=f"tests/cli/test_solve_{test}.py")
    for test, rows in (("scale", SCALE), ("ignored_lines", LINES))
    for name, row in rows.items()
}
ENV = ("--env", "map.hdr")
LIGHT = {
    "env": option(*ENV, nonsense=NO_FILE, codes=(2, 3, 4)),
    "env_rotation": option(*ENV, "--env-rotation", "-90", nonsense=(*NOT_NUMBERS, "90")),
    "env_exposure": option(*ENV, "--env-exposure", "-1", nonsense=(*NOT_NUMBERS, "1")),
    "sun": option("--sun", "-60,35,3", nonsense=(*NOT_NUMBERS, "60", "60,0", "60,91", "60,35,0")),
    "shadow_strength": option("--shadow-strength", "2", nonsense=(*NOT_NUMBERS, "-1", "2.1")),
}
OBJECT = {
    "glb": Row(sense=("anim.glb",), nonsense=(*NO_FILE, "in.png", "https://x.org/a.glb"),
               codes=(2, 4, 6)),
    "camera": option("--camera", "Plate", nonsense=("", "nosuch", "ü"), codes=(2, 4)),
    "camera_from": option("--camera-from", "camera.json", nonsense=(*NO_FILE, "in.png", "fit.json"),
                          codes=(2, 4, 6)),
    "at_frame": option("--at-frame", "0", nonsense=(*NOT_NUMBERS, "-1", "1.5")),
    "others": option(
        "--object", '{{file = "bare.glb", at = [0.7, 0.8], size = 0.2}}',
        nonsense=(
            "", "bare.glb", "{{}}", '{{file = ""}}', '{{file = "bare.glb", colour = 1}}',
            '{{file = "bare.glb", at = [0.7, 0.8]}}', '{{file = "bare.glb", loop = 1}}',
            '{{file = "bare.glb", at = 0.7, size = 0.2}}', '{{file = "bare.glb", at = [nan, 0.8]}}',
            '{{file = "bare.glb", at = [0.7, 0.8], size = 0}}',
            '{{file = "bare.glb", size = 0.2, key = {{time = 0, at = [0.7, 0.8]}}}}',
        ),
    ),
    "keys": option(
        "--key", "{{time = 0, at = [0.5, 0.8]}}", "--key", "{{frame = 1, at = [0.6, 0.8]}}",
        words=("render", "in.png", "bare.glb", "{tmp}/out.png", "--size", "0.3", "--horizon", "0.3",
               "--plan"), code=2,  # times and frames
        nonsense=(
            "", "3", "{{}}", "{{time = 0}}", "{{at = [0.5, 0.8]}}", "{{time = -1, yaw = 0}}",
            "{{time = 0, frame = 0, yaw = 0}}", "{{time = nan, yaw = 0}}",
            "{{time = inf, yaw = 0}}",
            "{{frame = 1.5, yaw = 0}}", "{{frame = -1, yaw = 0}}", "{{time = 0, size = -1}}",
            "{{time = 0, size = 0.1, height = 0.1}}", "{{time = 0, at = [500, 300]}}",
            "{{time = 0, turn = 90}}",
        ),
    ),
    "interpolation": option(
        "--interpolation", "linear", "--key", "{{time = 0, yaw = 10}}", nonsense=("", "cubic"),
        placed=True,
    ),
    "scene": option("--scene", "0", nonsense=("", "nosuch", "99", "-1"), codes=(2, 4)),
    "layers": option("--layers", "layers.exr", nonsense=(*NO_FILE, "in.png"), codes=(2, 3, 6)),
    "ground_y": option("--ground-y", "-0.1", nonsense=NOT_NUMBERS),
    "footprint": option("--footprint", "cube", nonsense=("", "nosuch"), codes=(2, 4)),
    "height": Row(
        sense=("--height", "40cm"), nonsense=(*NOT_NUMBERS, "0", "-1", "2ft"),
        elsewhere="tests/cli/test_solve_scale.py",
    ),
    **PLAYBACK, **PLACING, **LIGHT,
    "holdout": option("--holdout", "in.png", nonsense=NO_FILE, codes=(2, 3, 6)),
    "occlusion": option("--occlusion", "auto", nonsense=("", "yes", "AUTO")),
    "reflect": option("--reflect", "0.5", nonsense=(*NOT_NUMBERS, "-1", "1.5")),
}  # fmt: skip
LENS = {
    "preset": option("--preset", "realtime", nonsense=("", "fast", "text.txt", "missing.toml")),
    "device": option("--device", "cpu", nonsense=("", "gpu", "CPU")),
    "fallback": option("--fallback", "constant", nonsense=("", "zero")),
    "aperture": option(
        "--aperture", "6:15:0.2", nonsense=("", "2", "nan", "6:nan", "6:1:2", "6:1:0.5:3", "oval"),
    ),
    "lens": option(
        "--lens", "50mm f/2.8 focus 2.4m",
        nonsense=("", "50", "f/0", "focus far", "sensor huge", "50mm 35mm", "50mm focus 4cm"),
    ),
    "fit_region": option(
        "--fit-region", "0,0.5,1,1",
        nonsense=(*NOT_NUMBERS, "0.5", "1,1,0,0", "0,0,1", "0,0,1,0,1", "0,0,2,1", "nan,0,1,1"),
    ),
    "prefer": option("--prefer", "near", nonsense=("", "both", "NEAR")),
    "cat_eye": option("--cat-eye", "0.5", nonsense=(*NOT_NUMBERS, "-0.1", "1.1")),
    "track_focus": option("--track-focus", "off", nonsense=("", "on", "0", "-3", "1.5")),
}  # fmt: skip
SHOWN = {
    "report": option("--report", "{tmp}/report", nonsense=("", "text.txt", "http://x.org/r",
                                                           "x" * 300, "text.txt/report"),
                     codes=(2, 6)),
    "no_progress": option("--no-progress"),
    "overwrite": option("--overwrite"),
}  # fmt: skip
EFFECTS = {
    "effects": option("--effects", "auto,-grain", nonsense=("", "glitter", "auto,none", "+", ",")),
    "shutter": option("--shutter", "90", nonsense=(*NOT_NUMBERS, "-1", "361")),
    "vignetting": option("--vignetting", "0.5", nonsense=(*NOT_NUMBERS, "-1", "9")),
    "distortion": option("--distortion", "-0.1,0.01", nonsense=(*NOT_NUMBERS, "1,2,3", "1;2")),
}
FIT_FILES = ("", "missing.file", "text.txt", "empty.file", "folder", "in.png", "other.json")
NO_TARGET = ("", "folder", "missing/f.json", "text.txt/f.json", "x" * 300, "http://x.org/f")
RUN = {
    "budget_ms": option("--budget-ms", "50", nonsense=(*NOT_NUMBERS, "0", "-3")),
    "hold_budget": option("--hold-budget", "--preset", "realtime"),
    "late": option("--late", "keep", nonsense=("", "never")),
    "reconnect": option("--reconnect", "5", nonsense=(*NOT_NUMBERS, "0", "5"), code=2),
    "fit": option("--fit", "fit.json", nonsense=FIT_FILES, codes=(2, 5)),
    "save_fit": option("--save-fit", "{tmp}/kept.json", nonsense=NO_TARGET, codes=(2, 6)),
    "save_shot": option("--save-shot", "{tmp}/kept.toml", nonsense=NO_TARGET, codes=(2, 6)),
    "aov": option("--aov", "{tmp}/aov", nonsense=("", "text.txt", "x" * 300, "http://x.org/a"),
                  codes=(2, 6)),
    "timings": option("--timings", "{tmp}/t.json", nonsense=NO_TARGET, codes=(2, 6)),
    "plan": option("--plan"),
}  # fmt: skip
STREAM = ("render", "in.png", "anim.glb", "{tmp}/out.mkv", "--preset", "draft", "--fit", "fit.json")
VIDEO = ("render", "in.mp4", "anim.glb", "{tmp}/out.mp4", "--preset", "draft", "--fit", "fit.json")
ENCODING = {
    "codec": option("--codec", "libx265", nonsense=("", "nosuch", "aac", "h266"), codes=(2, 6)),
    "crf": option("--crf", "30", nonsense=(*NOT_NUMBERS, "999", "-5"), codes=(2, 6)),
    "pix_fmt": option("--pix-fmt", "yuv444p", nonsense=("", "nosuch", "rgb"), codes=(2, 6)),
    "keep_partial": option("--keep-partial"),
}
OF_A_VIDEO = {
    "input_format": option("--input-format", "mp4", nonsense=("", "nosuch"), codes=(2, 3)),
    "input_size": PLATE["input_size"],
    "input_rate": option("--input-rate", "25", nonsense=("abc", "0", "nan"), codes=(2, 3), code=2),
    "input_transfer": PLATE["input_transfer"],
}
"""A video says its rate itself: giving one is refused, with sense or without."""
WRITTEN = ("report", "aov", "save_fit", "timings", "codec", "crf", "pix_fmt")
PLANNED = {
    name: replace(row, nonsense=("",)) if name in WRITTEN else row
    for name, row in {**RUN, **ENCODING, "report": SHOWN["report"]}.items()
}
"""With --plan, which writes nothing and so does not look at where it would."""
INPUT = Row(sense=("in.png",), nonsense=(*NO_FILE, "anim.glb", "plate_%04d.png", "/dev/video99"),
            codes=(2, 3, 6))  # fmt: skip
RESULTS = ("", "folder", "missing/out.png", "out.xyz", "text.txt/out.png", "in.png", "x" * 300)
OUTPUT = Row(sense=("{tmp}/out.png",), nonsense=RESULTS, codes=(2, 6))
EVALUATE = "tests/evaluate/test_coc_command.py"
JOB = "tests/farm/test_farm.py"

TALK_ELSEWHERE = {
    name: row if name in ("help", "version") else replace(row, elsewhere=EVALUATE)
    for name, row in TALK.items()
}

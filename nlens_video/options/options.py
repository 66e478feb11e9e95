"""The command line's words, turned into `Settings`. Imports nothing heavy: `--help` is quick."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from difflib import get_close_matches
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.options.evaluate_options import bench_parser, evaluate_parser, study_parser
from nlens_video.options.farm_options import (
    add_chunk,
    add_farm,
    jobs_parser,
    lists_jobs,
    merge_parser,
)
from nlens_video.options.lens_options import add_effects, add_tracking
from nlens_video.options.light_options import add_light
from nlens_video.options.object_options import (
    add_placing,
    add_playback,
)
from nlens_video.options.occlusion_options import add_real
from nlens_video.options.parser import (
    Parser,
    add_encoding,
    add_overwrite,
    add_plate,
    add_range,
    add_result,
    base_parser,
    number,
    path,
    positive,
)
from nlens_video.options.realtime_options import add_live
from nlens_video.options.side_options import (
    check_parser,
    completion_parser,
    doctor_parser,
    place_parser,
)

COMMANDS = (
    "render", "fit", "farm", "merge", "place", "check", "evaluate", "bench", "study", "doctor",
    "completion",
)  # fmt: skip

_ABOUT = """\
Put a rendered, animated object into real footage as if the same lens had filmed it.

  nlens-video IN ANIM.glb OUT         composite; short for `nlens-video render`
  nlens-video fit IN ANIM.glb FIT     find the lens only, and keep it as JSON
  nlens-video farm IN ANIM.glb OUT    the same, by many processes or machines
  nlens-video merge OUT CHUNK... --from IN   join what --as-chunk has rendered
  nlens-video place IN ANIM.glb OUT.png   where an object without a camera could stand
  nlens-video check OUT --against IN  is a result steady, its plate untouched; 1 where it is not
  nlens-video evaluate coc|composite|scene|sequences FOLDER   against rendered ground truth
  nlens-video bench [FOLDER]          what accuracy costs in time, preset by preset
  nlens-video study make|analyse      the paper's user study: its page, and its answers
  nlens-video doctor                  what works on this machine, and what to install
  nlens-video completion bash|zsh|fish    what makes the Tab key complete these words
"""

_OFTEN = frozenset(
    "--report --preset --effects --range --frame --fit --at --animation --env --shadow-strength "
    "--holdout --budget-ms --codec --crf --plan --json --version".split()
)


def parse(argv: list[str]) -> argparse.Namespace:
    """Read the words; `command` of the result is one of COMMANDS.

    Raises:
        UsageError: unknown or malformed arguments.
    """
    named = bool(argv) and argv[0] in COMMANDS
    command = "render"
    if named:
        command, argv = argv[0], argv[1:]
    else:
        _check_command(argv)
    many = command == "farm" and lists_jobs(argv)
    parser = jobs_parser() if many else parser_of(command)
    if command == "render" and not named:
        parser.often, parser.whole = _OFTEN, "nlens-video render"
    namespace = parser.parse_args(argv)
    namespace.command = command
    return namespace


def _check_command(argv: list[str]) -> None:
    """Refuse a first word that looks like a command's name, and is neither one nor a file."""
    word = argv[0] if argv else ""
    if (
        not re.fullmatch("[a-z][a-z-]*", word)
        or any(one.startswith("--input-f") for one in argv)
        or Path(word).exists()
    ):
        return
    near = get_close_matches(word, COMMANDS, n=1)
    if not near and len(argv) > 1:
        return
    meant = f"did you mean {near[0]}? See" if near else f"commands are {', '.join(COMMANDS)}; see"
    raise UsageError(f"{word!r} is neither a command nor a file; {meant} nlens-video --help")


def parser_of(command: str) -> Parser:
    """The parser of one of COMMANDS."""
    parsers: dict[str, Callable[[], Parser]] = {
        "render": _render_parser,
        "fit": _fit_parser,
        "farm": _farm_parser,
        "merge": merge_parser,
        "place": place_parser,
        "check": check_parser,
        "evaluate": evaluate_parser,
        "bench": bench_parser,
        "study": study_parser,
        "doctor": doctor_parser,
        "completion": completion_parser,
    }
    return parsers[command]()


def _add_common(parser: Parser) -> None:
    add_plate(parser, "video, still, plate_%%04d.png, device, URL, -")
    parser.add_argument("glb", metavar="ANIM.glb", type=path, help="the animated object (glTF 2.0)")
    look = parser.add_argument_group("the object")
    look.add_argument("--camera", metavar="NAME", help="the GLB's camera (default: its first)")
    look.add_argument("--scene", metavar="NAME", help="the GLB's scene (default: as it says)")
    look.add_argument("--layers", metavar="P.exr", help="pre-rendered RGBA + Z layers, or %%04d")
    look.add_argument(
        "--ground-y",
        metavar="Y",
        type=number,
        help="height of the ground plane in the GLB's units (default: the object's lowest point)",
    )
    look.add_argument("--footprint", metavar="NODE", help="fit under this object (default: all)")
    add_playback(parser)
    add_placing(parser)
    add_light(parser)
    add_real(parser)
    lens = parser.add_argument_group("the lens")
    lens.add_argument(
        "--preset",
        default="standard",
        metavar="NAME",
        help="draft, realtime, standard, reference, paper, or an own .toml",
    )
    lens.add_argument(
        "--device",
        choices=("auto", "cpu", "cuda"),
        default="auto",
        help="where networks and kernels run",
    )
    lens.add_argument(
        "--fallback",
        choices=("none", "constant"),
        default="none",
        help="what if no lens fit is possible: stop, or one CoC for the whole object",
    )
    lens.add_argument(
        "--aperture",
        default="round",
        metavar="A",
        help="its shape: round, BLADES[:TURN[:ROUNDNESS]] as 6:15:0.2, or a picture A.png",
    )
    lens.add_argument(
        "--cat-eye",
        default=0.0,
        metavar="S",
        type=number,
        help="how much the aperture narrows towards the corners, 0 to 1",
    )
    add_range(parser)
    shown = parser.add_argument_group("what is shown")
    shown.add_argument("--report", metavar="DIR", type=path, help="a self-contained HTML report")
    add_overwrite(parser)
    shown.add_argument("--no-progress", action="store_true", help="no progress bar")


def _render_parser() -> Parser:
    parser = base_parser("nlens-video", _ABOUT)
    add_chunk(_add_run(parser))
    return parser


def _farm_parser() -> Parser:
    about = "Composite in chunks on a Ray cluster, by default one on this machine."
    parser = base_parser("nlens-video farm", about)
    _add_run(parser)
    add_farm(parser)
    return parser


def _add_run(parser: Parser) -> argparse._ArgumentGroup:
    _add_common(parser)
    add_result(parser, "video, still, out_%%04d.png, pipe, URL, -")
    add_effects(parser)
    add_tracking(parser)
    run = parser.add_argument_group("the run")
    run.add_argument(
        "--budget-ms", metavar="MS", type=positive, default=180.0,
        help="what a frame may take, in milliseconds (180)",
    )  # fmt: skip
    add_live(run)
    run.add_argument("--fit", metavar="FIT.json", type=path, help="use this lens fit")
    run.add_argument("--save-fit", metavar="FIT.json", type=path, help="keep the lens fit")
    run.add_argument("--aov", metavar="DIR", type=path, help="EXR layers of each frame")
    run.add_argument("--timings", metavar="T.json", type=path, help="time of each node and frame")
    run.add_argument("--plan", action="store_true", help="print what would run and why, then stop")
    add_encoding(parser)
    return run


def _fit_parser() -> Parser:
    parser = base_parser("nlens-video fit", "Find the lens of a plate and keep it as JSON.")
    _add_common(parser)
    parser.add_argument("save_fit", metavar="FIT.json", type=path, help="the lens fit to write")
    add_tracking(parser)
    parser.set_defaults(track_focus="off")
    return parser

"""The command line's words, turned into `Settings`. Imports nothing heavy: `--help` is quick."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import NoReturn

from nlens_video import __version__
from nlens_video.aperture import parse_aperture
from nlens_video.errors import UsageError
from nlens_video.placing import Placing
from nlens_video.playback import ALL, Playback
from nlens_video.settings import ObjectSettings, OutputSettings, Settings, SourceSettings

COMMANDS = ("render", "fit", "evaluate", "bench", "doctor")
PLANNED = ("farm", "merge", "place", "check", "study")

_ABOUT = """\
Put a rendered, animated object into real footage as if the same lens had filmed it.

  nlens-video IN ANIM.glb OUT         composite; short for `nlens-video render`
  nlens-video fit IN ANIM.glb FIT     find the lens only, and keep it as JSON
  nlens-video evaluate coc FOLDER     accuracy of estimate and fit on rendered ground truth
  nlens-video bench [FOLDER]          what accuracy costs in time, preset by preset
  nlens-video doctor                  what works on this machine, and what to install
"""


class _Parser(argparse.ArgumentParser):
    """Errors are ours: one line, no usage dump."""

    def error(self, message: str) -> NoReturn:
        raise UsageError(f"{message}; see {self.prog} --help")


def parse(argv: list[str]) -> argparse.Namespace:
    """Read the words; `command` of the result is one of COMMANDS.

    Raises:
        UsageError: unknown or malformed arguments.
    """
    command = "render"
    if argv and argv[0] in PLANNED and not Path(argv[0]).exists():
        raise UsageError(f"{argv[0]} is not in this version; there are {', '.join(COMMANDS)}")
    if argv and argv[0] in COMMANDS:
        command, argv = argv[0], argv[1:]
    parsers = {
        "render": _render_parser,
        "fit": _fit_parser,
        "evaluate": _evaluate_parser,
        "bench": _bench_parser,
        "doctor": _doctor_parser,
    }
    parser = parsers[command]()
    namespace = parser.parse_args(argv)
    namespace.command = command
    return namespace


def settings(words: argparse.Namespace) -> Settings:
    """Settings of `render` and `fit`."""
    output = None
    if words.command == "render":
        output = OutputSettings(
            spec=words.output,
            codec=words.codec,
            crf=words.crf,
            pix_fmt=words.pix_fmt,
            keep_partial=words.keep_partial,
        )
    return Settings(
        source=SourceSettings(
            spec=words.input,
            input_format=words.input_format,
            input_size=words.input_size,
            input_rate=words.input_rate,
            frames=words.range,
        ),
        scene=_object(words),
        output=output,
        preset=words.preset,
        effects="defocus" if words.command == "fit" else words.effects,
        budget_ms=getattr(words, "budget_ms", 180.0),
        device=words.device,
        aperture=parse_aperture(words.aperture, cat_eye=words.cat_eye),
        fit=getattr(words, "fit", None),
        save_fit=words.save_fit,
        fallback=words.fallback,
        report=words.report,
        aov=getattr(words, "aov", None),
        timings=getattr(words, "timings", None),
    )


def _object(words: argparse.Namespace) -> ObjectSettings:
    return ObjectSettings(
        glb=words.glb,
        camera=words.camera,
        layers=words.layers,
        ground_y=words.ground_y,
        playback=Playback(
            animation=words.animation,
            loop=words.loop,
            speed=words.animation_speed,
            offset_s=words.animation_offset,
        ),
        placing=_placing(words),
        footprint=words.footprint,
    )


def _placing(words: argparse.Namespace) -> Placing | None:
    given = {"yaw_deg": words.yaw, "horizon": words.horizon}
    given = {name: value for name, value in given.items() if value is not None}
    if words.at is None and words.size is None and not given:
        return None
    if words.at is None or words.size is None:
        raise UsageError("to place the object give both --at X,Y and --size S; see --help")
    if words.camera is not None:
        raise UsageError("--camera and --at place the object twice; leave one of them out")
    return Placing(at=words.at, size=words.size, **given)


def _point(text: str) -> tuple[float, float]:
    try:
        x, y = map(float, text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not X,Y, such as 0.5,0.8") from None
    return x, y


def _frames(text: str) -> tuple[int, int | None]:
    first, colon, end = text.partition(":")
    try:
        frames = (int(first or 0), int(end) if end else None)
    except ValueError:
        colon = ""
    if not colon or frames[0] < 0 or (frames[1] is not None and frames[1] <= frames[0]):
        raise argparse.ArgumentTypeError(f"{text!r} is not A:B with 0 <= A < B")
    return frames


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition("x")
    if not (width.isdigit() and height.isdigit() and int(width) and int(height)):
        raise argparse.ArgumentTypeError(f"{text!r} is not WIDTHxHEIGHT, such as 960x512")
    return int(width), int(height)


def _positive(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is not a positive number")
    return value


def _base(prog: str, description: str) -> _Parser:
    parser = _Parser(
        prog=prog, description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"nlens-video {__version__}")
    parser.add_argument("-v", "--verbose", action="store_true", help="tell more; tracebacks")
    parser.add_argument("-q", "--quiet", action="store_true", help="errors only")
    parser.add_argument("--json", action="store_true", help="print the summary as JSON")
    return parser


def _add_common(parser: _Parser) -> None:
    parser.add_argument("input", metavar="IN", help="video, still, plate_%%04d.png, device, URL, -")
    parser.add_argument("glb", metavar="ANIM.glb", type=Path, help="the animated object (glTF 2.0)")
    look = parser.add_argument_group("the object")
    look.add_argument("--camera", metavar="NAME", help="the GLB's camera (default: its first)")
    look.add_argument("--layers", metavar="P.exr", help="pre-rendered RGBA + Z layers, or %%04d")
    look.add_argument("--ground-y", metavar="Y", type=float, help="height of the ground plane")
    look.add_argument("--footprint", metavar="NODE", help="fit under this object (default: all)")
    _add_playback(parser)
    _add_placing(parser)
    lens = parser.add_argument_group("the lens")
    lens.add_argument("--preset", default="standard", metavar="NAME", help="pipeline, or own .toml")
    lens.add_argument("--device", choices=("auto", "cpu", "cuda"), default="auto")
    lens.add_argument(
        "--fallback", choices=("none", "constant"), default="none", help="if no fit is possible"
    )
    lens.add_argument(
        "--aperture", default="round", metavar="A", help="round, BLADES[:TURN[:ROUNDNESS]], A.png"
    )
    lens.add_argument(
        "--cat-eye", default=0.0, metavar="S", type=float, help="towards corners, 0 to 1"
    )
    raw = parser.add_argument_group("the plate")
    raw.add_argument("--input-format", metavar="F", help="FFmpeg's name: rawvideo, lavfi, v4l2 …")
    raw.add_argument("--input-size", metavar="WxH", type=_size, help="of raw video")
    raw.add_argument("--input-rate", metavar="FPS", help="of raw video, stills, sequences")
    raw.add_argument(
        "--range", metavar="A:B", type=_frames, default=(0, None), help="frames A to B-1"
    )
    shown = parser.add_argument_group("what is shown")
    shown.add_argument("--report", metavar="DIR", type=Path, help="a self-contained HTML report")
    shown.add_argument("--no-progress", action="store_true")


def _add_playback(parser: _Parser) -> None:
    played = parser.add_argument_group("its animation (a moving camera keeps the plate's time)")
    played.add_argument("--animation", metavar="NAME", default=ALL, help="name, number, or all")
    played.add_argument("--loop", action="store_true", help="start again, not rest at the end")
    played.add_argument("--animation-speed", metavar="S", type=_positive, default=1.0)
    played.add_argument(
        "--animation-offset", metavar="SEC", type=float, default=0.0, help="where it starts"
    )


def _add_placing(parser: _Parser) -> None:
    placed = parser.add_argument_group(
        "its place if the GLB has no camera (fractions of the frame)"
    )
    placed.add_argument("--at", metavar="X,Y", type=_point, help="where it touches the ground")
    placed.add_argument("--size", metavar="S", type=float, help="its height")
    placed.add_argument("--yaw", metavar="D", type=float, help="turn in degrees (default 0)")
    placed.add_argument("--horizon", metavar="H", type=float, help="row of it (default 0.5: level)")


def _render_parser() -> _Parser:
    parser = _base("nlens-video", _ABOUT)
    _add_common(parser)
    parser.add_argument("output", metavar="OUT", help="video, still, out_%%04d.png, -")
    run = parser.add_argument_group("the run")
    run.add_argument("--effects", default="auto", metavar="E", help="auto, none, or: defocus")
    run.add_argument("--budget-ms", metavar="MS", type=_positive, default=180.0)
    run.add_argument("--fit", metavar="FIT.json", type=Path, help="use this lens fit")
    run.add_argument("--save-fit", metavar="FIT.json", type=Path, help="keep the lens fit")
    run.add_argument("--aov", metavar="DIR", type=Path, help="EXR layers of each frame")
    run.add_argument("--timings", metavar="T.json", type=Path, help="time of each node and frame")
    run.add_argument("--plan", action="store_true", help="print what would run and why, then stop")
    out = parser.add_argument_group("the encoding (default: as the source)")
    out.add_argument("--codec", metavar="NAME")
    out.add_argument("--crf", metavar="Q", type=float)
    out.add_argument("--pix-fmt", metavar="NAME")
    out.add_argument("--keep-partial", action="store_true", help="keep what an interrupt leaves")
    return parser


def _fit_parser() -> _Parser:
    parser = _base("nlens-video fit", "Find the lens of a plate and keep it as JSON.")
    _add_common(parser)
    parser.add_argument("save_fit", metavar="FIT.json", type=Path)
    return parser


def _evaluate_parser() -> _Parser:
    about = "Measure stages on plates with known lens: rendered ground truth, a folder a plate."
    parser = _base("nlens-video evaluate", about)
    parser.add_argument("what", choices=("coc",), help="coc: the plate's CoC and the lens fit")
    parser.add_argument("folder", metavar="FOLDER", type=Path, help="one folder in it a plate")
    parser.add_argument("--out", metavar="DIR", type=Path, help="tables (Markdown, CSV) and plots")
    return parser


def _bench_parser() -> _Parser:
    about = "Measure every preset, and others' methods, against the sampled lens: what it costs."
    parser = _base("nlens-video bench", about)
    parser.add_argument(
        "folder", metavar="FOLDER", type=Path, nargs="?", help="plates rendered with their object"
    )
    parser.add_argument("--out", metavar="DIR", type=Path, help="bench.md, bench.csv, bench.png")
    parser.add_argument("--quick", action="store_true", help="a coarser truth, fewer frames")
    return parser


def _doctor_parser() -> _Parser:
    return _base("nlens-video doctor", "What works on this machine, and what to install.")

"""The command line's words of the commands that make no composite."""

from __future__ import annotations

from nlens_video.options.object_options import add_placing, add_playback
from nlens_video.options.parser import (
    Parser,
    add_overwrite,
    add_plate,
    add_range,
    base_parser,
    count,
    number,
    path,
    plate_name,
)


def place_parser() -> Parser:
    """The words of `place`."""
    about = "Draw choices of --at, --size, --yaw, --horizon, round those given, on the first frame."
    parser = base_parser("nlens-video place", about)
    add_plate(parser, "the plate, as of nlens-video")
    parser.add_argument("glb", metavar="ANIM.glb", type=path, help="the object (glTF 2.0)")
    parser.add_argument("output", metavar="OUT.png", type=path, help="the contact sheet")
    add_overwrite(parser)
    parser.add_argument(
        "--ground-y",
        metavar="Y",
        type=number,
        help="height of the ground plane in the GLB's units (default: the object's lowest point)",
    )
    parser.add_argument("--scene", metavar="NAME", help="the GLB's scene (default: as it says)")
    add_playback(parser)
    add_placing(parser)
    add_range(parser)
    return parser


def check_parser() -> Parser:
    """The words of `check`."""
    about = (
        "Compare a result with its plate: frames, times, plate pixels, jumps, flicker, audio.\n"
        "Exit code 0: fine; 1: something was found; 2 to 6 are errors, as everywhere."
    )
    parser = base_parser("nlens-video check", about)
    parser.add_argument(
        "result", metavar="OUT", type=plate_name, help="what nlens-video has written"
    )
    parser.add_argument(
        "--against", dest="input", metavar="IN", type=plate_name, required=True, help="its plate"
    )
    parser.add_argument(
        "--objects", metavar="N", type=count, default=1, help="separate changed places (1)"
    )
    parser.add_argument("--report", metavar="DIR", type=path, help="a page with the plots")
    add_overwrite(parser)
    add_range(parser, "the plate's frames A to B-1 became OUT (default: found by OUT's first one)")
    parser.set_defaults(range=None)
    return parser


def doctor_parser() -> Parser:
    """The words of `doctor`."""
    return base_parser("nlens-video doctor", "What works on this machine, and what to install.")


def completion_parser() -> Parser:
    """The words of `completion`."""
    about = 'The shell\'s completion of nlens-video: eval "$(nlens-video completion bash)"'
    parser = base_parser("nlens-video completion", about)
    parser.add_argument("shell", choices=("bash", "zsh", "fish"), help="which shell")
    return parser

"""The command line's words about chunks: made one by one, on a farm, and merged."""

from __future__ import annotations

import argparse

from nlens_video.options.parser import (
    Parser,
    add_encoding,
    add_overwrite,
    add_result,
    add_source,
    base_parser,
    count,
    path,
    plate_name,
    positive,
)


def add_chunk(parser: argparse._ArgumentGroup) -> None:
    """Whether the range becomes a chunk, or the whole is made of them."""
    parser.add_argument(
        "--as-chunk", action="store_true", help="OUT is a folder of chunks for merge; needs --fit"
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on where a killed run with --resume was"
    )


def add_farm(parser: Parser) -> None:
    """Who renders, and in which parts."""
    farm = _add_workers(parser)
    farm.add_argument("--chunks", metavar="DIR|URL", help="keep chunks here (default: none stay)")
    farm.add_argument(
        "--jobs", metavar="JOBS.toml", help="many shots, in place of IN, ANIM.glb, OUT"
    )


def lists_jobs(argv: list[str]) -> bool:
    """Whether the words of `farm` name a list of shots in place of one."""
    return any(word.partition("=")[0] == "--jobs" for word in argv)


def jobs_parser() -> Parser:
    """The words of `farm --jobs`."""
    parser = base_parser("nlens-video farm --jobs", "Composite many shots on a Ray cluster.")
    parser.add_argument(
        "--jobs", metavar="JOBS.toml", type=path, required=True,
        help="a [[shot]] for each, with in, object, out, and options, a list of words",
    )  # fmt: skip
    _add_workers(parser)
    add_overwrite(parser)
    parser.add_argument("--no-progress", action="store_true", help="no progress bar")
    return parser


def _add_workers(parser: Parser) -> argparse._ArgumentGroup:
    farm = parser.add_argument_group("the farm")
    farm.add_argument(
        "--workers", metavar="N", type=count, help="processes (default: one to two processors)"
    )
    farm.add_argument(
        "--chunk", metavar="SECONDS", type=positive, default=10.0, help="length of a chunk (10)"
    )
    farm.add_argument("--address", metavar="A", help="Ray cluster: auto, ray://HOST:PORT")
    return farm


def merge_parser() -> Parser:
    """The words of `merge`."""
    about = "Join the chunks of a run: times checked, encoded once, the rest as in IN."
    parser = base_parser("nlens-video merge", about)
    add_result(parser, "video, out_%%04d.png, pipe, -")
    parser.add_argument(
        "chunks", metavar="CHUNK", type=path, nargs="+", help="files or folders of --as-chunk"
    )
    parser.add_argument(
        "--from", dest="input", metavar="IN", type=plate_name, required=True,
        help="the plate they were made from",
    )  # fmt: skip
    add_source(parser)
    add_encoding(parser)
    add_overwrite(parser)
    parser.add_argument("--no-progress", action="store_true", help="no progress bar")
    return parser

"""The command line's words of what measures: `evaluate`, `bench` and `study`."""

from __future__ import annotations

import argparse

from nlens_video.options.parser import Parser, add_overwrite, base_parser, path


def evaluate_parser() -> Parser:
    """The words of `evaluate`."""
    about = "Measure stages on plates with known lens: rendered ground truth, a folder a plate."
    parser = base_parser("nlens-video evaluate", about)
    parser.add_argument(
        "what",
        choices=("coc", "composite", "scene", "sequences"),
        help="the plate's CoC and the lens fit; composites; the drawn object and its shadow; "
        "clips by the lens found against the true one",
    )
    parser.add_argument("folder", metavar="FOLDER", type=path, help="one folder in it a plate")
    parser.add_argument("--out", metavar="DIR", type=path, help="tables (Markdown, CSV) and plots")
    return parser


def bench_parser() -> Parser:
    """The words of `bench`."""
    about = "Measure every preset, and others' methods, against the sampled lens: what it costs."
    parser = base_parser("nlens-video bench", about)
    parser.add_argument(
        "folder", metavar="FOLDER", type=path, nargs="?", help="plates rendered with their object"
    )
    parser.add_argument("--out", metavar="DIR", type=path, help="bench.md, bench.csv, bench.png")
    parser.add_argument("--quick", action="store_true", help="a coarser truth, fewer frames")
    return parser


def study_parser() -> Parser:
    """The words of `study`."""
    about = "The paper's user study: a web page that asks, and what its answers say."
    parser = base_parser("nlens-video study", about)
    kinds = parser.add_subparsers(dest="what", required=True, metavar="make|analyse")
    make = kinds.add_parser("make", help="pictures and their stimuli.csv to one web page")
    make.add_argument(
        "folder", metavar="FOLDER", type=path, nargs="?", help="pictures and stimuli.csv"
    )
    make.add_argument("--demo", action="store_true", help="pictures of rendered balls on a table")
    make.add_argument("page", metavar="OUT.html", type=path, help="the page")
    add_overwrite(make)
    make.add_argument("--choices", metavar="LIST", help="answers, such as red,green,blue")
    make.add_argument("--things", default="billiard balls", help="what is looked for")
    answers = kinds.add_parser("analyse", help="failure rates and z-tests of saved answers")
    answers.add_argument("answers", metavar="ANSWERS", type=path, nargs="+", help="JSON or CSV")
    answers.add_argument("--reference", metavar="METHOD", default="ours", help="tested against")
    answers.add_argument(
        "--json", action="store_true", default=argparse.SUPPRESS, help="print the tables as JSON"
    )
    return parser

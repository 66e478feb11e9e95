"""The command `studio`: the page in the browser that edits a shot file."""

from __future__ import annotations

from argparse import Namespace
from functools import partial
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.options.shot_file import is_shot_file


def run_studio(args: Namespace) -> int:
    """The command `studio`; an interrupt is how it ends."""
    from nlens_video.cli.output_files import check_outputs
    from nlens_video.cli.solve_command import camera_and_lines
    from nlens_video.studio.address import Address
    from nlens_video.studio.command import serve

    alone = args.glb is None
    if alone and (not is_shot_file(args.input) or args.shot is not None):
        raise UsageError("studio: give IN and ANIM.glb, or a shot file by itself")
    plate, shot = (None, Path(args.input)) if alone else (args.input, args.shot)
    place = Address.of(args.host, args.port, unencrypted=args.i_know_it_is_unencrypted)
    check = partial(check_outputs, overwrite=True)  # a render replaces what is there
    serve(plate, args.glb, shot, place, camera_and_lines, check, browser=not args.no_browser)
    return 0

"""Serving the studio until it is interrupted."""

from __future__ import annotations

import webbrowser
from contextlib import closing, suppress
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.core.stdio import print_out
from nlens_video.graph.base.objects_on_ground import load_scene
from nlens_video.studio.address import Address
from nlens_video.studio.shot_state import Check, ShotState
from nlens_video.studio.stage import Solve

_DEFAULT = Path("shot.toml")
_LEAVE_S = 2  # for requests that still run when it ends


def serve(
    plate: str | None, glb: Path | None, shot: Path | None, address: Address, solve: Solve,
    check: Check, *, browser: bool,
) -> None:  # fmt: skip
    """Print the page's address, and serve it until a signal arrives.

    Args:
        plate: the plate, None for that of the shot file.
        glb: the object, None for that of the shot file.
        shot: the shot file that is edited, None for `shot.toml` in this folder.
        address: where it listens.
        solve: solves the plate's camera.
        check: as of `ShotState`.
        browser: whether to open the page in a browser.

    Raises:
        UsageError: a library is missing, the address cannot be used, or the shot cannot be read.
        InputError: the plate cannot be read.
        SceneError: the object cannot be used.
    """
    try:
        import uvicorn

        from nlens_video.studio.access import Guard, new_token
        from nlens_video.studio.app import Studio
    except ImportError as error:
        raise UsageError(
            f"nlens-video studio needs {error.name}; pip install 'nlens-video[studio]'"
        ) from error
    state = ShotState.opened(_chosen(shot, plate, glb), plate, glb, check)
    load_scene(state.settings(state.tables).scene)  # a file that is wrong is told at once
    token = new_token()
    with address.listen() as listening, closing(Studio(state, token, solve)) as studio:
        port = listening.getsockname()[1]
        config = uvicorn.Config(
            Guard(studio.app, token, address.names, port), log_level="error", access_log=False,
            lifespan="off", ws="websockets-sansio", ws_max_size=1 << 20, server_header=False,
            timeout_graceful_shutdown=_LEAVE_S,
        )  # fmt: skip
        page = f"http://{address.host}:{port}/?token={token}"
        print_out(f"{page}\n")
        if browser:
            webbrowser.open(page)
        with suppress(KeyboardInterrupt):  # how it ends
            uvicorn.Server(config).run(sockets=[listening])


def _chosen(shot: Path | None, plate: str | None, glb: Path | None) -> Path:
    """The shot file to edit: one that is there is gone on with only where it is named."""
    if shot is not None:
        return shot
    if _DEFAULT.exists():
        raise UsageError(
            f"{_DEFAULT} is here already; give --shot {_DEFAULT} to go on with it, or another name"
        )
    return _DEFAULT

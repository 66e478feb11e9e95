"""Serving the studio until it is interrupted."""

from __future__ import annotations

import socket
import webbrowser
from contextlib import closing, suppress
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.core.stdio import print_out
from nlens_video.graph.base.objects_on_ground import load_scene
from nlens_video.studio.shot_state import ShotState
from nlens_video.studio.stage import Solve

_HOST = "127.0.0.1"
_DEFAULT = Path("shot.toml")
_LEAVE_S = 2  # for requests that still run when it ends


def serve(
    plate: str | None, glb: Path | None, shot: Path | None, port: int, solve: Solve, *,
    browser: bool,
) -> None:  # fmt: skip
    """Print the page's address, and serve it until a signal arrives.

    Args:
        plate: the plate, None for that of the shot file.
        glb: the object, None for that of the shot file.
        shot: the shot file that is edited, None for `shot.toml` in this folder.
        port: where it listens, 0 for a free one.
        solve: solves the plate's camera.
        browser: whether to open the page in a browser.

    Raises:
        UsageError: a library is missing, the port is taken, or the shot cannot be read.
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
    state = ShotState.opened(_chosen(shot, plate, glb), plate, glb)
    load_scene(state.settings(state.tables).scene)  # a file that is wrong is told at once
    token = new_token()
    with _listen(port) as listening, closing(Studio(state, token, solve)) as studio:
        port = listening.getsockname()[1]
        config = uvicorn.Config(
            Guard(studio.app, token, port), log_level="error", access_log=False, lifespan="off",
            ws="websockets-sansio", ws_max_size=1 << 20, server_header=False,
            timeout_graceful_shutdown=_LEAVE_S,
        )  # fmt: skip
        address = f"http://{_HOST}:{port}/?token={token}"
        print_out(f"{address}\n")
        if browser:
            webbrowser.open(address)
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


def _listen(port: int) -> socket.socket:
    """A listening socket of this machine alone.

    Raises:
        UsageError: the port is taken, or may not be used.
    """
    listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((_HOST, port))
        listening.listen()
    except OSError as error:
        listening.close()
        raise UsageError(
            f"--port {port}: cannot be used ({error.strerror}); give another, or leave it out"
        ) from error
    return listening

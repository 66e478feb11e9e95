"""The server's addresses: page, shot, frames, pictures as they are made, render."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field
from functools import cached_property
from importlib.resources import files
from typing import Any

from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.requests import Request
from starlette.responses import (
    FileResponse,
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    Response,
)
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket

from nlens_video.core.errors import NlensError
from nlens_video.studio.objects import object_files
from nlens_video.studio.open_plate import MOST_PX
from nlens_video.studio.plate_frames import PlateFrames, to_jpeg
from nlens_video.studio.previews import KINDS, Answer, Previews, Wish
from nlens_video.studio.render_job import RenderJob, ResultExistsError
from nlens_video.studio.shot_state import ShotChangedError, ShotState
from nlens_video.studio.stage import Solve, Stage

_PAGE = files("nlens_video.studio").joinpath("page")
_TYPES = {".js": "text/javascript", ".css": "text/css", ".svg": "image/svg+xml"}
_THUMBNAIL_PX = 128 * 96
_MOST_BYTES = 1 << 20  # of a message of the page: a shot is a few hundred bytes
_MOST_READ = 1 << 26  # of one that is too large: whoever still sends does not read the answer
_MOST_FRAMES = 1 << 31
Endpoint = Callable[[Request], Awaitable[Response]]


@dataclass(slots=True, eq=False)
class _Page:
    """An open page: what waits to be sent to it."""

    loop: asyncio.AbstractEventLoop
    queue: asyncio.Queue[str | bytes] = field(default_factory=asyncio.Queue)

    def send(self, message: str | bytes) -> None:
        """From any thread."""
        if not self.loop.is_closed():
            self.loop.call_soon_threadsafe(self.queue.put_nowait, message)


class Studio:
    """The server without its sockets.

    Args:
        shot: what the pages edit.
        token: part of the page's addresses.
        solve: solves the plate's camera.
    """

    def __init__(self, shot: ShotState, token: str, solve: Solve) -> None:
        self._shot = shot
        self._token = token
        self._pages: set[_Page] = set()
        source = shot.settings(shot.tables).source
        self._frames = PlateFrames(source, MOST_PX)
        self._thumbnails = PlateFrames(source, _THUMBNAIL_PX)
        self.previews = Previews(shot, Stage(solve), self._tell)
        self.render = RenderJob(self._tell)

    def close(self) -> None:
        """End threads and processes."""
        self.render.close()
        self.previews.close()
        self._frames.close()
        self._thumbnails.close()

    @cached_property
    def app(self) -> Starlette:
        """The addresses, without the token that `access.Guard` takes off them."""
        return Starlette(routes=[
            Route("/", self._index),
            Route("/page/{name}", self._file),
            Route("/shot", _telling(self._about)),
            Route("/save", _telling(self._save), methods=["POST"]),
            Route("/command", _telling(self._command), methods=["POST"]),
            Route("/frame/{number}", _telling(self._frame)),
            Route("/thumbnail/{number}", _telling(self._thumbnail)),
            Route("/render", _telling(self._render), methods=["POST", "DELETE"]),
            Route("/result", _telling(self._result)),
            WebSocketRoute("/live", self._live),
        ])  # fmt: skip

    async def _index(self, request: Request) -> Response:
        text = _PAGE.joinpath("index.html").read_text(encoding="utf-8")
        return HTMLResponse(text.replace("{token}", self._token))

    async def _file(self, request: Request) -> Response:
        name = request.path_params["name"]
        kinds = [one for one in _TYPES if name.endswith(one)]
        if not kinds or name not in {one.name for one in _PAGE.iterdir()}:
            return PlainTextResponse("There is no such file.\n", 404)
        return Response(_PAGE.joinpath(name).read_bytes(), media_type=_TYPES[kinds[0]])

    async def _about(self, request: Request) -> Response:
        info = self._frames.info
        count = await run_in_threadpool(self._frames.count)
        tables, revision = await run_in_threadpool(self._shot.read)
        rate = float(info.average_rate) if info.average_rate else 0.0
        return JSONResponse({
            "tables": tables,
            "path": str(self._shot.path),
            "revision": revision,
            "plate": {
                "name": info.name, "frames": count, "rate": rate, "width": info.width,
                "height": info.height, "aspect": info.width * info.pixel_aspect / info.height,
                "shown": list(self._frames.size), "reduced": self._frames.reduced,
            },
            "environments": await run_in_threadpool(self._shot.environments),
            "objects": await run_in_threadpool(object_files, self._shot.path.parent),
        })  # fmt: skip

    async def _save(self, request: Request) -> Response:
        return JSONResponse({"revision": await self._saved(await _tables(request), request)})

    async def _saved(self, tables: dict[str, Any], request: Request) -> str:
        """Save the shot unless its file has another revision than the one given; the new one."""
        revision = request.query_params.get("revision")
        return await run_in_threadpool(self._shot.save, tables, revision)

    async def _command(self, request: Request) -> Response:
        return JSONResponse({"command": self._shot.command(await _tables(request))})

    async def _frame(self, request: Request) -> Response:
        return await self._picture(self._frames, request)

    async def _thumbnail(self, request: Request) -> Response:
        return await self._picture(self._thumbnails, request)

    async def _picture(self, frames: PlateFrames, request: Request) -> Response:
        number = request.path_params["number"]
        if not (number.isdecimal() and len(number) < 10):
            raise NlensError("expected the number of a frame")
        frame = await run_in_threadpool(frames.frame, int(number))
        data = await run_in_threadpool(to_jpeg, frame.picture)
        return Response(data, media_type="image/jpeg")

    async def _render(self, request: Request) -> Response:
        if request.method == "DELETE":
            await run_in_threadpool(self.render.cancel)
            return JSONResponse({})
        self.render.check_free()
        tables = await _tables(request)
        target = self._shot.result(tables)
        if target is not None and "replace" not in request.query_params:
            await run_in_threadpool(self.render.check_target, target)
        revision = await self._saved(tables, request)
        self.render.start(self._shot.path, target)
        return JSONResponse({"revision": revision})

    async def _result(self, request: Request) -> Response:
        path = self.render.result
        if path is None or not path.is_file():
            return PlainTextResponse("There is no result yet.\n", 404)
        return FileResponse(path)

    async def _live(self, socket: WebSocket) -> None:
        """Wishes for pictures in; pictures and progress out, first how far a render is by now."""
        await socket.accept()
        page = _Page(asyncio.get_running_loop())
        self._pages.add(page)
        page.send(json.dumps(self.render.last))
        sender = asyncio.create_task(_send_all(socket, page.queue))
        try:
            while True:
                message = await socket.receive()
                if message["type"] == "websocket.disconnect":
                    break
                wish = _wish(message.get("text") or "")
                if wish is not None:
                    self.previews.ask(page, wish, lambda answer: page.send(_packed(answer)))
        finally:
            self._pages.discard(page)
            self.previews.forget(page)
            sender.cancel()

    def _tell(self, said: dict[str, Any]) -> None:
        for page in list(self._pages):
            page.send(json.dumps(said))


async def _send_all(socket: WebSocket, queue: asyncio.Queue[str | bytes]) -> None:
    while True:
        message = await queue.get()
        if isinstance(message, str):
            await socket.send_text(message)
        else:
            await socket.send_bytes(message)


def _telling(endpoint: Endpoint) -> Endpoint:
    """An endpoint whose errors become one line for the page."""

    async def answered(request: Request) -> Response:
        try:
            return await endpoint(request)
        except NlensError as error:
            kinds = (("shot", ShotChangedError), ("result", ResultExistsError))
            holds = next((name for name, kind in kinds if isinstance(error, kind)), "")
            return JSONResponse({"error": str(error), "holds": holds}, 409 if holds else 422)

    return answered


async def _tables(request: Request) -> dict[str, Any]:
    body, count = b"", 0
    async for part in request.stream():
        count += len(part)
        if count > _MOST_READ:
            break
        if count <= _MOST_BYTES:
            body += part
    if count > _MOST_BYTES:
        raise NlensError("the shot is too large")
    tables = _parsed(body)
    if not isinstance(tables, dict):
        raise NlensError("expected the shot's tables as JSON")
    return tables


def _parsed(text: str | bytes) -> Any:  # noqa: ANN401  as json.loads declares it
    """The content of JSON; None where it is none, or holds what no file of text can."""
    try:
        content = json.loads(text)
        json.dumps(content, ensure_ascii=False).encode()  # half a surrogate pair is no text
    except (ValueError, RecursionError):
        return None
    return content


def _wish(text: str) -> Wish | None:
    """A message as a wish, None where it is none."""
    if len(text) > _MOST_BYTES:
        return None
    said = _parsed(text)
    try:
        number, frame, kind = int(said["number"]), int(said["frame"]), said["kind"]
        tables = said["tables"]
    except (ValueError, OverflowError, KeyError, TypeError):
        return None
    if kind not in KINDS or not isinstance(tables, dict) or not 0 <= frame < _MOST_FRAMES:
        return None
    return Wish(number, tables, frame, kind)


def _packed(answer: Answer) -> bytes:
    """Length of the JSON (4 bytes, the most significant first), JSON, JPEG."""
    said = json.dumps(answer.said).encode()
    return len(said).to_bytes(4, "big") + said + answer.picture

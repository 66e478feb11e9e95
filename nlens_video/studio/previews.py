"""The thread that draws: of each page the latest wish only, one after the other."""

from __future__ import annotations

import threading
import time
import traceback
from collections import OrderedDict
from collections.abc import Callable, Hashable
from contextlib import suppress
from typing import Any, Literal

from msgspec import Struct, to_builtins

from nlens_video.core.errors import NlensError
from nlens_video.core.stdio import standard_error
from nlens_video.options.shot_objects import Tables
from nlens_video.solve.evidence import PlateLines
from nlens_video.studio.plate_frames import to_jpeg
from nlens_video.studio.sessions import QUICK
from nlens_video.studio.shot_state import ShotState
from nlens_video.studio.stage import Drawn, Stage

Kind = Literal["drag", "light", "rest", "sharp", "focus"]
KINDS: tuple[Kind, ...] = ("drag", "light", "rest", "sharp", "focus")
_PATIENCE_S = 10.0  # for the thread to end: an estimate of a network cannot be interrupted


class Wish(Struct, frozen=True):
    """A picture that a page wants.

    Attributes:
        number: by which the page knows it again.
        tables: the shot.
        frame: of the plate, from 0.
        kind: `drag` while something moves, `light` while the sun does, `rest` as it is rendered,
            `sharp` without a lens, `focus` the plate's blur in colours.
    """

    number: int
    tables: Tables
    frame: int
    kind: Kind


class Answer(Struct, frozen=True):
    """What a wish became.

    Attributes:
        said: about the picture, as JSON; with the key `error` what went wrong.
        picture: as a JPEG file, empty where there is none.
    """

    said: dict[str, Any]
    picture: bytes = b""


class Stopped(Exception):
    """The server closes."""


class Superseded(Exception):
    """Something newer is wished."""


class Previews:
    """Draws what pages wish on one thread.

    Args:
        shot: reads the shots.
        stage: draws them; used on the thread only.
        tell: told of progress, from the thread.
    """

    def __init__(
        self, shot: ShotState, stage: Stage, tell: Callable[[dict[str, Any]], None]
    ) -> None:
        self._shot = shot
        self._stage = stage
        self._tell = tell
        self._told_s = 0.0
        self._wishes: OrderedDict[Hashable, tuple[Wish, Callable[[Answer], None]]] = OrderedDict()
        self._wake = threading.Condition()
        self._closed = False
        self._page: Hashable = None  # whose picture is at hand
        self._urgent = False  # whether the picture at hand may not be given up
        stage.on_progress = self._on_progress
        stage.check = self._check
        self._thread = threading.Thread(target=self._run, name="nlens-studio", daemon=True)
        self._thread.start()

    def ask(self, page: Hashable, wish: Wish, deliver: Callable[[Answer], None]) -> None:
        """Put a wish in place of the page's last one, if that still waits.

        Args:
            page: which page asks.
            wish: the picture.
            deliver: called on the thread.
        """
        with self._wake:
            self._wishes[page] = wish, deliver
            self._wake.notify()

    def forget(self, page: Hashable) -> None:
        """Drop what a page that is closed still waits for."""
        with self._wake:
            self._wishes.pop(page, None)

    def close(self) -> None:
        """End the thread."""
        with self._wake:
            self._closed = True
            self._wishes.clear()
            self._wake.notify()
        self._thread.join(_PATIENCE_S)

    def _run(self) -> None:
        try:
            while True:
                with self._wake:
                    self._wake.wait_for(lambda: self._closed or self._wishes)
                    if self._closed:
                        return
                    page, (wish, deliver) = self._wishes.popitem(last=False)
                self._page = page
                try:
                    answer = self._answer(wish)
                except Stopped:
                    return
                except Superseded:  # drawn later, unless the page itself wants another
                    with self._wake:
                        self._wishes.setdefault(page, (wish, deliver))
                    continue
                deliver(answer)
        finally:
            self._stage.close()

    def _answer(self, wish: Wish) -> Answer:
        started = time.perf_counter()
        self._urgent = wish.kind in QUICK
        said: dict[str, Any] = {"number": wish.number, "frame": wish.frame, "kind": wish.kind}
        try:
            settings = self._shot.settings(wish.tables)
            if wish.kind == "focus":
                picture, more = self._stage.inspect(settings).drawn()
            else:
                drawn = self._stage.draw(settings, wish.frame, wish.kind)
                picture, more = to_jpeg(drawn.picture), _about(drawn, quick=self._urgent)
        except NlensError as error:
            return Answer({**said, "error": str(error)})
        except MemoryError:
            return Answer({**said, "error": "out of memory; give a smaller plate or object"})
        except (Stopped, Superseded):
            raise
        except Exception as error:  # noqa: BLE001 - told to the page, which would wait for ever
            traceback.print_exc(file=standard_error())
            with suppress(Exception):  # what is half made may not close either
                self._stage.forget()
            return Answer({**said, "error": f"unexpected: {type(error).__name__}: {error}"})
        spent_ms = 1e3 * (time.perf_counter() - started)
        return Answer({**said, **more, "took_ms": spent_ms}, picture)

    def _check(self) -> None:
        """Give a picture at rest up for one that is dragged, or a newer one of the same page."""
        if self._closed:
            raise Stopped
        if self._urgent:
            return
        with self._wake:
            waiting = [(page, wish.kind) for page, (wish, _) in self._wishes.items()]
        if any(kind in QUICK or page is self._page for page, kind in waiting):
            raise Superseded

    def _on_progress(self, done: int, total: int | None) -> None:
        if self._closed:
            raise Stopped
        now = time.monotonic()
        if now - self._told_s > 0.2:
            self._told_s = now
            self._tell({"progress": "Solving the plate's camera", "done": done, "of": total})


def _about(drawn: Drawn, *, quick: bool) -> dict[str, Any]:
    return {
        "guides": to_builtins(drawn.guides, enc_hook=float),
        "nodes": [
            {"name": node.name, "once": node.once, "ms": drawn.nodes_ms[node.name]}
            for node in drawn.session.graph.nodes
            if node.name in drawn.nodes_ms
        ],
        "budget_ms": drawn.session.executor.profiler.budget_ms,
        "effects": [
            {"name": one.effect, "on": one.wanted, "reason": one.reason}
            for one in drawn.session.decisions
        ],
        "lines": [] if quick or drawn.lines is None else _rounded(drawn.lines),
        "notes": [str(note) for note in drawn.notes],
        "no_lens": drawn.no_lens,
        "lens": "" if drawn.fit is None else drawn.fit.describe(),
        "sun": drawn.sun and [round(drawn.sun.azimuth_deg), round(drawn.sun.elevation_deg)],
    }


def _rounded(lines: PlateLines) -> list[list[float]]:
    """x0, y0, x1, y1 of each line, in fractions of the frame, and the number of its group."""
    ends = lines.ends.reshape(-1, 4).clip(0.0, 1.0).round(4)
    return [[*row, group] for row, group in zip(ends.tolist(), lines.groups.tolist(), strict=True)]

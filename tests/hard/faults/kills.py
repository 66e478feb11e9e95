"""Runs that are killed outright at random moments, and what they must leave."""

from __future__ import annotations

import contextlib
import hashlib
import random
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

import av
from support import shots

FRAMES = 120
_TEMPORARY = re.compile(r"\.out\.partial-\w+-\d+\.mp4")
_INPUTS = {"in.mp4", "anim.glb"}


def make_shot(folder: Path, frames: int = FRAMES) -> Path:
    """A plate with sound and a cube that slides through it."""
    folder.mkdir(parents=True, exist_ok=True)
    shots.write_video(folder / "in.mp4", frames)
    shots.cube_glb(
        folder / "anim.glb", start=(-0.2, 0, -1.6), end=(0.3, 0, -1.5), seconds=frames / 25
    )
    return folder


def start(folder: Path, *more: str) -> subprocess.Popen[bytes]:
    words = [str(folder / name) for name in ("in.mp4", "anim.glb", "out.mp4")]
    command = [sys.executable, "-m", "nlens_video", *words, "--preset", "realtime", "-q", *more]
    return subprocess.Popen(command, stderr=subprocess.PIPE)


def finish(folder: Path, *more: str) -> None:
    run = start(folder, *more)
    _, said = run.communicate(timeout=300)
    assert run.returncode == 0, said.decode()
    assert said == b""


def decoded(path: Path) -> tuple[int, str]:
    """How many frames a file has, and a hash of their samples and times."""
    digest, count = hashlib.sha256(), 0
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            digest.update(f"{frame.pts}".encode())
            digest.update(frame.to_ndarray().tobytes())
            count += 1
    return count, digest.hexdigest()


@dataclass
class Tally:
    """What was counted.

    Attributes:
        kills: runs that were killed while they were at work.
        finished: runs that were done before the blow fell.
        early: of the kills, those before the first half second was written, or the first chunk.
        after: of the kills, those between the result and the end of its run.
        broken: results that were there and do not decode to the samples of an undisturbed run.
        lost: chunks that were there before a kill and not after it.
        strange: names left behind that tell nobody what they are.
        played: temporaries of `--keep-partial` that were opened and had frames.
        unplayable: those that had half a second of pictures and did not play.
        resumed: results of `--resume`, finished after one or more kills.
    """

    kills: int = 0
    finished: int = 0
    early: int = 0
    after: int = 0
    broken: int = 0
    lost: int = 0
    strange: list[str] = field(default_factory=list)
    played: int = 0
    unplayable: int = 0
    resumed: int = 0


class Executioner:
    """Kills runs on one shot and looks at what is left.

    Args:
        folder: of the shot.
        seed: of the moments.
        more: options of every run.
    """

    def __init__(self, folder: Path, seed: int, *more: str) -> None:
        self._folder = folder
        self._more = more
        self._out = folder / "out.mp4"
        self._random = random.Random(seed)
        self.tally = Tally()
        finish(folder, *more)  # what is compiled stays
        began = time.monotonic()
        finish(folder, *more)
        self._takes_s = time.monotonic() - began
        self._whole = decoded(self._out)
        self._out.unlink()

    def kill_keeping(self) -> None:
        """Kill a run with `--keep-partial`; then look at its temporary, as its user would."""
        if not self._killed("--keep-partial"):
            self._expect_whole()
            return
        temporaries = [one for one in self._folder.iterdir() if _TEMPORARY.fullmatch(one.name)]
        self._look({one.name for one in temporaries} | {"out.partial.mp4"})
        self.tally.early += not temporaries
        for one in temporaries:
            if b"moof" not in one.read_bytes():
                self.tally.early += 1
                continue
            frames = 0
            with contextlib.suppress(av.FFmpegError):
                frames, _ = decoded(one)
            self.tally.played += frames > 0
            self.tally.unplayable += frames == 0

    def kill_resumable(self) -> None:
        """Kill a run with `--resume`, which goes on from what others have left."""
        chunks = self._folder / "out.mp4.chunks"
        before = {one.name for one in chunks.glob("[!.]*.nut")}
        resumes = bool(before)
        if not self._killed("--resume"):
            self._expect_whole()
            self.tally.resumed += resumes
            return
        after = {one.name for one in chunks.glob("[!.]*.nut")}
        self.tally.lost += len(before - after)
        self.tally.early += not after
        merging = {one.name for one in self._folder.iterdir() if _TEMPORARY.fullmatch(one.name)}
        self._look({chunks.name} | merging)

    def finish(self, *more: str) -> None:
        """A run in peace: it must clear what the killed ones have left beside its result."""
        finish(self._folder, *self._more, *more)
        self._expect_whole()
        self._look(set())

    def _killed(self, *more: str) -> bool:
        run = start(self._folder, *self._more, *more)
        try:
            run.communicate(timeout=self._random.uniform(0.0, self._takes_s))
        except subprocess.TimeoutExpired:
            run.send_signal(signal.SIGKILL)
            run.communicate()
        killed = run.returncode == -signal.SIGKILL
        assert killed or run.returncode == 0
        self.tally.kills += killed
        self.tally.finished += not killed
        if killed and self._out.exists():  # killed between its result and its end
            self.tally.after += 1
            return False
        return killed

    def _expect_whole(self) -> None:
        whole = decoded(self._out) == self._whole
        self.tally.broken += not whole
        self._out.unlink()
        (self._folder / "out.partial.mp4").unlink(missing_ok=True)

    def _look(self, allowed: set[str]) -> None:
        found = {one.name for one in self._folder.iterdir()} - _INPUTS - allowed
        self.tally.strange += sorted(found)

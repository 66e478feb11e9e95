"""Queue of the tasks of several shots: which may run now, results and retries."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush

from nlens_video.core.errors import NlensError
from nlens_video.farm.merge import Merged
from nlens_video.farm.shot_tasks import Plan, Task
from nlens_video.video.atomic_files import remove_stale

_MOST_TRIES = 3  # of one task, before its shot fails


@dataclass(order=True, frozen=True, slots=True)
class QueuedTask:
    """A task of a shot, ordered by shot and number.

    Attributes:
        shot: index of the shot.
        number: index of the task among those that its plan has yielded together.
        task: the task.
    """

    shot: int
    number: int
    task: Task = field(compare=False)


@dataclass(slots=True)
class _ShotState:
    """A shot: results of the tasks that it waits for, and the task that follows the others."""

    plan: Plan
    answers: list[object]
    awaited: int = 0
    follower: QueuedTask | None = None
    notes: tuple[str, ...] = ()
    result: Merged | NlensError | None = None


class TaskQueue:
    """Tasks of shots, earlier shots first.

    Args:
        plans: of the shots; none has started yet.
    """

    def __init__(self, plans: Sequence[Plan]) -> None:
        self._shots = [_ShotState(plan, []) for plan in plans]
        self._begun = 0
        self._waiting: list[QueuedTask] = []
        self._losses: Counter[tuple[int, str]] = Counter()

    def begin(self, shots: int) -> None:
        """Start the first `shots` plans, unless they have started."""
        for number in range(self._begun, min(shots, len(self._shots))):
            self._begun = number + 1
            self._advance(number, None)

    def __len__(self) -> int:
        """Number of shots."""
        return len(self._shots)

    @property
    def waiting(self) -> bool:
        """Whether a task may run now."""
        while self._waiting and not self.wants(self._waiting[0]):
            heappop(self._waiting)
        return bool(self._waiting)

    def next(self) -> QueuedTask:
        """The next task; call only where `waiting` is true."""
        return heappop(self._waiting)

    def next_follower(self) -> QueuedTask | None:
        """A task that may run beside the unfinished tasks whose files it reads."""
        for shot in self._shots:
            if shot.follower is not None and shot.result is None:
                found, shot.follower = shot.follower, None
                return found
        return None

    def wants(self, waiting: QueuedTask) -> bool:
        """Whether a task is still needed: its shot has not failed."""
        return self._shots[waiting.shot].result is None

    def answered(self, waiting: QueuedTask, answer: object) -> None:
        """Store the result of a task, an `NlensError` where it has failed."""
        shot = self._shots[waiting.shot]
        if shot.result is not None:
            return
        if isinstance(answer, NlensError):
            shot.result = answer
            return
        waiting.task.done(answer)
        shot.answers[waiting.number] = answer
        shot.awaited -= 1
        if not shot.awaited:
            self._advance(waiting.shot, shot.answers)
        elif shot.awaited == 1 and shot.follower is not None:
            heappush(self._waiting, shot.follower)
            shot.follower = None

    def lost(self, waiting: QueuedTask, reason: str) -> None:
        """Repeat a task whose worker was lost; the third time its shot fails."""
        task = waiting.task
        for file in task.files:
            remove_stale(file)
        self._losses[waiting.shot, task.description] += 1
        if self._losses[waiting.shot, task.description] < _MOST_TRIES:
            self._shots[waiting.shot].notes += (f"{task.description}: done again ({reason})",)
            heappush(self._waiting, waiting)
            return
        error = NlensError(
            f"{task.description}: {_MOST_TRIES} workers were lost over it ({reason}); render it "
            "alone with -v to see why"
        )
        self.answered(waiting, error)

    def results(self) -> list[Merged | NlensError]:
        """Results and errors of the shots, once all tasks are done."""
        return [shot.result for shot in self._shots if shot.result is not None]

    def _advance(self, number: int, answers: list[object] | None) -> None:
        """Send the results to a shot's plan and queue its next tasks."""
        shot = self._shots[number]
        try:
            tasks = next(shot.plan) if answers is None else shot.plan.send(answers)
        except StopIteration as end:
            merged: Merged = end.value
            shot.result = replace(merged, notes=(*merged.notes, *shot.notes))
            return
        except NlensError as error:
            shot.result = error
            return
        shot.answers, shot.awaited = [None] * len(tasks), len(tasks)
        for at, task in enumerate(tasks):
            waiting = QueuedTask(number, at, task)
            if task.follows and len(tasks) > 1:
                shot.follower = waiting
            else:
                heappush(self._waiting, waiting)

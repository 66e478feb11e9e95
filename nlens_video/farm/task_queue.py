"""Shots under way: which of their tasks may be done now, and what becomes of the answers."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from heapq import heappop, heappush

from nlens_video.core.errors import NlensError
from nlens_video.farm.merge import Merged
from nlens_video.farm.shot_tasks import Plan, Task
from nlens_video.video.atomic_files import remove_stale

_MOST_TRIES = 3  # of one task, before it counts as what kills its workers


@dataclass(order=True, frozen=True, slots=True)
class Waiting:
    """A task of a shot, in the order in which they are done.

    Attributes:
        shot: its number, from 0.
        number: of the task among those that its shot wants done at the same time, from 0.
        task: what is to be done.
    """

    shot: int
    number: int
    task: Task = field(compare=False)


@dataclass(slots=True)
class _UnderWay:
    """A shot: answers of the tasks that it waits for, and the one that follows the others."""

    plan: Plan
    answers: list[object]
    awaited: int = 0
    follower: Waiting | None = None
    notes: tuple[str, ...] = ()
    result: Merged | NlensError | None = None


class TaskQueue:
    """Gives tasks of shots, earlier shots first, to whoever does them.

    Args:
        plans: of the shots; none is begun yet.
    """

    def __init__(self, plans: Sequence[Plan]) -> None:
        self._shots = [_UnderWay(plan, []) for plan in plans]
        self._begun = 0
        self._waiting: list[Waiting] = []
        self._losses: Counter[tuple[int, str]] = Counter()

    def begin(self, shots: int) -> None:
        """Take what the first so many shots want done first, unless they have begun."""
        for number in range(self._begun, min(shots, len(self._shots))):
            self._begun = number + 1
            self._go_on(number, None)

    def __len__(self) -> int:
        """How many shots there are."""
        return len(self._shots)

    @property
    def waiting(self) -> bool:
        """Whether something may be done now."""
        while self._waiting and not self.wants(self._waiting[0]):
            heappop(self._waiting)
        return bool(self._waiting)

    def next(self) -> Waiting:
        """What is to be done now; `waiting` has said that there is something."""
        return heappop(self._waiting)

    def next_beside(self) -> Waiting | None:
        """What follows tasks that are not done yet, for one who can wait for what they write."""
        for shot in self._shots:
            if shot.follower is not None and shot.result is None:
                found, shot.follower = shot.follower, None
                return found
        return None

    def wants(self, waiting: Waiting) -> bool:
        """Whether a task is of use: its shot has not failed."""
        return self._shots[waiting.shot].result is None

    def answered(self, waiting: Waiting, answer: object) -> None:
        """Hand a shot what a task has come to, an `NlensError` where it has failed."""
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
            self._go_on(waiting.shot, shot.answers)
        elif shot.awaited == 1 and shot.follower is not None:
            heappush(self._waiting, shot.follower)
            shot.follower = None

    def lost(self, waiting: Waiting, reason: str) -> None:
        """Have a task done again whose worker is gone; after three times its shot has failed."""
        task = waiting.task
        for file in task.files:
            remove_stale(file)  # what it has left
        self._losses[waiting.shot, task.words] += 1
        if self._losses[waiting.shot, task.words] < _MOST_TRIES:
            self._shots[waiting.shot].notes += (f"{task.words}: done again ({reason})",)
            heappush(self._waiting, waiting)
            return
        error = NlensError(
            f"{task.words}: {_MOST_TRIES} workers were lost over it ({reason}); render it alone "
            "with -v to see why"
        )
        self.answered(waiting, error)

    def results(self) -> list[Merged | NlensError]:
        """What the shots have come to, once nothing is left to do."""
        return [shot.result for shot in self._shots if shot.result is not None]

    def _go_on(self, number: int, answers: list[object] | None) -> None:
        """Give a shot its answers, and take what it wants done next."""
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
            waiting = Waiting(number, at, task)
            if task.follows and len(tasks) > 1:
                shot.follower = waiting
            else:
                heappush(self._waiting, waiting)

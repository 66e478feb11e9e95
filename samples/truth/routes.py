"""Where people walk about an object that stands in a scene of `plan`. Needs only numpy."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from truth import subject
from truth.plan import HEIGHT, View

KINDS = ("before", "behind", "before", "both")


@dataclass(frozen=True, slots=True, kw_only=True)
class Route:
    """Of one person, over the ground.

    Attributes:
        kind: past the object `before` or `behind` it.
        side: 1 where it begins on the right, -1 on the left.
        middle: x of the object [m].
        reach: from there to where it begins [m].
        near, far: y of the way before and behind the object [m].
        frames: of the clip.
        height_m: of the person [m].
        grain_m: size of a pixel where it walks [m].
    """

    kind: str
    side: float
    middle: float
    reach: float
    near: float
    far: float
    frames: int
    height_m: float
    grain_m: float

    def at(self, frame: float) -> tuple[float, float]:
        """X and y of the foot [m]."""
        share = (frame + 0.5) / self.frames
        x = self.middle + self.side * self.reach * (1.0 - 2.0 * share)
        return x, self.near if self.kind == "before" else self.far


def kind(seed: int) -> str:
    """What a clip shows."""
    return KINDS[seed % len(KINDS)]


def routes(view: View, frames: int) -> list[Route]:
    """Ways of the people of a clip; `both` is one before and one behind.

    Raises:
        ValueError: nobody can walk before the object with his feet in the frame.
    """
    rng = np.random.default_rng([view.seed, 41])
    seen = subject.mesh(view).positions
    focal = view.focal_px
    middle = float(view.project(np.array([[*view.place, 0.0]]))[0, 2])
    height = rng.uniform(0.45, 0.65) * HEIGHT * middle / focal
    near = float(seen[:, 1].min()) - 0.3 * height
    far = float(seen[:, 1].max()) + rng.uniform(0.3, 0.6) * height
    foot = view.project(np.array([[view.place[0], near, 0.0]]))[0]
    if near <= 0.0 or foot[1] > 0.97 * HEIGHT:
        raise ValueError(f"seed {view.seed}: no room before the object")
    found = []
    told = kind(view.seed)
    reach = 0.5 * float(np.ptp(seen[:, 0])) + 0.4 * height
    for one in ("before", "behind") if told == "both" else (told,):
        found.append(
            Route(
                kind=one,
                side=float(rng.choice([-1.0, 1.0])),
                middle=view.place[0],
                reach=reach,
                near=near,
                far=far,
                frames=frames,
                height_m=height,
                grain_m=middle / focal,
            )
        )
    return found

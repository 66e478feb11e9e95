"""The table of shots with known effects: what is in each, what is decided, how strong it is.

To add a row append a `Row` to a list of `ROWS`; an effect is looked for by `LOOKS`, by default as a
run does it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial

from support.effects import filmed_shots as film
from support.effects.filmed_shots import Camera, filmed

from nlens_video.core.layers import Picture
from nlens_video.effects.exposure import NEGLIGIBLE_LEVELS, MeasureExposure
from nlens_video.effects.measurement import measure_plate

OPTICS = ("aberration", "vignetting", "distortion", "bloom", "exposure")
UNITS = {
    "aberration": "px at the corner",
    "vignetting": "stops at the corner",
    "distortion": "px at the corner",
    "bloom": "levels beside highlights",
    "exposure": "levels of mid grey",
}


@dataclass(frozen=True, kw_only=True)
class Row:
    """A shot of the table.

    Attributes:
        name: what is in it.
        pictures: makes its first pictures.
        truth: strength of each effect in it; what is not named is not there.
        judged: effects that are looked for.
        weak: effects that are there, but on a plate that does not show them well enough: silence is
            right, and a strength that is named must be right.
    """

    name: str
    pictures: Callable[[], Sequence[Picture]]
    truth: Mapping[str, float] = field(default_factory=dict)
    judged: tuple[str, ...] = OPTICS
    weak: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """What was decided about an effect of a shot.

    Attributes:
        row: the shot.
        effect: its name.
        true: strength, None where it is not there.
        wanted: whether it is called for.
        found: strength, as it would be simulated.
    """

    row: Row
    effect: str
    true: float | None
    wanted: bool
    found: float

    @property
    def right(self) -> bool:
        """Whether the decision is right."""
        return self.wanted == (self.true is not None) or self.effect in self.row.weak

    @property
    def error(self) -> float | None:
        """Relative error of the strength, None where there is none to compare."""
        return self.found / self.true - 1.0 if self.wanted and self.true else None


def judge(row: Row) -> list[Verdict]:
    """Look at a shot as a run does."""
    pictures = row.pictures()
    plain = [effect for effect in row.judged if effect not in LOOKS]
    found = {
        effect: (one.called_for, one.value)
        for effect, one in measure_plate(plain, pictures).items()
    }
    for effect in row.judged:
        if effect in LOOKS:
            found[effect] = LOOKS[effect](pictures)
    return [
        Verdict(
            row=row, effect=effect, true=row.truth.get(effect), wanted=found[effect][0],
            found=found[effect][1],
        )
        for effect in row.judged
    ]  # fmt: skip


def _exposure(pictures):
    measure = MeasureExposure()
    levels = [measure(picture).levels for picture in pictures]
    return max(levels) >= 2 * NEGLIGIBLE_LEVELS, levels[-1]


LOOKS = {"exposure": _exposure}
"""Effects that are decided on each frame, and how; the others are measured before the run."""


def _levels(stops):
    return 118.0 * (2.0 ** (stops / 2.2) - 1.0)


def _shot(name, scene, camera=None, frames=1, **more):
    return Row(name=name, pictures=partial(filmed, scene, camera, frames), **more)


def _halo(scene, bloom):
    return {"bloom": film.halo_levels(scene(), bloom)}


STREET, STREET_B = partial(film.street, 2), partial(film.street, 22)
ROOM, ROOM_B = partial(film.room, 3), partial(film.room, 7)
LAMPS, LAMPS_B = partial(film.lamps, 4), partial(film.lamps, 41)
FINE, COARSE = partial(film.spectrum, 1, 1.0), partial(film.spectrum, 11, 1.5)
WALL = partial(film.spectrum, 12, 0.6, 0.1)
WALL_B = partial(film.spectrum, 14, 0.8, 0.12)


def _defocused(scene):
    return film.defocused(scene())


def _lit(scene):
    return film.lit(scene())


CLEAN = [
    _shot("street", STREET),
    _shot("street, noise, crf 28", STREET_B, Camera(noise=0.02, crf=28), frames=3),
    _shot("street, defocused", partial(_defocused, STREET)),
    _shot("street, uncompressed", STREET_B, Camera(crf=None, noise=0.01)),
    _shot("room", ROOM),
    _shot("room, defocused", partial(_defocused, ROOM_B), Camera(crf=24)),
    _shot("fine texture", FINE),
    _shot("coarse texture", COARSE, Camera(noise=0.01)),
    _shot("texture lit from one side", partial(_lit, FINE)),
    _shot("plain wall", WALL),
    _shot("lamps", LAMPS),
    _shot("lamps, noise, crf 26", LAMPS_B, Camera(noise=0.01, crf=26)),
    _shot("defocused lamps and window", partial(film.dots, 5)),
    _shot("strongly defocused lamps", partial(film.dots, 8, blur=14), Camera(crf=26)),
    _shot("panning camera", STREET, Camera(pan=(12, 2)), frames=8),
    _shot("fast pan", FINE, Camera(pan=(40, 5)), frames=8),
    _shot("something large comes in", STREET, Camera(entering=True, noise=0.01), frames=8),
]

SINGLE = [
    _shot(
        "aberration, street",
        STREET,
        Camera(aberration=(1.5, 1.0), crf=14),
        truth={"aberration": 2.5},
    ),
    _shot(
        "aberration inwards, fine texture",
        FINE,
        Camera(aberration=(-1.0, 0.0), crf=12),
        truth={"aberration": 1.0},
    ),
    _shot(
        "weak aberration, uncompressed",
        STREET,
        Camera(aberration=(1.0, 0.0), crf=None),
        truth={"aberration": 1.0},
    ),
    _shot(
        "aberration, room", ROOM, Camera(aberration=(3.0, 1.0), crf=16), truth={"aberration": 4.0}
    ),
    _shot(
        "weak aberration, street, crf 20",
        STREET_B,
        Camera(aberration=(1.0, 0.0), crf=20),
        truth={"aberration": 1.0},
        weak=("aberration",),
    ),
    _shot("vignetting, wall", WALL, Camera(vignetting=0.6), truth={"vignetting": 0.6}),
    _shot(
        "strong vignetting, wall",
        WALL_B,
        Camera(vignetting=1.5, noise=0.01, crf=26),
        truth={"vignetting": 1.5},
    ),
    _shot(
        "vignetting, street",
        STREET,
        Camera(vignetting=0.7),
        truth={"vignetting": 0.7},
        weak=("vignetting",),
    ),
    _shot(
        "barrel, room",
        ROOM,
        Camera(distortion=-0.12),
        truth={"distortion": 0.12 * film.CORNER_PX},
    ),
    _shot(
        "barrel, other room",
        ROOM_B,
        Camera(distortion=-0.2, crf=26),
        truth={"distortion": 0.2 * film.CORNER_PX},
    ),
    _shot(
        "pincushion, room",
        ROOM_B,
        Camera(distortion=0.1),
        truth={"distortion": 0.1 * film.CORNER_PX},
    ),
    _shot(
        "weak barrel, street",
        STREET,
        Camera(distortion=-0.03),
        truth={"distortion": 0.03 * film.CORNER_PX},
        weak=("distortion",),
    ),
    _shot("bloom, lamps", LAMPS, Camera(bloom=(0.06, 12)), truth=_halo(LAMPS, (0.06, 12))),
    _shot(
        "wide bloom, lamps, crf 26",
        LAMPS_B,
        Camera(bloom=(0.08, 25), crf=26),
        truth=_halo(LAMPS_B, (0.08, 25)),
    ),
    _shot("weak bloom, lamps", LAMPS, Camera(bloom=(0.03, 12)), truth=_halo(LAMPS, (0.03, 12))),
    _shot("brighter", STREET, Camera(drift=0.05), 8, truth={"exposure": _levels(0.35)}),
    _shot(
        "darker, noise",
        COARSE,
        Camera(drift=-0.03, noise=0.02, crf=26),
        8,
        truth={"exposure": -_levels(-0.21)},
    ),
    _shot("white balance", STREET_B, Camera(balance=0.06), 8, truth={"exposure": _levels(0.21)}),
    _shot(
        "brighter while panning",
        FINE,
        Camera(drift=0.04, pan=(9, 3)),
        8,
        truth={"exposure": _levels(0.28)},
    ),
    _shot(
        "brighter while something comes in",
        STREET,
        Camera(drift=0.04, entering=True),
        8,
        truth={"exposure": _levels(0.28)},
    ),
]

MIXED = [
    _shot(
        "aberration and barrel, room", ROOM,
        Camera(aberration=(2.0, 1.0), distortion=-0.12, crf=14),
        truth={"aberration": 3.0, "distortion": 0.12 * film.CORNER_PX},
    ),
    _shot(
        "aberration and drift, street", STREET,
        Camera(aberration=(2.0, 0.0), drift=0.04, crf=12), 8,
        truth={"aberration": 2.0, "exposure": _levels(0.28)},
    ),
    _shot(
        "vignetting and drift, wall", WALL, Camera(vignetting=1.0, drift=-0.04), 8,
        truth={"vignetting": 1.0, "exposure": -_levels(-0.28)},
    ),
    _shot(
        "bloom and white balance, lamps", LAMPS, Camera(bloom=(0.06, 12), balance=0.05), 8,
        truth={**_halo(LAMPS, (0.06, 12)), "exposure": _levels(0.175)},
    ),
]  # fmt: skip


def _unseen(number):
    """Rows on scenes that no threshold was chosen with."""
    street, room = partial(film.street, 100 + number), partial(film.room, 200 + number)
    halo = (0.05, (8, 14, 20)[number])
    lamps, bend = partial(film.lamps, 300 + number), (-0.1, -0.15, 0.12)[number]
    fine, wall = (
        partial(film.spectrum, 400 + number, 1.0),
        partial(film.spectrum, 500 + number, 0.6, 0.1),
    )
    dots = partial(film.dots, 600 + number, blur=(5, 9, 14)[number])
    rough = Camera(crf=(18, 23, 28)[number], noise=(0.004, 0.01, 0.02)[number])
    named = {"street": street, "room": room, "lamps": lamps, "fine texture": fine, "wall": wall}
    label = f"unseen {number + 1}:"
    return [
        *(_shot(f"{label} {name}, crf {rough.crf}", scene, rough) for name, scene in named.items()),
        _shot(f"{label} defocused lamps", dots),
        _shot(
            f"{label} aberration, street", street, Camera(aberration=(1.5, 1.0), crf=14),
            truth={"aberration": 2.5},
        ),
        _shot(
            f"{label} aberration, room", room, Camera(aberration=(-2.0, 0.0), crf=14),
            truth={"aberration": 2.0},
        ),
        _shot(f"{label} vignetting", wall, Camera(vignetting=0.8), truth={"vignetting": 0.8}),
        _shot(
            f"{label} distortion", room, Camera(distortion=bend),
            truth={"distortion": abs(bend) * film.CORNER_PX},
        ),
        _shot(f"{label} bloom", lamps, Camera(bloom=halo), truth=_halo(lamps, halo)),
    ]  # fmt: skip


UNSEEN = [row for number in range(3) for row in _unseen(number)]
ROWS = [*CLEAN, *SINGLE, *MIXED, *UNSEEN]

"""Which of the things on a frame are those that were followed so far."""

from __future__ import annotations

from itertools import product

import numpy as np

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.things import Seen
from nlens_video.effects.foreground.track import Track

_THERE = 0.3  # of where a thing is expected, that a region must cover to be it [1]
_INSIDE = 0.6  # that a region must cover which is also that of others [1]
_LEAST_HEIGHT = 0.4  # of a thing, by that of a region which is also that of others [1]
_ABOVE = 0.6  # of its width, in the columns of another, that a piece of a thing is [1]
_OF_IT = 0.6  # of a piece, that lies where the whole thing is expected [1]
_NEAR_PX = 3  # between the region in which things met and those in which they part
_AWAY = 0.3  # of its height, that a thing is off where it is expected and speaks against it [1]
_MOST_PARTING = 4  # things and regions whose ways are all tried


def claimed(
    tracks: list[Track], index: int, seen: list[Seen], picture: tuple[Float32, Bool] | None
) -> dict[int, list[Track]]:
    """The known things that each of those on a frame may be, by its number.

    More than one where they meet.
    """
    claims: dict[int, list[Track]] = {}
    left = list(tracks)
    if picture is not None:
        for group in _groups(tracks):
            near = [at for at, one in enumerate(seen) if _parts_from(group, index, one.box)]
            if 1 < len(near) <= _MOST_PARTING:
                way = _parting(group, index, seen, near, picture)
                for track, at in zip(group, way, strict=True):
                    claims.setdefault(at, []).append(track)
                left = [one for one in left if all(one is not other for other in group)]
    for track in left:
        expected = _trunk(track.expected(index))
        common = [area(expected.intersection(one.box)) for one in seen]
        at = int(np.argmax(common)) if common else 0
        if common and common[at] > _THERE * area(expected):
            claims.setdefault(at, []).append(track)
    return {at: _those_inside(parts, index, seen[at].box) for at, parts in claims.items()}


def pieces_of(
    claims: dict[int, list[Track]], index: int, seen: list[Seen]
) -> list[tuple[Track, list[int]]]:
    """Numbers of the things on a frame that are pieces of a known one, above or below its rest.

    Legs of the ground's colour part the feet from the body.
    """
    found: list[tuple[Track, list[int]]] = []
    for at, parts in claims.items():
        for one in (track for track in parts if not track.new):
            expected, rest = one.expected(index), seen[at].box
            beside = [
                number for number, other in enumerate(seen)
                if number not in claims
                and area(expected.intersection(other.box)) > _OF_IT * area(other.box)
                and min(rest.y1, other.box.y1) - max(rest.y0, other.box.y0) < 1
            ]  # fmt: skip
            taken = {number for _, numbers in found for number in numbers}
            found.append((one, [number for number in beside if number not in taken]))
    return [(one, numbers) for one, numbers in found if numbers]


def joined(parts: list[Seen]) -> Seen:
    """A thing of which parts are apart; its region is that of the first one."""
    box = parts[0].box
    for one in parts[1:]:
        box = box.union(one.box)
    lowest = max(parts, key=lambda one: one.box.y1)
    return Seen(box, lowest.foot, parts[0].region, lowest.cut)


def _those_inside(parts: list[Track], index: int, box: Box) -> list[Track]:
    """Of several things that may be in a box those that can meet there; at least the likeliest."""
    if len(parts) == 1:
        return parts
    expected = [(one, one.expected(index)) for one in parts]
    inside = [one for one, at in expected if may_hold(box, at)]
    inside = [one for one in inside if not (one.new and one.apart[-1] and _piece(one, inside))]
    return inside or [max(expected, key=lambda pair: _alike(pair[1], box))[0]]


def may_hold(region: Box, box: Box) -> bool:
    """Whether a region may be that of a thing in a box and of others."""
    trunk = _trunk(box)
    common = area(trunk.intersection(region))
    return common > _INSIDE * area(trunk) and box.height > _LEAST_HEIGHT * region.height


def _trunk(box: Box) -> Box:
    """The middle half of a box: limbs that swing leave and enter the rest."""
    off = box.width // 4
    return Box(box.x0 + off, box.y0, box.x1 - off, box.y1)


def _piece(track: Track, others: list[Track]) -> bool:
    """Whether what was just seen apart is a part of another thing: it is above or below it."""
    box = track.boxes[-1]
    for one in others:
        other = one.boxes[-1]
        common = min(box.x1, other.x1) - max(box.x0, other.x0)
        if one is not track and common > _ABOVE * min(box.width, other.width):
            return True
    return False


def _groups(tracks: list[Track]) -> list[list[Track]]:
    """Things that met on the last frame, each with those in its region."""
    met: dict[tuple[int, Box], list[Track]] = {}
    for one in tracks:
        if not one.apart[-1]:
            met.setdefault((one.frames[-1], one.regions[-1]), []).append(one)
    return [group for group in met.values() if 1 < len(group) <= _MOST_PARTING]


def _parts_from(group: list[Track], index: int, box: Box) -> bool:
    """Whether a thing may be one of those that met: in the rows of one of them."""
    reached = group[0].regions[-1].expanded(_NEAR_PX)
    if box.intersection(reached).empty:
        return False
    expected = [one.expected(index) for one in group]
    return any(min(box.y1, one.y1) - max(box.y0, one.y0) > _INSIDE * one.height for one in expected)


def _parting(
    group: list[Track], index: int, seen: list[Seen], near: list[int],
    picture: tuple[Float32, Bool],
) -> tuple[int, ...]:  # fmt: skip
    """Which thing each of a group is, by their looks and where they were going."""
    roots, mask = picture
    frame = Box(0, 0, *mask.shape[::-1])
    costs: list[dict[int, float]] = []
    for track in group:
        expected = track.expected(index)
        each = {}
        for at in near:
            box = seen[at].box
            part = box.slices_in(frame)
            colours = track.look.likelihood(roots[part], box, box)
            explained = float(np.log(colours)[mask[part]].mean())
            beyond = max(0.0, abs(_middle(box) - _middle(expected)) - 0.5 * box.width)
            away = beyond + abs(box.y1 - expected.y1) + abs(box.y0 - expected.y0)
            each[at] = away / (_AWAY * expected.height) - explained
        costs.append(each)
    ways = [way for way in product(near, repeat=len(group)) if len(set(way)) == _most(group, near)]
    return min(
        ways,
        key=lambda way: sum(cost[at] for cost, at in zip(costs, way, strict=True)),
    )


def _most(group: list[Track], near: list[int]) -> int:
    return min(len(group), len(near))


def _middle(box: Box) -> float:
    return 0.5 * (box.x0 + box.x1)


def area(box: Box) -> int:
    """Pixels of a box; 0 of an empty one."""
    return max(0, box.width) * max(0, box.height)


def overlap(one: Box, other: Box) -> float:
    """Common area by the smaller one's [1]."""
    return area(one.intersection(other)) / max(1, min(area(one), area(other)))


def _alike(one: Box, other: Box) -> float:
    """Common area by that of both [1]."""
    common = area(one.intersection(other))
    return common / max(1, area(one) + area(other) - common)

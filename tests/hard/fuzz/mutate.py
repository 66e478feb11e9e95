"""Mutations of bytes, of JSON and of text: the same number gives the same damage."""

from __future__ import annotations

import copy
import json
import random
import struct

_LENGTHS = (0, 1, 2, 3, 4, 7, 8, 16, 100, 1000)
_NASTY_BYTES = tuple(
    struct.pack(form, value)
    for form, values in (
        ("<B", (0, 1, 0x7F, 0x80, 0xFF)),
        ("<H", (0, 1, 0x7FFF, 0x8000, 0xFFFF)),
        (">H", (1, 0x7FFF, 0x8000)),
        ("<I", (0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF, 1 << 24)),
        (">I", (1, 0x7FFFFFFF, 0x80000000, 1 << 24)),
        ("<q", (-1, 1 << 62, -(1 << 63))),
        ("<f", (float("nan"), float("inf"), -1e38, 1e-45)),
    )
    for value in values
)
NASTY_VALUES = (
    -1, 0, 1, 2, 7, 255, 2**31, 2**32 + 1, 2**53, 2**63, 10**30, 10**400, -0.5, 1e-30, 1e30, 1e308,
    -1e308, float("nan"), float("inf"), True, False, None, "", "x", "../a", "file:///etc/passwd",
    "\0", "😀", [], {}, [0], [1, 0], [[0]], [-1.0] * 3, [0, 0, 0, 0], [1e38] * 16, {"extras": 1},
)  # fmt: skip

_NASTY_TOML = (
    "-1", "1e999", "nan", '""', "[]", "[" * 900, "{}", "true", "'\0'", "9" * 5000, '"../../x"',
    "1979-05-27T07:32:00Z",
)  # fmt: skip


def damaged(data: bytes, rng: random.Random, other: bytes) -> bytes:
    """A file with one to eight pieces of damage.

    Args:
        data: the file.
        rng: decides.
        other: of the same kind, to take pieces from.
    """
    made = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 2, 3, 5, 8))):
        rng.choice(_DAMAGES)(made, rng, other)
    return bytes(made)


def _place(made: bytearray, rng: random.Random) -> int:
    """Headers lie in front and at the end: they are hit as often as all the rest."""
    size = max(1, len(made))
    return rng.choice(
        (
            rng.randrange(size),
            rng.randrange(min(size, 128)),
            size - 1 - rng.randrange(min(size, 64)),
        )
    )


def _flip(made: bytearray, rng: random.Random, other: bytes) -> None:
    if made:
        made[_place(made, rng)] ^= 1 << rng.randrange(8)


def _set(made: bytearray, rng: random.Random, other: bytes) -> None:
    piece = rng.choice(_NASTY_BYTES)
    at = _place(made, rng)
    made[at : at + len(piece)] = piece


def _noise(made: bytearray, rng: random.Random, other: bytes) -> None:
    at = _place(made, rng)
    made[at : at + 32] = rng.randbytes(len(made[at : at + 32]))


def _cut(made: bytearray, rng: random.Random, other: bytes) -> None:
    del made[_place(made, rng) :]


def _leave_out(made: bytearray, rng: random.Random, other: bytes) -> None:
    at = _place(made, rng)
    del made[at : at + rng.choice(_LENGTHS)]


def _repeat(made: bytearray, rng: random.Random, other: bytes) -> None:
    at = _place(made, rng)
    made[at:at] = made[at : at + rng.choice(_LENGTHS)]


def _zero(made: bytearray, rng: random.Random, other: bytes) -> None:
    at, length = _place(made, rng), rng.choice(_LENGTHS)
    made[at : at + length] = bytes(len(made[at : at + length]))


def _splice(made: bytearray, rng: random.Random, other: bytes) -> None:
    at, length = _place(made, rng), rng.choice(_LENGTHS)
    start = rng.randrange(max(1, len(other)))
    made[at : at + length] = other[start : start + length]


_DAMAGES = (_flip, _flip, _flip, _set, _set, _noise, _cut, _leave_out, _repeat, _zero, _splice)


def changed_json(document: object, rng: random.Random) -> object:
    """A JSON document with one to four members replaced, left out, doubled or swapped."""
    made = copy.deepcopy(document)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 4))):
        owners = list(_owners(made))
        if not owners:
            break
        _change(rng.choice(owners), owners, rng)
    return made


def _owners(value: object) -> list[dict | list]:
    found: list[dict | list] = []
    waiting = [value]
    while waiting:
        one = waiting.pop()
        if isinstance(one, dict | list) and one:
            found.append(one)
            waiting.extend(one.values() if isinstance(one, dict) else one)
    return found


def _change(owner: dict | list, owners: list[dict | list], rng: random.Random) -> None:
    key = rng.choice(list(owner)) if isinstance(owner, dict) else rng.randrange(len(owner))
    how = rng.randrange(8)
    number = isinstance(owner[key], int | float) and not isinstance(owner[key], bool)
    if how == 0:
        del owner[key]
    elif number and how < 5:
        scale = rng.choice((1, 1, -1, 0.5, 1e9, 1e-9)) if isinstance(owner[key], float) else 1
        owner[key] = owner[key] * scale + rng.choice((0, -1, 1, 1000))
    elif how == 5:
        owner[key] = copy.deepcopy(rng.choice(owners))
    elif how == 6 and isinstance(owner, list) and len(owner) < 1000:
        owner.insert(key, copy.deepcopy(owner[key]))
    else:
        owner[key] = copy.deepcopy(rng.choice(NASTY_VALUES))


def json_bytes(document: object) -> bytes:
    """As a file holds it; numbers that JSON has not, such as NaN, as Python writes them."""
    return json.dumps(document).encode()


NASTY_SHOT = (*_NASTY_TOML, r'"a\u0000b"', "[" * 20_000, "0x" + "f" * 5000, "[0, 1]", '"0x1p4"')
"""Trouble for files whose values become paths and words of a command line."""


def changed_text(text: str, rng: random.Random, trouble: tuple[str, ...] = _NASTY_TOML) -> str:
    """Lines left out, doubled or swapped; words replaced by those of other lines or by trouble."""
    lines = text.splitlines(keepends=True)
    for _ in range(rng.choice((1, 1, 2, 3, 5))):
        at, other = rng.randrange(len(lines)), rng.randrange(len(lines))
        how = rng.randrange(5)
        if how == 0 and len(lines) > 1:
            del lines[at]
        elif how == 1:
            lines.insert(at, lines[other])
        elif how == 2:
            lines[at], lines[other] = lines[other], lines[at]
        elif how == 3:
            words = lines[at].split(" ")
            words[rng.randrange(len(words))] = rng.choice(lines[other].split(" "))
            lines[at] = " ".join(words)
        else:
            head = lines[at].split("=")[0]
            lines[at] = f"{head}= {rng.choice(trouble)}\n"
    return "".join(lines)

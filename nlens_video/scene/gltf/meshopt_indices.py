"""Index codecs of meshopt compression: triangles by recent edges and vertices, and sequences.

From the specification of EXT_meshopt_compression, appendix A.
"""

from __future__ import annotations

_MASK = 0xFFFFFFFF
_RECENT = 16
_LEAST_FREE = (15, 13)  # codes of a third vertex from here on are not recent ones; by version


class MeshoptError(ValueError):
    """The data are no valid stream."""


def version_of(data: bytes, codec: int) -> int:
    """The version in a stream's header; `codec` is the header of version 0.

    Raises:
        MeshoptError: another codec, or a later version.
    """
    if data[0] & 0xF0 != codec or data[0] & 0x0F > 1:
        raise MeshoptError(
            f"its header is {data[0]:#04x}, expected {codec:#04x} or {codec + 1:#04x}"
        )
    return data[0] & 0x0F


def check_end(at: int, end: int) -> None:
    """Raise MeshoptError where a stream does not end where its elements do."""
    if at != end:
        raise MeshoptError("the stream does not end where its elements do")


def decode_triangles(data: bytes, count: int) -> list[int]:
    """The `count` indices of the triangle codec.

    Raises:
        MeshoptError: the data are damaged.
        IndexError: they end early.
    """
    triangles = _Triangles(data, count)
    out: list[int] = []
    for code in data[1 : 1 + count // 3]:
        out += triangles.by_edge(code) if code < 0xF0 else triangles.by_vertices(code)
    check_end(triangles.free.at, len(data) - 16)
    return [index & _MASK for index in out]


class _Triangles:
    """What the triangle codec remembers: recent edges and vertices, the newest last."""

    def __init__(self, data: bytes, count: int) -> None:
        if len(data) < 1 + count // 3 + 16:
            raise IndexError
        self._least_free = _LEAST_FREE[version_of(data, 0xE0)]
        self._table = data[-16:]
        self._edges = [(_MASK, _MASK)] * _RECENT
        self._vertices = [_MASK] * _RECENT
        self._following = 0
        self.free = _Free(data, 1 + count // 3)

    def by_edge(self, code: int) -> tuple[int, int, int]:
        """A triangle on a recent edge."""
        a, b = self._edges[-1 - (code >> 4)]
        kind = code & 15
        if kind == 0:
            c = self._next()
        elif kind < self._least_free:
            c = self._vertices[-1 - kind]
        else:
            c = self.free.index() if kind == 15 else self.free.step(kind - (kind ^ 3))
        if kind == 0 or kind >= self._least_free:
            self._vertices = [*self._vertices[1:], c]
        self._edges = [*self._edges[2:], (c, b), (a, c)]
        return a, b, c

    def by_vertices(self, code: int) -> tuple[int, int, int]:
        """A triangle on no recent edge."""
        listed = code < 0xFE
        packed = self._table[code & 15] if listed else self.free.byte()
        if not listed and packed == 0:
            self._following = 0
        kinds = (15 if code == 0xFF else 0, packed >> 4, packed & 15)
        found = [
            self._next() if kind == 0 else None if kind == 15 and not listed
            else self._vertices[-kind]
            for kind in kinds
        ]  # fmt: skip
        a, b, c = (self.free.index() if one is None else one for one in found)
        new = [one for one, kind in zip((a, b, c), kinds, strict=True) if kind in (0, 15)]
        self._vertices = [*self._vertices, *new][-_RECENT:]
        self._edges = [*self._edges[3:], (b, a), (c, b), (a, c)]
        return a, b, c

    def _next(self) -> int:
        self._following += 1
        return self._following - 1


def decode_sequence(data: bytes, count: int) -> list[int]:
    """The `count` indices of the sequence codec; raises as `decode_triangles`."""
    version_of(data, 0xD0)
    free = _Free(data, 1)
    last = [0, 0]
    out: list[int] = []
    for _ in range(count):
        number = free.number()
        which = number & 1
        last[which] = (last[which] + _signed(number >> 1)) & _MASK
        out.append(last[which])
    check_end(free.at, len(data) - 4)
    return out


class _Free:
    """Free indices of a stream: variable-length deltas."""

    def __init__(self, data: bytes, at: int) -> None:
        self._data = data
        self.at = at
        self.last = 0

    def number(self) -> int:
        """Up to five bytes, seven bits in each from the lowest on."""
        value = 0
        for shift in range(0, 35, 7):
            byte = self._data[self.at]
            self.at += 1
            value |= (byte & 127) << shift
            if byte < 128:
                break
        return value & _MASK

    def byte(self) -> int:
        """One byte as it is."""
        self.at += 1
        return self._data[self.at - 1]

    def index(self) -> int:
        """An index by its difference from the last free one."""
        return self.step(_signed(self.number()))

    def step(self, difference: int) -> int:
        """The last free index moved on."""
        self.last = (self.last + difference) & _MASK
        return self.last


def _signed(zigzag: int) -> int:
    return zigzag >> 1 ^ -(zigzag & 1)

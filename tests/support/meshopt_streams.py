"""A plain encoder of meshopt streams, from the specification; its codes are not the shortest."""

import numpy as np

GROUP, BLOCK_BYTES, BLOCK_MOST = 16, 8192, 256
MASK = 0xFFFFFFFF


def encode_attributes(elements, version=0):
    """A stream of elements (count, stride) of bytes."""
    count, stride = elements.shape
    out = bytearray([0xA0 | version])
    block = min(BLOCK_BYTES // stride & ~(GROUP - 1), BLOCK_MOST)
    before = first = np.zeros(stride, np.uint8) + elements[0]
    for start in range(0, count, block):
        part = elements[start : start + block]
        steps = np.diff(part.astype(np.int16), axis=0, prepend=before[None].astype(np.int16))
        steps = ((steps + 128) % 256 - 128).astype(np.int16)
        coded = np.where(steps < 0, -2 * steps - 1, 2 * steps).astype(np.uint8)
        kinds = [column % 3 if version else 0 for column in range(stride)]
        for column, kind in enumerate(kinds):
            if kind == 2 and coded[:, column].any():
                kinds[column] = 3
        if version:
            fours = np.array(kinds).reshape(-1, 4)
            out += bytes(int(a | b << 2 | c << 4 | d << 6) for a, b, c, d in fours)
        for column, kind in enumerate(kinds):
            values = coded[:, column]
            if kind == 3:
                out += values.tobytes()
            elif kind < 2:
                widths = (((0, 1, 2, 4), (1, 2, 4, 8))[kind]) if version else (0, 2, 4, 8)
                out += _packed(values, widths)
        before = part[-1]
    tail = bytes(first) + (bytes(stride // 4) if version else b"")
    return bytes(out) + tail.rjust((32, 24)[version], b"\0")


def _packed(values, widths):
    values = np.concatenate([values, np.zeros(-len(values) % GROUP, np.uint8)]).reshape(-1, GROUP)
    header, body = [], bytearray()
    for group in values:
        options = [(_group(group, width), at) for at, width in enumerate(widths)]
        data, at = min((o for o in options if o[0] is not None), key=lambda o: len(o[0]))
        header.append(at)
        body += data
    header += [0] * (-len(header) % 4)
    fours = np.array(header).reshape(-1, 4)
    return bytes(int(a | b << 2 | c << 4 | d << 6) for a, b, c, d in fours) + bytes(body)


def _group(group, width):
    if width == 0:
        return b"" if not group.any() else None
    if width == 8:
        return group.tobytes()
    most = (1 << width) - 1
    bits = [[int(min(v, most)) >> (width - 1 - b) & 1 for b in range(width)] for v in group]
    packed = np.packbits(np.array(bits).ravel(), bitorder="little" if width == 1 else "big")
    return packed.tobytes() + group[group >= most].tobytes()


def _number(value):
    out = bytearray()
    while value > 127:
        out.append(value & 127 | 128)
        value >>= 7
    return bytes([*out, value])


def _zigzag(step):
    return -2 * step - 1 if step < 0 else 2 * step


class TriangleEncoder:
    """Triangles by their edges where those are recent, else by their vertices."""

    def __init__(self, version=1):
        self.version = version
        self.least_free = 13 if version else 15
        self.edges, self.vertices = [(-1, -1)] * 16, [-1] * 16
        self.following = self.last = 0
        self.codes, self.data = bytearray(), bytearray()
        self.table = bytes([0x00, *range(1, 16)])

    def encode(self, indices):
        """The stream of some indices (3 N,); triangles keep their winding, not their start."""
        for a, b, c in np.reshape(indices, (-1, 3)).tolist():
            turns = ((a, b, c), (b, c, a), (c, a, b))
            known = [turn for turn in turns if turn[:2] in self.edges[1:]]
            if known:
                self._by_edge(*known[0])
            else:
                self._by_vertices(a, b, c)
        return bytes([0xE0 | self.version]) + bytes(self.codes) + bytes(self.data) + self.table

    def _free(self, index):
        self.data += _number(_zigzag(index - self.last))
        self.last = index

    def _by_edge(self, a, b, c):
        edge = self.edges[::-1].index((a, b))
        near = self.vertices[::-1]
        if c == self.following:
            kind, self.following = 0, self.following + 1
        elif c in near[1 : self.least_free]:
            kind = near.index(c, 1)
        elif self.version and abs(c - self.last) == 1:
            kind, self.last = (13 if c < self.last else 14), c
        else:
            kind = 15
            self._free(c)
        self.codes.append(edge << 4 | kind)
        if kind == 0 or kind >= self.least_free:
            self.vertices = [*self.vertices[1:], c]
        self.edges = [*self.edges[2:], (c, b), (a, c)]

    def _by_vertices(self, *corners):
        kinds, free = [], []
        for place, corner in enumerate(corners):
            # a free vertex and two following ones would read as a reset
            if corner == self.following and not (place == 2 and kinds == [15, 0]):
                kinds.append(0)
                self.following += 1
            elif place and corner in self.vertices[2:]:
                kinds.append(self.vertices[::-1].index(corner) + 1)
            else:
                kinds.append(15)
                free.append(corner)
        packed = kinds[1] << 4 | kinds[2]
        if kinds[0] == 0 and packed in self.table[:14]:
            self.codes.append(0xF0 | self.table.index(packed))
        else:
            self.codes.append(0xFF if kinds[0] else 0xFE)
            self.data.append(packed)
            for corner in free:
                self._free(corner)
        new = [c for c, kind in zip(corners, kinds, strict=True) if kind in (0, 15)]
        self.vertices = [*self.vertices, *new][-16:]
        a, b, c = corners
        self.edges = [*self.edges[3:], (b, a), (c, b), (a, c)]


def encode_sequence(indices):
    """A stream of indices against the nearer of two baselines."""
    last, out = [0, 0], bytearray([0xD1])
    for index in map(int, indices):
        which = int(abs(index - last[1]) < abs(index - last[0]))
        out += _number(_zigzag(index - last[which]) << 1 | which)
        last[which] = index
    return bytes(out) + bytes(4)

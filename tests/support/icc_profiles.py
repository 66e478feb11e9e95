"""ICC profiles of displays that the tests make from chromaticities and a curve."""

import struct

import numpy as np

D50, D65 = (0.9642, 1.0, 0.8249), (0.3127, 0.3290)
DISPLAY_P3 = ((0.680, 0.320), (0.265, 0.690), (0.150, 0.060), D65)
ADOBE_RGB = ((0.64, 0.33), (0.21, 0.71), (0.15, 0.06), D65)
BT2020 = ((0.708, 0.292), (0.170, 0.797), (0.131, 0.046), D65)
SRGB_CURVE = (2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045)
CONE = np.array([[0.8951, 0.2664, -0.1614], [-0.7502, 1.7135, 0.0367], [0.0389, -0.0685, 1.0296]])


def fixed(*values):
    return struct.pack(f">{len(values)}i", *(round(float(value) * 65536) for value in values))


def parametric(*values):
    return b"para\0\0\0\0" + struct.pack(">HH", {1: 0, 5: 3}[len(values)], 0) + fixed(*values)


def sampled(light):
    """A curve of values of light at even codes."""
    codes = np.rint(np.asarray(light) * 65535).astype(">u2")
    return b"curv\0\0\0\0" + struct.pack(">I", len(codes)) + codes.tobytes()


def colorants(primaries):
    """Columns of red, green and blue in CIE XYZ, adapted to D50 in Bradford's cones."""
    xy = np.array(primaries)
    xyz = np.stack([xy[:, 0], xy[:, 1], 1 - xy.sum(axis=1)]) / xy[:, 1]
    from_rgb = xyz[:, :3] * np.linalg.solve(xyz[:, :3], xyz[:, 3])
    gain = (CONE @ D50) / (CONE @ xyz[:, 3])
    return np.linalg.inv(CONE) @ np.diag(gain) @ CONE @ from_rgb


def profile(primaries=DISPLAY_P3, curve=None, space=b"RGB "):
    """The bytes of a profile; of grey pictures for `space` GRAY."""
    curve = curve or parametric(*SRGB_CURVE)
    tags = {b"wtpt": b"XYZ \0\0\0\0" + fixed(*D50)}
    if space == b"GRAY":
        tags[b"kTRC"] = curve
    for letter, column in zip((b"r", b"g", b"b"), colorants(primaries).T, strict=True):
        if space != b"GRAY":
            tags[letter + b"XYZ"] = b"XYZ \0\0\0\0" + fixed(*column)
            tags[letter + b"TRC"] = curve
    at = 132 + 12 * len(tags)
    table, body = b"", b""
    for name, tag in tags.items():
        padded = tag + bytes(-len(tag) % 4)
        table += name + struct.pack(">II", at + len(body), len(tag))
        body += padded
    size = struct.pack(">I", at + len(body))
    head = size + bytes(4) + b"\x02\x40\0\0mntr" + space + b"XYZ " + bytes(12) + b"acsp"
    return head.ljust(128, b"\0") + struct.pack(">I", len(tags)) + table + body

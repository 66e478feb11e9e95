"""KTX2 pictures (KHR_texture_basisu): decoded, damaged, and without the decoder."""

import importlib.util
import struct

import numpy as np
import pytest
from support.glb_builder import QUAD_UV, GlbBuilder

from nlens_video.core.errors import SceneError
from nlens_video.scene import Scene

IDENTIFIER = b"\xabKTX 20\xbb\r\n\x1a\n"
SOLID = 23  # UASTC's code of 5 bits for a block of one colour
needs_decoder = pytest.mark.skipif(
    importlib.util.find_spec("opengl_basisu") is None, reason="opengl_basisu is not installed"
)


def ktx2(colors):
    """A KTX2 file of one UASTC block of 4x4 texels for each colour, side by side."""
    blocks = b"".join(
        (SOLID | int.from_bytes(bytes(color), "little") << 5).to_bytes(16, "little")
        for color in colors
    )
    # Basic data format descriptor: UASTC, BT.709, sRGB, blocks of 4x4 texels and 16 bytes, RGBA.
    sample = struct.pack("<HBBIII", 0, 127, 3, 0, 0, 2**32 - 1)
    plain = bytes([166, 1, 2, 0, 3, 3, 0, 0, 16, *[0] * 7])
    form = struct.pack("<IIHH", 44, 0, 2, 40) + plain + sample
    header = struct.pack("<9I", 0, 1, 4 * len(colors), 4, 0, 0, 1, 1, 0)
    index = struct.pack("<4I2Q", 104, len(form), 0, 0, 0, 0)
    level = struct.pack("<3Q", 160, len(blocks), len(blocks))
    before = IDENTIFIER + header + index + level + form
    return before + bytes(160 - len(before)) + blocks


COLORS = [(200, 100, 50, 255), (0, 255, 128, 64)]


def textured(data, fallback=None):
    builder = GlbBuilder()
    image = builder.add("images", {"bufferView": builder.view(data), "mimeType": "image/ktx2"})
    texture = {"extensions": {"KHR_texture_basisu": {"source": image}}}
    if fallback is not None:
        plain = builder.texture(np.full((2, 2, 4), fallback, np.uint8))
        texture["source"] = builder.document["textures"][plain]["source"]
    else:
        builder.document["extensionsRequired"] = ["KHR_texture_basisu"]
    number = builder.add("textures", texture)
    paint = {"pbrMetallicRoughness": {"baseColorTexture": {"index": number}}}
    mesh = builder.mesh(material=builder.add("materials", paint), TEXCOORD_0=QUAD_UV)
    builder.node(mesh=mesh)
    return builder


def pixels(builder, tmp_path):
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    return scene.pose(0.0).meshes[0].geometry.material.base_color_texture.image.picture.pixels


@needs_decoder
def test_ktx2_picture_is_decoded_with_its_first_row_on_top(tmp_path):
    expected = np.repeat(np.array([COLORS], np.uint8), 4, axis=1).repeat(4, axis=0)
    np.testing.assert_array_equal(pixels(textured(ktx2(COLORS)), tmp_path), expected)


@needs_decoder
@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[:50],
        lambda data: data[:120],
        lambda data: data[:-20],
        lambda data: data[:12] + b"\xff" * 8 + data[20:],
        lambda data: data[:20] + struct.pack("<II", 400, 4) + data[28:],
        lambda data: data[:80] + b"\xff" * 24 + data[104:],
    ],
)
def test_damaged_ktx2_picture_is_refused_in_one_line(tmp_path, damage):
    with pytest.raises(SceneError, match=r"images\[0\].*(broken|export it again)"):
        pixels(textured(damage(ktx2(COLORS))), tmp_path)


def test_a_ktx2_picture_beyond_the_bound_is_refused_before_it_is_decoded(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: name)
    data = ktx2(COLORS)
    data = data[:20] + struct.pack("<II", 100_000, 100_000) + data[28:]
    with pytest.raises(SceneError, match="make the textures smaller"):
        pixels(textured(data), tmp_path)


def test_a_plain_picture_is_taken_in_place_of_a_ktx2_one(tmp_path):
    found = pixels(textured(b"not read", fallback=7), tmp_path)
    assert (found == 7).all()


def test_missing_ktx2_decoder_error_states_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SceneError, match=r"images\[0\].*nlens-video\[ktx2\].*ktxdecompress"):
        pixels(textured(ktx2(COLORS)), tmp_path)

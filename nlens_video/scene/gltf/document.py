"""The container: a `.glb` or `.gltf` file's JSON and the bytes of its buffers.

Read here and not through a glTF library, because those that exist trust the file: a wrong type
reaches the caller as a traceback, a relative path leaves the folder.
"""

from __future__ import annotations

import base64
import binascii
import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from urllib.parse import unquote, urlsplit

from nlens_video.core.errors import SceneError
from nlens_video.scene.gltf import meshopt
from nlens_video.scene.gltf.extensions import check_required, left_out
from nlens_video.scene.gltf.fields import Fields

# Bounds of what a file may cost, however it lies about itself.
MAX_FILE_BYTES = 1 << 30  # of the file and all that lies beside it
MAX_JSON_PARTS = 2_000_000  # members and elements; each takes some 200 bytes once parsed
MAX_TEXTURE_BYTES = 2 << 30  # of all pictures, decoded
# The same bytes can be decoded again and again, and accessors of zeros need none at all.
_FREE_BYTES, _GROWTH = 512 << 20, 16
_MOST_WARNINGS = 100
_CHUNK = 1 << 20
_GLB_MAGIC = b"glTF"
_CONVERTIBLE = (
    ".3ds", ".abc", ".blend", ".dae", ".fbx", ".obj", ".ply", ".stl", ".usd", ".usda", ".usdc",
    ".usdz", ".x3d",
)  # fmt: skip
"""Extensions of models in other formats, which Blender writes as .glb."""
_JSON_CHUNK, _BIN_CHUNK = 0x4E4F534A, 0x004E4942


@dataclass(slots=True)
class Document:
    """A parsed file.

    Attributes:
        root: its JSON.
        folder: folder of the file; external buffers and images must lie inside it.
        binary: the GLB's binary chunk, if any.
        warnings: what was ignored, one line each.
    """

    root: Fields
    folder: Path
    binary: bytes | None
    warnings: list[str] = field(default_factory=list)
    _buffers: dict[int, bytes] = field(default_factory=dict)
    _decoded: dict[int, bytes] = field(default_factory=dict)
    _files: dict[Path, bytes] = field(default_factory=dict)
    _spent: int = 0
    _texture_bytes: int = 0
    _items: dict[str, tuple[Fields, ...]] = field(default_factory=dict)

    def items(self, key: str) -> tuple[Fields, ...]:
        """A top-level list of the file, such as `nodes`; empty where it is absent."""
        if key not in self._items:
            self._items[key] = self.root.children(key)
        return self._items[key]

    def warn(self, line: str) -> None:
        """Keep a line for the user, once; a hundred at most."""
        if len(self.warnings) < _MOST_WARNINGS and line not in self.warnings:
            self.warnings.append(line)

    def buffer(self, index: int) -> bytes:
        """The bytes of a buffer.

        Raises:
            SceneError: it is missing, shorter than declared, or outside the file's folder.
        """
        if index not in self._buffers:
            self._buffers[index] = self._load_buffer(index)
        return self._buffers[index]

    def spend(self, size: int, place: str, remedy: str = "") -> None:
        """Count memory that is about to be taken for a part of the file.

        Args:
            size: of the arrays [byte].
            place: the part, for the message.
            remedy: what the user can do, from the semicolon on; empty: nothing.

        Raises:
            SceneError: the file would take far more than its own bytes justify.
        """
        self._spent += size
        held = sum(map(len, self._buffers.values()))
        if self._spent > _FREE_BYTES + _GROWTH * held:
            raise SceneError(
                f"{place} would grow {held} bytes of data to {self._spent} in memory (more than "
                f"{_FREE_BYTES >> 20} MiB beyond {_GROWTH} times); not loaded{remedy}"
            )

    def spend_texture(self, width: int, height: int, place: str) -> None:
        """Count a picture that is about to be decoded.

        Raises:
            SceneError: all pictures together are beyond what is decoded.
        """
        self._texture_bytes += 4 * width * height
        if self._texture_bytes > MAX_TEXTURE_BYTES:
            raise SceneError(
                f"{place} ({width}x{height}) brings the pictures to {self._texture_bytes >> 20} "
                f"MiB, at most {MAX_TEXTURE_BYTES >> 20}; make the textures smaller"
            )

    def _load_buffer(self, index: int) -> bytes:
        declared = self.items("buffers")[index]
        length = declared.integer("byteLength")
        if "uri" in declared:
            data = self.fetch(declared.text("uri"), declared.place)
        elif index == 0 and self.binary is not None:
            data = self.binary
        else:
            raise SceneError(f"{declared.place} has neither a uri nor a binary chunk; export again")
        if len(data) < length:
            raise SceneError(
                f"{declared.place} has {len(data)} bytes, {length} declared; the file is truncated"
            )
        return data[:length]

    def buffer_view(self, index: int) -> memoryview:
        """The bytes of a buffer view.

        Raises:
            SceneError: it reaches beyond its buffer, or its compressed data are damaged.
        """
        view = self.items("bufferViews")[index]
        for name in meshopt.EXTENSIONS:
            compressed = view.extension(name)
            if compressed is not None:
                if index not in self._decoded:
                    size = compressed.integer("count") * compressed.integer("byteStride")
                    self.spend(size, compressed.place)
                    data = bytes(self._span(compressed))
                    self._decoded[index] = meshopt.decompress(compressed, data)
                return memoryview(self._decoded[index])
        return self._span(view)

    def _span(self, view: Fields) -> memoryview:
        data = self.buffer(view.integer("buffer", below=len(self.items("buffers"))))
        offset, length = view.integer("byteOffset", default=0), view.integer("byteLength")
        if offset + length > len(data):
            raise SceneError(
                f"{view.place} spans bytes {offset} to {offset + length} of a buffer of "
                f"{len(data)}; the file is damaged"
            )
        return memoryview(data)[offset : offset + length]

    def fetch(self, uri: str, place: str) -> bytes:
        """The bytes behind a URI: `data:` or a file in the folder of the glTF file.

        Raises:
            SceneError: not found, outside the folder, another scheme, or broken base64.
        """
        if uri.startswith("data:"):
            return _decode_data_uri(uri, place)
        parts = urlsplit(uri)
        if parts.scheme or parts.netloc:
            raise SceneError(
                f"{place}.uri points to {uri[:60]!r}; expected a file beside the scene"
            )
        return self._read_beside(unquote(uri), place)

    def _read_beside(self, name: str, place: str) -> bytes:
        folder = self.folder.resolve()
        try:
            target = (folder / name).resolve()
            if not target.is_relative_to(folder):
                raise SceneError(
                    f"{place}.uri leaves the scene's folder ({name[:60]!r}); move it in"
                )
            if not target.is_file():
                raise SceneError(
                    f"{place}.uri names {name[:60]!r}, which is missing beside the scene"
                )
            return self._read_once(target, place)
        except (OSError, ValueError, RuntimeError) as error:
            raise SceneError(f"{place}.uri cannot be read ({error})") from error

    def _read_once(self, target: Path, place: str) -> bytes:
        if target not in self._files:
            room = MAX_FILE_BYTES - sum(map(len, self._files.values()))
            self._files[target] = _read(target, room, f"{place}.uri: {target.name[:60]!r}")
        return self._files[target]


def _read(path: Path, room: int, place: str) -> bytes:
    data = bytearray()
    with path.open("rb") as file:
        while chunk := file.read(_CHUNK):
            data += chunk
            if len(data) > room:
                raise SceneError(
                    f"{place} brings the file to more than {MAX_FILE_BYTES >> 20} MiB; "
                    "make it smaller"
                )
    return bytes(data)


def _decode_data_uri(uri: str, place: str) -> bytes:
    header, comma, payload = uri.partition(",")
    if not comma or not header.endswith(";base64"):
        raise SceneError(f"{place}.uri is a data URI without base64; export the file again")
    try:
        return base64.b64decode(payload, validate=True)
    except (binascii.Error, ValueError) as error:
        raise SceneError(f"{place}.uri holds broken base64 ({error})") from error


def read_document(path: Path) -> Document:
    """Read a `.glb` or `.gltf` file.

    Raises:
        SceneError: not readable, no glTF 2, truncated, or it requires an unsupported extension.
    """
    try:
        data = _read(path, MAX_FILE_BYTES, "it")
    except OSError as error:
        reason = error.strerror or str(error)
        raise SceneError(f"cannot be read ({reason}); expected a .glb or .gltf file") from error
    if path.suffix.lower() in _CONVERTIBLE and not data.startswith(_GLB_MAGIC):
        raise SceneError(f"{path.suffix} is not read; convert it to .glb, by Blender for instance")
    text, binary = _split_glb(data) if data.startswith(_GLB_MAGIC) else (data, None)
    document = Document(_parse_json(text), path.parent, binary)
    _check_version(document.root)
    check_required(document.root)
    for line in left_out(document.root):
        document.warn(line)
    return document


def _split_glb(data: bytes) -> tuple[bytes, bytes | None]:
    if len(data) < 20:
        raise SceneError(f"{len(data)} bytes are no GLB file; it is truncated")
    version, length = struct.unpack_from("<II", data, 4)
    if version != 2:
        raise SceneError(f"GLB version {version}, expected 2; convert the file to glTF 2.0")
    if length > len(data):
        raise SceneError(f"GLB of {length} bytes has only {len(data)}; it is truncated")
    text: bytes | None = None
    binary: bytes | None = None
    position = 12
    while position + 8 <= length:
        size, kind = struct.unpack_from("<II", data, position)
        position += 8
        if position + size > length:
            raise SceneError(f"GLB chunk of {size} bytes at byte {position} is truncated")
        chunk = data[position : position + size]
        position += size
        if text is None:
            if kind != _JSON_CHUNK:
                raise SceneError("GLB does not begin with its JSON chunk; export the file again")
            text = chunk
        elif kind == _BIN_CHUNK and binary is None:
            binary = chunk
    if text is None:
        raise SceneError("GLB has no JSON chunk; it is truncated")
    return text, binary


def _reject_constant(name: str) -> float:
    raise ValueError(f"{name} is no JSON number")


def _parse_json(text: bytes) -> Fields:
    parts = sum(map(text.count, (b"{", b"[", b",")))
    if parts > MAX_JSON_PARTS:
        raise SceneError(
            f"its JSON has {parts} parts, at most {MAX_JSON_PARTS}; simplify the scene"
        )
    try:
        raw = json.loads(text.decode("utf-8-sig"), parse_constant=_reject_constant)
    except UnicodeDecodeError as error:
        raise SceneError(
            f"no glTF: it is neither binary nor text (byte {error.start}); expected .glb or .gltf"
        ) from error
    except (ValueError, RecursionError) as error:
        raise SceneError(
            f"no glTF: its JSON is broken ({error}); expected .glb or .gltf"
        ) from error
    if not isinstance(raw, dict):
        raise SceneError("no glTF: its JSON is not an object; expected .glb or .gltf")
    return Fields(raw, "")


def _check_version(root: Fields) -> None:
    asset = root.child("asset")
    if "version" not in asset:
        raise SceneError("no glTF: asset.version is missing; expected a glTF 2.0 file")
    version = asset.text("minVersion", asset.text("version"))
    if version.split(".")[0] != "2" or version not in {"2.0", "2"} and "minVersion" in asset:
        raise SceneError(f"glTF {version[:20]}, expected 2.0; convert the file to glTF 2.0")

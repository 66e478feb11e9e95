"""Decoders of untrusted bytes in a process of their own: Draco meshes and KTX2 pictures.

Arrays of bytes go in, arrays of numbers come out. The process has bounded memory and time, and what
goes wrong in a decoder ends it alone.
"""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

MEMORY_BYTES = 4 << 30  # of address space, the interpreter's own included
MAX_RESULT_BYTES = 1 << 30
_SECONDS = 100
_WALL_SECONDS = 120
Arrays = dict[str, npt.NDArray[np.generic]]


def decode(kind: str, coded: Mapping[str, npt.NDArray[np.uint8]]) -> Arrays | None:
    """Decode in another process; None for what is broken or too large.

    Args:
        kind: `draco` or `ktx2`.
        coded: bytes by name.

    Returns:
        Draco: `NAME/faces` (3 F, 1) and `NAME/ATTRIBUTE` (V, width). KTX2: `NAME` (H, W, 4), 8 bit.

    Raises:
        OSError: it cannot be started.
        subprocess.TimeoutExpired: it takes too long.
    """
    packed = io.BytesIO()
    np.savez(packed, **coded)  # type: ignore[arg-type]  # the names are ours
    # By its path, so that it need not load this package.
    command = [sys.executable, "-P", str(Path(__file__)), kind]
    run = subprocess.run(
        command, input=packed.getvalue(), capture_output=True, timeout=_WALL_SECONDS, check=False
    )
    if run.returncode != 0:
        return None
    with np.load(io.BytesIO(run.stdout), allow_pickle=False) as found:
        return {name: found[name] for name in found.files}


def main() -> int:
    """Decode an npz of standard input to an npz on standard output; the exit status."""
    _limit()
    add = _KINDS[sys.argv[1]]
    results: Arrays = {}
    with np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False) as views:
        for name in views.files:
            add(results, name, views[name].tobytes())
            if sum(values.nbytes for values in results.values()) > MAX_RESULT_BYTES:
                return 1
    packed = io.BytesIO()
    np.savez(packed, **results)  # type: ignore[arg-type]  # the names are ours
    sys.stdout.buffer.write(packed.getvalue())
    return 0


def _add_mesh(results: Arrays, name: str, data: bytes) -> None:
    import DracoPy

    mesh = DracoPy.decode(data)
    results[f"{name}/faces"] = np.asarray(mesh.faces).reshape(-1, 1).astype(np.uint32)
    for attribute in mesh.attributes:
        values = np.asarray(attribute["data"])
        results[f"{name}/{attribute['unique_id']}"] = values.reshape(len(values), -1)


def _add_picture(results: Arrays, name: str, data: bytes) -> None:
    import opengl_basisu

    results[name] = np.asarray(opengl_basisu.open(data).transcode("rgba8", level=0).data, np.uint8)


_KINDS: dict[str, Callable[[Arrays, str, bytes], None]] = {
    "draco": _add_mesh,
    "ktx2": _add_picture,
}


def _limit() -> None:
    """Bound memory and time where the system can."""
    try:
        import resource
    except ImportError:
        return
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
    resource.setrlimit(resource.RLIMIT_CPU, (_SECONDS, _SECONDS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))


if __name__ == "__main__":
    sys.exit(main())

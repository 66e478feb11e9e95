"""The process that decodes Draco: arrays of bytes in, arrays of numbers out (`draco.py`)."""

from __future__ import annotations

import io
import sys

import numpy as np

MEMORY_BYTES = 4 << 30  # of address space, the interpreter's own included
MAX_RESULT_BYTES = 512 << 20
_SECONDS = 100


def main() -> int:
    """Decode an npz of standard input to an npz on standard output; the exit status."""
    _limit()
    import DracoPy

    results: dict[str, np.typing.NDArray[np.generic]] = {}
    with np.load(io.BytesIO(sys.stdin.buffer.read()), allow_pickle=False) as views:
        for name in views.files:
            mesh = DracoPy.decode(views[name].tobytes())
            results[f"{name}/faces"] = np.asarray(mesh.faces).reshape(-1, 1).astype(np.uint32)
            for attribute in mesh.attributes:
                values = np.asarray(attribute["data"])
                results[f"{name}/{attribute['unique_id']}"] = values.reshape(len(values), -1)
            if sum(values.nbytes for values in results.values()) > MAX_RESULT_BYTES:
                return 1
    packed = io.BytesIO()
    np.savez(packed, **results)  # type: ignore[arg-type]  # the names are ours
    sys.stdout.buffer.write(packed.getvalue())
    return 0


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

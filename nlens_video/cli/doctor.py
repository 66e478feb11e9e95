"""What this machine lacks: the memory that every run needs, and the command `doctor`."""

from __future__ import annotations

import io
import json
import os
import platform
import resource
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from msgspec import Struct
from msgspec.structs import asdict

from nlens_video.core.errors import NlensError
from nlens_video.core.stdio import print_out
from nlens_video.core.version import VERSION
from nlens_video.kernels.control_groups import memory_limit

_GB = 1 << 30
ADDRESSES = 2.0 * _GB
"""Address space that libraries and their threads reserve [bytes], beside that of each core:"""
ADDRESSES_PER_CORE = 0.2 * _GB
RESIDENT = 0.4 * _GB
"""Memory that the smallest run uses [bytes]."""
_LIBRARIES = (
    "numpy", "av", "opencv-contrib-python-headless", "onnxruntime", "pyrender2",
    "PyOpenGL", "trimesh", "OpenEXR", "torch", "pycolmap", "usd-core", "DracoPy", "opengl_basisu",
    "starlette", "uvicorn", "websockets", "ray",
)  # fmt: skip
_OPTIONAL = {
    "torch": "needed for training only",
    "pycolmap": "needed to solve cameras that move: pip install nlens-video[solve]",
    "usd-core": "needed for cameras in USD files: pip install nlens-video[usd]",
    "DracoPy": "needed for Draco meshes: pip install nlens-video[draco]",
    "opengl_basisu": "needed for KTX2 textures: pip install nlens-video[ktx2]",
    **dict.fromkeys(
        ("starlette", "uvicorn", "websockets"),
        "needed for the studio: pip install nlens-video[studio]",
    ),
    "ray": "needed for a farm of Ray workers: pip install nlens-video[farm]",
    "OpenGL": "",
}
_ENCODERS = ("libx264", "libx265", "libvpx-vp9", "libsvtav1", "ffv1", "prores_ks", "png", "aac")


def require_memory() -> None:
    """Check that a run can start, before libraries load that abort without memory.

    Raises:
        NlensError: a limit, or what is free, is below what every run needs.
    """
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    needed = address_space()
    if limit != resource.RLIM_INFINITY and limit < needed:
        raise NlensError(
            f"the address space is limited to {limit / _GB:.2f} GB, at least {needed / _GB:.2f} GB "
            "are needed; call ulimit -v unlimited before"
        )
    for what, size in _memories():
        if size < RESIDENT:
            raise NlensError(
                f"{what} {size / _GB:.2f} GB of memory, at least {RESIDENT / _GB:.1f} GB are "
                "needed; end other programs, or give the container more"
            )


def address_space() -> int:
    """Address space that a run needs on this machine [bytes]."""
    return int(ADDRESSES + ADDRESSES_PER_CORE * (os.cpu_count() or 1))


def _memories() -> Iterator[tuple[str, float]]:
    """Limits of memory with their source [bytes]: the container, the machine."""
    limit = memory_limit()
    if limit is not None:
        yield "this container allows", float(limit)
    free = dict(line.split(":", 1) for line in _meminfo().splitlines())
    if "MemAvailable" in free:
        kilobytes = [free.get(name, "0").split()[0] for name in ("MemAvailable", "SwapFree")]
        yield "this machine has", 1024.0 * sum(map(int, kilobytes))


def _meminfo() -> str:
    try:
        return Path("/proc/meminfo").read_text()
    except OSError:
        return ""


class Finding(Struct, frozen=True, kw_only=True):
    """The result of one check.

    Attributes:
        what: the part.
        works: whether it works; None where it is optional and absent.
        detail: version or backend; else what to do.
    """

    what: str
    works: bool | None
    detail: str


def examine(*, as_json: bool) -> int:
    """Run all checks and print them; exit code 0 where a run is possible, else 1."""
    findings = [_program(), *map(_library, _LIBRARIES)]
    for what, attempt in (
        ("renderer", _renderer),
        ("OpenGL", _opengl),
        ("encoders", _encoders),
        ("networks", _networks),
        ("scatter kernel", _kernel),
        ("pipelines", _pipelines),
    ):
        findings.append(_tried(what, attempt))
    if as_json:
        print_out(json.dumps([asdict(finding) for finding in findings], indent=2) + "\n")
    else:
        _show(findings)
    return 1 if any(finding.works is False for finding in findings) else 0


def _tried(what: str, attempt: Callable[[], str]) -> Finding:
    try:
        return Finding(what=what, works=True, detail=attempt())
    except (NlensError, OSError, ImportError, RuntimeError) as error:
        works = None if what in _OPTIONAL else False
        return Finding(what=what, works=works, detail=" ".join(str(error).split()))


def _program() -> Finding:
    where = f"Python {sys.version.split()[0]} on {platform.system()} {platform.machine()}"
    return Finding(what="nlens-video", works=True, detail=f"{VERSION}, {where}")


def _library(name: str) -> Finding:
    from importlib import metadata  # here: it takes long to load

    try:
        return Finding(what=name, works=True, detail=metadata.version(name))
    except metadata.PackageNotFoundError:
        if name in _OPTIONAL:
            return Finding(what=name, works=None, detail=f"not installed; {_OPTIONAL[name]}")
        return Finding(what=name, works=False, detail=f"not installed; pip install {name}")


def _renderer() -> str:
    from nlens_video.render.select import renderer_choice

    return renderer_choice()


def _opengl() -> str:
    try:
        from nlens_video.render.opengl.egl_platform import describe, open_platform

        platform = open_platform()
    except (ImportError, AttributeError, RuntimeError) as error:
        # PyOpenGL reports a missing library as an attribute of None
        raise RuntimeError(
            f"no headless OpenGL ({error}); apt-get install libegl1 libgl1"
        ) from error
    try:
        return describe()
    finally:
        platform.delete_context()


def _encoders() -> str:
    import av

    there = [name for name in _ENCODERS if name in av.codecs_available]
    if "libx264" not in there:
        raise RuntimeError("FFmpeg has no libx264: install PyAV's wheel (pip install av)")
    return ", ".join(there)


def _networks() -> str:
    from nlens_video.networks.model_store import find_model, model_names

    names = model_names()
    for name in names:
        find_model(name)
    return f"{', '.join(names)}: sha256 verified"


def _kernel() -> str:
    import numpy as np

    from nlens_video import native
    from nlens_video.kernels.scatter.scatter import scatter

    out = scatter(np.ones((9, 9, 4), np.float32), np.full((9, 9), 3.0, np.float32))
    if not np.allclose(out, 1.0):
        raise RuntimeError("the compiled kernel gives wrong numbers; install nlens-video again")
    return f"compiled for {native.kernels.__name__.rpartition('._')[2]}"


def _pipelines() -> str:
    from nlens_video.graph.pipeline_file import load_pipeline, shipped_pipelines

    return ", ".join(load_pipeline(name).name for name in shipped_pipelines())


def _show(findings: list[Finding]) -> None:
    from rich.console import Console
    from rich.table import Table

    marks = {True: "[green]ok[/]", False: "[red]missing[/]", None: "[yellow]optional[/]"}
    table = Table(box=None, show_header=False, pad_edge=False)
    for finding in findings:
        table.add_row(finding.what, marks[finding.works], finding.detail)
    drawn = io.StringIO()
    coloured = sys.stdout is not None and sys.stdout.isatty()
    Console(file=drawn, force_terminal=coloured).print(table)
    print_out(drawn.getvalue())

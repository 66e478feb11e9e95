"""Compiles `nlens_video/native` when a wheel is built or the checkout is installed.

`python hatch_build.py` compiles it into the checkout again, as `make native` does;
`python hatch_build.py address,undefined` with these sanitizers of the compiler, as `make sanitize`.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).resolve().parent
NATIVE = Path("nlens_video") / "native"


class NativeBuildHook(BuildHookInterface[Any]):
    """Compiles the kernels into the wheel, or into the checkout where that is installed itself."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Called by hatchling before it collects the wheel's files."""
        if self.target_name != "wheel":
            return
        self._folder = tempfile.TemporaryDirectory(prefix="nlens-video-native-")
        build, made = Path(self._folder.name, "build"), Path(self._folder.name, "made")
        if version == "editable":
            made = ROOT
        compile_kernels(build, made)
        build_data["pure_python"] = False
        build_data["infer_tag"] = True
        if version != "editable":
            build_data["force_include"][str(made / NATIVE)] = str(NATIVE)

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Called by hatchling when the wheel is written."""
        if self.target_name == "wheel":
            self._folder.cleanup()


def compile_kernels(build: Path, prefix: Path, sanitizers: str = "") -> None:
    """Compile the modules of all levels of processors.

    Args:
        build: folder for CMake's files; kept, it saves time when little has changed.
        prefix: folder in which `nlens_video/native` gets the modules.
        sanitizers: those of the compiler, separated by commas; default: none.

    Raises:
        SystemExit: CMake or the compiler failed; they have said why.
    """
    # where pip has put ninja, or the environment of this Python has it
    programs = os.pathsep.join([str(Path(sys.executable).parent), os.environ.get("PATH", "")])
    for step in (
        ["-S", str(ROOT / NATIVE), "-B", str(build), "-G", "Ninja",
         f"-DPython_EXECUTABLE={sys.executable}", f"-DNLENS_SANITIZE={sanitizers}"],
        ["--build", str(build)],
        ["--install", str(build), "--prefix", str(prefix)],
    ):  # fmt: skip
        done = subprocess.run(
            [sys.executable, "-m", "cmake", *step],
            stdout=sys.stderr, env={**os.environ, "PATH": programs}, check=False,
        )  # fmt: skip
        if done.returncode:
            raise SystemExit(f"cmake {step[0]} failed; a C++20 compiler is needed (Debian: g++)")


if __name__ == "__main__":
    chosen = "".join(sys.argv[1:])
    compile_kernels(ROOT / "build" / ("sanitized" if chosen else "native"), ROOT, chosen)

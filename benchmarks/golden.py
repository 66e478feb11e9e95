"""Golden results: are the pictures still the bits they were?

  python benchmarks/golden.py                 compare with the record of this kind of processor
  python benchmarks/golden.py --record        record anew, after a change that changes pictures
  python benchmarks/golden.py --against REV   compare with another revision, run here and now

Each case runs the command line and takes a SHA-256 of every decoded sample: of lossless results, of
the EXR layers of `--aov`, of the fit. Compiled kernels give other last bits on other processors and
with other versions of the libraries, so records are kept for each kind of machine; where there is
none, the revision that was recorded last is run here and compared with. A kernel that was compiled
in this very process can differ in its last bits from the same kernel loaded from the cache, so a
case counts when two runs in a row agree. Cases on the ground truth need its folder (--truth).
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from importlib.metadata import version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RECORD = Path(__file__).with_suffix(".json")
TRUTH = ROOT.parent / "shared" / "data" / "cycles" / "dev"
PLATES = (
    "indoor_back", "indoor_front", "street_back", "street_front", "table_back", "table_front",
)  # fmt: skip
DEMO = ("samples/in.mp4", "samples/anim.glb")
EVERY_EFFECT = (
    "--effects", "defocus,shadow,motion-blur,grain,softness,vignetting,distortion,reflection",
    "--vignetting", "0.6", "--distortion", "0.04,-0.01", "--reflect", "0.2", "--shutter", "270",
)  # fmt: skip
_MOST_RUNS = 4
LIBRARIES = ("numpy", "onnxruntime", "opencv-contrib-python-headless", "av")


def cases(truth: Path) -> Iterator[tuple[str, list[str]]]:
    """Name and words of each case; OUT and AOV stand for a file and a folder of its own."""
    for preset, frames in (
        ("draft", 24), ("realtime", 24), ("standard", 24), ("paper", 3), ("reference", 4),
    ):  # fmt: skip
        yield f"demo {preset}", [*DEMO, "OUT.mkv", "--preset", preset, "--range", f"0:{frames}"]
    yield "demo every effect", [*DEMO, "OUT.mkv", "--range", "40:52", *EVERY_EFFECT]
    yield "demo layers", [*DEMO, "OUT.mkv", "--range", "60:63", "--aov", "AOV"]
    park = ["samples/in2.mp4", "samples/anim2.glb", "OUT.mkv"]
    yield "park realtime", [*park, "--preset", "realtime", "--range", "0:12"]
    for name in PLATES:
        plate = truth / name
        if plate.is_dir():
            files = [f"{plate}/bg.png", f"{plate}/object.glb", "OUT.png"]
            yield f"{name} layers", [*files, "--layers", f"{plate}/object.exr"]
            yield f"{name} render", files


def run_case(words: list[str], checkout: Path, folder: Path) -> dict[str, str]:
    """Run one case in a checkout; what it wrote, by part.

    Raises:
        SystemExit: the run failed.
    """
    out = folder / next(word for word in words if word.startswith("OUT")).lower()
    names = {f"OUT{out.suffix}": str(out), "AOV": str(folder / "aov")}
    fit = folder / "fit.json"
    encoder = ["--codec", "ffv1"] if out.suffix == ".mkv" else []
    command = [
        sys.executable, "-m", "nlens_video", *(names.get(word, word) for word in words),
        "--save-fit", str(fit), "--no-progress", "-q", *encoder,
    ]  # fmt: skip
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    done = subprocess.run(
        command, cwd=checkout, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        sys.exit(f"{' '.join(command)}\nended with {done.returncode}: {done.stderr.strip()}")
    parts = {"pictures": _of_frames(out), "fit": hashlib.sha256(fit.read_bytes()).hexdigest()}
    if (folder / "aov").is_dir():
        parts["layers"] = _of_layers(folder / "aov")
    return parts


def _of_frames(path: Path) -> str:
    import av
    import numpy as np

    digest = hashlib.sha256()
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            digest.update(f"{frame.pts} {frame.format.name} {frame.width}x{frame.height}".encode())
            digest.update(np.ascontiguousarray(frame.to_ndarray()).tobytes())
    return digest.hexdigest()


def _of_layers(folder: Path) -> str:
    import numpy as np
    import OpenEXR

    digest = hashlib.sha256()
    for path in sorted(folder.rglob("*.exr")):
        with OpenEXR.File(str(path), separate_channels=True) as file:
            for name, channel in sorted(file.channels().items()):
                digest.update(f"{path.name} {name}".encode())
                digest.update(np.ascontiguousarray(channel.pixels).tobytes())
    return digest.hexdigest()


def run_all(checkout: Path, truth: Path) -> dict[str, dict[str, str]]:
    """Every case in a checkout, told as it goes."""
    found = {}
    for name, words in cases(truth):
        start = time.perf_counter()
        found[name] = _settled(words, checkout)
        print(f"{name:24s} {time.perf_counter() - start:6.1f} s", file=sys.stderr, flush=True)
    return found


def _settled(words: list[str], checkout: Path) -> dict[str, str]:
    """What two runs in a row agree on."""
    before: dict[str, str] = {}
    for _ in range(_MOST_RUNS):
        with tempfile.TemporaryDirectory() as folder:
            now = run_case(words, checkout, Path(folder))
        if now == before:
            return now
        before = now
    sys.exit(f"{' '.join(words)}: {_MOST_RUNS} runs, and no two in a row gave the same")


def run_revision(revision: str, truth: Path) -> dict[str, dict[str, str]]:
    """Every case in a checkout of another revision."""
    with tempfile.TemporaryDirectory() as folder:
        checkout = Path(folder) / "checkout"
        git = ["git", "-C", str(ROOT), "worktree"]
        subprocess.run([*git, "add", "-q", "--detach", str(checkout), revision], check=True)
        try:
            compiling = [sys.executable, str(checkout / "hatch_build.py")]
            subprocess.run(compiling, cwd=checkout, check=True, stdout=subprocess.DEVNULL)
            return run_all(checkout, truth)
        finally:
            subprocess.run([*git, "remove", "--force", str(checkout)], check=True)


def machine() -> str:
    """What the last bits depend on: the processor's kind and the libraries' versions.

    Our own kernels give the same bits everywhere; those of the libraries go by the processor.
    """
    facts = dict.fromkeys(("vendor_id", "cpu family", "model"), "unknown")
    for line in Path("/proc/cpuinfo").read_text().splitlines():
        name, _, value = (part.strip() for part in line.partition(":"))
        if name in facts:
            facts[name] = value
    cpu = " ".join(facts.values())
    libraries = ", ".join(f"{name} {version(name)}" for name in LIBRARIES)
    return f"{platform.machine()} {cpu}, Python {platform.python_version()}, {libraries}"


def differences(
    before: dict[str, dict[str, str]], after: dict[str, dict[str, str]]
) -> Iterator[str]:
    """A line for each part that differs."""
    for name, parts in after.items():
        if name not in before:
            yield f"{name}: not recorded"
            continue
        for part, digest in parts.items():
            if before[name].get(part) != digest:
                yield f"{name}: {part} differ"


def main() -> int:
    """Compare or record; 1 where something differs."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--record", action="store_true")
    parser.add_argument("--against", metavar="REV")
    parser.add_argument("--truth", type=Path, default=TRUTH)
    words = parser.parse_args()
    records = json.loads(RECORD.read_text()) if RECORD.exists() else {}
    here = machine()
    now = run_all(ROOT, words.truth)
    if words.record:
        head = ["git", "-C", str(ROOT), "rev-parse", "HEAD"]
        revision = subprocess.run(head, check=True, capture_output=True, text=True).stdout.strip()
        kept = records.get("machines", {}) if records.get("revision") == revision else {}
        records = {"revision": revision, "machines": {**kept, here: now}}
        RECORD.write_text(json.dumps(records, indent=1) + "\n")
        print(f"recorded {len(now)} cases for {here}")
        return 0
    revision = words.against
    if revision is None and here not in records.get("machines", {}):
        revision = records["revision"]
        print(f"no record for {here}: comparing with revision {revision}", file=sys.stderr)
    before = records["machines"][here] if revision is None else run_revision(revision, words.truth)
    found = list(differences(before, now))
    print("\n".join(found) or f"{len(now)} cases, every bit as it was")
    return int(bool(found))


if __name__ == "__main__":
    sys.exit(main())

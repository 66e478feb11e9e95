"""What a run writes must not be what it reads: a slip of the hand must not cost the footage."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from nlens_video.errors import OutputError
from nlens_video.settings import Settings
from nlens_video.video.numbered import Numbered

_PLATE, _RESULT = "the plate", "the result"


def refuse_overwriting(settings: Settings) -> None:
    """See that no file that the run writes is one that it reads, nor two of them the same.

    The plate and the result are compared where the result is opened.

    Args:
        settings: the run.

    Raises:
        OutputError: one of them is.
    """
    taken = list(_read(settings))
    for name, path in _written(settings):
        for what, other in taken:
            if (name, what) != (_RESULT, _PLATE) and _same(path, other):
                raise OutputError(f"{name} {path}: is {what} as well; give it another name")
        taken.append((name, path))
    if settings.aov is not None:
        for what, other in _read(settings):
            if other.suffix.lower() == ".exr" and _same(settings.aov, other.parent):
                raise OutputError(
                    f"--aov {settings.aov}: is the folder of {what} as well; give another folder"
                )


def _read(settings: Settings) -> Iterator[tuple[str, Path]]:
    scene = settings.scene
    for what, spec in (
        (_PLATE, settings.source.spec),
        ("the scene", scene.glb),
        ("--layers", scene.layers),
        ("--holdout", scene.real.holdout),
        ("--env", scene.light.env),
        ("the pipeline", settings.preset if settings.preset.endswith(".toml") else None),
    ):
        if spec is not None and spec != "-":
            yield what, Path(spec)


def _written(settings: Settings) -> Iterator[tuple[str, Path]]:
    output = settings.output
    if output is not None and output.spec != "-":
        yield _RESULT, Path(output.spec)
    if settings.save_fit is not None:
        yield "--save-fit", settings.save_fit
    if settings.timings is not None:
        yield "--timings", settings.timings


def _same(one: Path, other: Path) -> bool:
    """Whether two names stand for one file, or a pattern's for one of its files."""
    for pattern, file in ((one, other), (other, one)):
        if Numbered.matches(str(pattern)) and Numbered(str(pattern)).number(file) is not None:
            return True
    if one.exists() and other.exists():
        return one.samefile(other)
    return one.resolve() == other.resolve()

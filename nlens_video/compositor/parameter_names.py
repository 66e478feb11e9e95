"""Messages that name the command line's options, in the words of Python's parameters."""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager

from nlens_video.core.errors import NlensError
from nlens_video.effects.planner import EFFECTS

PARAMETERS = frozenset(
    "preset effects fit fallback budget_ms device ground_y camera scene footprint animation loop "
    "animation_speed animation_offset at size yaw fov horizon env env_rotation env_exposure "
    "shadow_strength holdout occlusion reflect shutter vignetting distortion track_focus aperture "
    "cat_eye".split()
)
"""Options of the command line that a `Compositor` takes under the same names."""

_NUMBER = r"-?\d[\d.]*"
_PLACEHOLDER = re.compile(r"[A-Z][A-Z0-9,]*(\.[a-z]+)?")
_FLAG = re.compile(r"--(?P<name>[a-z][a-z-]*)(?P<gap>[ =](?P<value>[^\s;:()]*[^\s;:(),.]))?")
_WORDS = frozenset(
    [*EFFECTS, "auto", "all", "none", "off", "constant", "cpu", "cuda"]
    + ["draft", "realtime", "standard", "reference", "paper"]
)


@contextmanager
def naming_parameters() -> Iterator[None]:
    """Let errors from inside name Python's parameters in place of the command line's options."""
    try:
        yield
    except NlensError as error:
        error.args = (in_python(str(error)),)
        raise


def in_python(message: str) -> str:
    """A message with the options that are parameters too as Python writes them.

    >>> in_python("--at 0.4,0.2 lies above the horizon (--horizon 0.5); see --plan")
    'at=(0.4, 0.2) lies above the horizon (horizon=0.5); see --plan'
    """
    return _FLAG.sub(_parameter, message)


def _parameter(found: re.Match[str]) -> str:
    name = found["name"].replace("-", "_")
    if name not in PARAMETERS:
        return found[0]
    value = found["value"]
    if value is None:
        return name
    if re.fullmatch(_NUMBER, value):
        return f"{name}={value}"
    if re.fullmatch(rf"{_NUMBER}(,{_NUMBER})+", value):
        return f"{name}=({value.replace(',', ', ')})"
    if all(word.lstrip("+-") in _WORDS for word in value.split(",")):
        return f'{name}="{value}"'
    if _PLACEHOLDER.fullmatch(value):
        return name
    return f"{name}{found['gap']}"

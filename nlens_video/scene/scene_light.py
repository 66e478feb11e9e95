"""Where a scene's light comes from: its own lights, an environment map, or the plate."""

from __future__ import annotations

from collections.abc import Callable

from nlens_video.core.layers import Float32
from nlens_video.scene.gltf.lights import PosedLight
from nlens_video.scene.illumination import Illumination, Lamp

MAX_LAMPS = 32
"""As many lights the object is drawn with."""


class SceneLight:
    """What lights an object and its ground.

    Args:
        count: lights that the file has.
        environment: a reduced environment map, which lights the object beside them.
    """

    def __init__(self, count: int, environment: Illumination | None = None) -> None:
        self._count = count
        self._environment = environment
        self._estimate: Illumination | None = None

    @property
    def known(self) -> bool:
        """Whether a file tells the light; else the plate is asked."""
        return self._count > 0 or self._environment is not None

    @property
    def note(self) -> str:
        """What lights the object, in words."""
        found = []
        if self._count:
            found.append(f"the file's {self._count} light{'s' if self._count > 1 else ''}")
        if self._environment is not None:
            count = len(self._environment.lamps)
            found.append(
                f"the environment map ({count or 'no'} light{'' if count == 1 else 's'} of it, "
                "the rest from around)"
            )
        if not found:
            return (
                "the file has no lights and there is no --env: level and tint of the light are "
                "estimated from the plate, a key light from above is a guess"
            )
        lamps = self._count + len(self._environment.lamps if self._environment else ())
        beyond = f"; of all lights the first {MAX_LAMPS}" if lamps > MAX_LAMPS else ""
        return f"lit by {' and '.join(found)}{beyond}"

    def look_at(self, plate: Callable[[], Float32]) -> None:
        """Estimate the light from a plate, scene-linear (H, W, 3), unless it is known already."""
        if not self.known and self._estimate is None:
            self._estimate = Illumination.of_plate(plate())

    def on_object(self, lights: tuple[PosedLight, ...]) -> Illumination:
        """What the object is drawn with, its file's lights being these."""
        if not self.known:
            return self._estimate or Illumination.of_plate(None)
        return self._joined(lights)

    def on_ground(self, lights: tuple[PosedLight, ...]) -> Illumination:
        """What the object takes from the ground: no lamp whose place is a guess."""
        if self.known:
            return self._joined(lights)
        return Illumination((), self.on_object(()).ambient)

    def _joined(self, lights: tuple[PosedLight, ...]) -> Illumination:
        own = tuple(Lamp(light) for light in lights)
        environment = self._environment or Illumination((), None)
        return Illumination((*own, *environment.lamps)[:MAX_LAMPS], environment.ambient)

"""Where a scene's light comes from: its own lights, an environment map, or the plate."""

from __future__ import annotations

from dataclasses import dataclass

from nlens_video.core.errors import Note, NoteKind
from nlens_video.scene.gltf.lights import PosedLight
from nlens_video.scene.illumination import Illumination, Lamp

MAX_LAMPS = 32
"""As many lights the object is drawn with."""


@dataclass(frozen=True, slots=True, eq=False)
class SceneLight:
    """What a file and an environment map tell of the light on an object and its ground.

    Where neither tells anything, the methods take what was estimated from the plate.

    Attributes:
        count: lights that the file has.
        environment: a reduced environment map, which lights the object beside them.
    """

    count: int
    environment: Illumination | None = None

    @property
    def known(self) -> bool:
        """Whether a file tells the light; else the plate is asked."""
        return self.count > 0 or self.environment is not None

    @property
    def note(self) -> Note:
        """What lights the object, in words."""
        found = []
        if self.count:
            found.append(f"the file's {self.count} light{'s' if self.count > 1 else ''}")
        if self.environment is not None:
            count = len(self.environment.lamps)
            found.append(
                f"the environment map ({count or 'no'} light{'' if count == 1 else 's'} of it, "
                "the rest from around)"
            )
        if not found:
            return Note(
                "the file has no lights and there is no --env: level and tint of the light are "
                "estimated from the plate, a key light from above is a guess",
                NoteKind.LIGHTS_MISSING,
            )
        lamps = self.count + len(self.environment.lamps if self.environment else ())
        text = f"lit by {' and '.join(found)}"
        if lamps > MAX_LAMPS:
            return Note(f"{text}; of all lights the first {MAX_LAMPS}", NoteKind.LIGHTS_LIMITED)
        return Note(text, NoteKind.INFORMATION)

    def on_object(
        self, lights: tuple[PosedLight, ...], plate_light: Illumination | None = None
    ) -> Illumination:
        """What the object is rendered with.

        Args:
            lights: the file's, at this moment.
            plate_light: estimated from the plate; None for a plausible light.
        """
        if not self.known:
            return plate_light or Illumination.of_plate(None)
        return self._joined(lights)

    def on_ground(
        self, lights: tuple[PosedLight, ...], plate_light: Illumination | None = None
    ) -> Illumination:
        """What the object takes from the ground: no lamp whose direction is a guess.

        Args:
            lights: the file's, at this moment.
            plate_light: estimated from the plate; None for a plausible light.
        """
        if self.known:
            return self._joined(lights)
        return Illumination((), self.on_object((), plate_light).ambient)

    def _joined(self, lights: tuple[PosedLight, ...]) -> Illumination:
        own = tuple(Lamp(light) for light in lights)
        environment = self.environment or Illumination((), None)
        return Illumination((*own, *environment.lamps)[:MAX_LAMPS], environment.ambient)

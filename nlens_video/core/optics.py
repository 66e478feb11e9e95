"""Optics of the plate's camera: aperture, shutter, aberration, vignetting, distortion, bloom.

Imports nothing heavy. Radii of lens models are in half diagonals: 0 in the middle of the frame, 1
in its corners.

The aperture's shape is that of the blurred image of a point *behind* the focal plane (x right,
y down); in front of it the image is rotated by 180 degrees. `coc_px` is the diameter of the disc of
the same *area* as the aperture, so that blades change the shape of a blur and not its amount. A
cat's eye is cut out of that shape without scaling it.
"""

from __future__ import annotations

import math
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import UsageError

FEWEST_BLADES, MOST_BLADES = 3, 32


class Aperture(Struct, frozen=True, kw_only=True):
    """An aperture: round, made of blades, or a picture.

    Attributes:
        blades: how many blades, 0 for a round aperture [1].
        rotation_deg: clockwise turn of the blades in the picture; at 0 a corner points right [deg].
        roundness: how far the blades bulge, from 0, straight, to 1, a full circle [1].
        cat_eye: how far, in radii, the rim of the barrel lies across the aperture as seen from a
            corner of the frame: 0 for not at all, 1 at most [radius].
        image: picture whose brightness is the aperture's transmission, None for blades or round.
            Its CoC is that of the disc of area sum / maximum of the picture.
    """

    blades: int = 0
    rotation_deg: float = 0.0
    roundness: float = 0.0
    cat_eye: float = 0.0
    image: Path | None = None

    def __post_init__(self) -> None:
        if self.blades != 0 and not FEWEST_BLADES <= self.blades <= MOST_BLADES:
            raise UsageError(
                f"an aperture of {self.blades} blades: there may be {FEWEST_BLADES} to "
                f"{MOST_BLADES}; write round for none"
            )
        if not math.isfinite(self.rotation_deg):
            raise UsageError(f"aperture rotation {self.rotation_deg}: must be a number of degrees")
        for name, value in (("roundness", self.roundness), ("cat-eye", self.cat_eye)):
            if not 0.0 <= value <= 1.0:
                raise UsageError(f"aperture {name} {value}: must lie between 0 and 1")
        if self.image is not None and (self.blades or self.cat_eye):
            raise UsageError(
                f"aperture {self.image}: a picture has neither blades nor a cat's eye; leave "
                "them out"
            )

    @property
    def round(self) -> bool:
        """Whether it is a disc all over the frame."""
        circle = self.blades == 0 or self.roundness == 1.0
        return circle and self.cat_eye == 0.0 and self.image is None


ROUND = Aperture()


def parse_aperture(text: str, *, cat_eye: float = 0.0) -> Aperture | None:
    """Read `auto`, `round`, `BLADES[:ROTATION[:ROUNDNESS]]`, or the path of a picture.

    Args:
        text: the value of `--aperture`.
        cat_eye: strength of the cat's eye towards the corners, 0 to 1 [radius].

    Returns:
        The aperture; None for `auto` without a cat's eye: the one that the plate shows.

    Raises:
        UsageError: none of these, or values out of range.
    """
    if text == "auto" and cat_eye == 0.0:
        return None
    if text in ("auto", "round"):
        return Aperture(cat_eye=cat_eye)
    if Path(text).suffix.lower() in (".png", ".jpg", ".jpeg", ".tif", ".tiff", ".bmp", ".exr"):
        return Aperture(image=Path(text), cat_eye=cat_eye)
    blades, *numbers = text.split(":")
    try:
        if len(numbers) > 2:
            raise ValueError
        rotation, roundness = (*map(float, numbers), *(0.0, 0.0)[len(numbers) :])
        count = int(blades)
    except ValueError:
        raise UsageError(
            f"aperture {text!r} is not auto, round, BLADES[:ROTATION[:ROUNDNESS]] such as "
            "7:15:0.3, nor a picture such as heart.png"
        ) from None
    if count == 0:
        raise UsageError("an aperture of 0 blades: write round")
    return Aperture(blades=count, rotation_deg=rotation, roundness=roundness, cat_eye=cat_eye)


def as_aperture(given: Aperture | str, cat_eye: float) -> Aperture | None:
    """An aperture, parsed as `parse_aperture` does where it is a string.

    Raises:
        UsageError: a string that cannot be parsed, or a cat's eye given twice.
    """
    if isinstance(given, str):
        return parse_aperture(given, cat_eye=cat_eye)
    if cat_eye:
        raise UsageError("the cat's eye stands in the Aperture; leave cat_eye out")
    return given


ASSUMED_ANGLE_DEG = 180.0
LONGEST_ASSUMED_S = 1 / 48
"""Half of a film's frame. A camera of few frames a second seldom exposes for longer [s]."""


class Shutter(Struct, frozen=True, kw_only=True):
    """A shutter that opens once a frame, centred on the frame's moment.

    Attributes:
        angle_deg: share of the frame's time that it is open, 360 for all of it [deg].
        frame_s: from one frame to the next, 0 where there is only one [s].
        source: description of where the angle comes from.
        given: whether the user gave it.
    """

    angle_deg: float = ASSUMED_ANGLE_DEG
    frame_s: float = 0.0
    source: str = "assumed"
    given: bool = False

    @property
    def open_s(self) -> float:
        """How long it is open [s]."""
        return self.angle_deg / 360.0 * self.frame_s

    def shortened(self, open_s: float) -> Shutter:
        """The same, but open for at most a time [s]."""
        return replace(self, angle_deg=360.0 * min(self.open_s, open_s) / self.frame_s)

    def edges(self, time_s: float) -> tuple[float, float, float]:
        """When it opens, is half through, and closes round a frame's moment [s]."""
        return time_s - 0.5 * self.open_s, time_s, time_s + 0.5 * self.open_s

    def middles(self, time_s: float, count: int) -> tuple[float, ...]:
        """Middles of `count` equal parts of the time that it is open round a frame's moment [s]."""
        return tuple(time_s + self.open_s * ((i + 0.5) / count - 0.5) for i in range(count))


def assumed_shutter(frame_s: float) -> Shutter:
    """A shutter of 180 degrees, or of 1/48 s where that is shorter; `frame_s` as of `Shutter`."""
    longest = 360.0 * LONGEST_ASSUMED_S / frame_s if frame_s > 0.0 else ASSUMED_ANGLE_DEG
    return Shutter(angle_deg=min(ASSUMED_ANGLE_DEG, longest), frame_s=frame_s)


class Aberration(Struct, frozen=True, kw_only=True):
    """Lateral chromatic aberration: radial displacement of red and blue relative to green.

    Attributes:
        red: (linear, cubic) parts of `linear * r + cubic * r**3`, positive outwards [px].
        blue: the same of blue [px].
    """

    red: tuple[float, float]
    blue: tuple[float, float]

    @property
    def at_corner_px(self) -> float:
        """The larger displacement of both at the corner [px]."""
        return max(abs(sum(self.red)), abs(sum(self.blue)))


class Vignetting(Struct, frozen=True, kw_only=True):
    """Loss of light, `square * r**2 + fourth * r**4`.

    Attributes:
        square: [stops].
        fourth: [stops].
    """

    square: float
    fourth: float

    @classmethod
    def of(cls, stops: float) -> Vignetting:
        """The usual shape, half of it in each power, from the loss at the corner [stops]."""
        return cls(square=0.5 * stops, fourth=0.5 * stops)

    @property
    def at_corner_stops(self) -> float:
        """The loss there [stops]."""
        return self.square + self.fourth


class Distortion(Struct, frozen=True, kw_only=True):
    """Brown's radial distortion, `distorted = r * (1 + k1 * r**2 + k2 * r**4)`.

    Attributes:
        k1: negative for a barrel [1].
        k2: [1].
        focal_normalized: whether `r` is in focal lengths from the principal point, as in OpenCV;
            otherwise in half diagonals from the middle of the frame.
    """

    k1: float
    k2: float = 0.0
    focal_normalized: bool = False


class Bloom(Struct, frozen=True, kw_only=True):
    """Halo around highlights, decaying exponentially.

    Attributes:
        share: of a highlight's light, as far as the plate tells it, that goes into the halo [1].
        length_px: distance over which the halo falls to 1 / e [px].
        clip: light at which highlights of the plate clip [1].
    """

    share: float
    length_px: float
    clip: float = 1.0


class LensOverrides(Struct, frozen=True, kw_only=True):
    """The user's values for the plate's lens; None where a value is estimated from the plate.

    Attributes:
        vignetting_stops: loss of light at the corner [stops].
        distortion: k1 and k2, as in OpenCV [1].
    """

    vignetting_stops: float | None = None
    distortion: tuple[float, float] | None = None


NO_OVERRIDES = LensOverrides()

"""The shadow against a path tracer's: how much nearer to the truth it brings the ground."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box
from nlens_video.effects.shadow.apply import ApplyShadow, Shadow
from nlens_video.effects.shadow.cast import CastShadow
from nlens_video.effects.shadow.casters import Casters
from nlens_video.effects.shadow.projection import Moment
from nlens_video.evaluate.bench.case import Case, case_of, codes_of
from nlens_video.evaluate.bench.glb_writer import UInt8
from nlens_video.evaluate.metrics import psnr
from nlens_video.evaluate.plates import Plate
from nlens_video.evaluate.tables import Column, Entry, Table
from nlens_video.scene.environment import load_environment
from nlens_video.scene.illumination import Illumination, SceneLight
from nlens_video.scene.scene import Scene
from nlens_video.stages.l_reblur import ReblurLayer
from nlens_video.video.exr import read_exr
from nlens_video.video.pixels.picture import ArrayPicture

TRUTH, DEPTH, MAP = "gt.png", "bg_depth.exr", "env.hdr"
NONE, GIVEN, BEST, GUESSED = (
    "no shadow", "by the given light", "the same, told its strength", "by a light guessed",
)  # fmt: skip
_ON_GROUND = 0.02  # share of its distance by which a point of the ground may miss the plane
_SHADED = 0.9  # what is darker in the truth lies in the shadow [1]
_MEAN_PX = 5  # grain of the truth is averaged over so many pixels each way
_CLEAR_PX = 3  # from the outermost pixel that the object's blur reaches
_STRENGTHS = np.arange(0.5, 1.55, 0.1)


def shadow_table() -> Table:
    """An empty table of shadows."""
    return Table(
        name="shadow",
        title="The shadow on the ground, against a path tracer's",
        columns=(
            Column("gain_db", "gain over none [dB]"),
            Column("psnr_db", "PSNR [dB]"),
            Column("left", "light left, of the truth's", 2, "median"),
            Column("strength", "strength", 2, "median"),
            Column("gain_db", "plates", 0, "count"),
        ),
        detail="gain_db",
        notes=(
            "Over the pixels that show the ground (by the plate's true depth), which the blurred "
            f"object does not reach, and which the truth shows darker than {_SHADED:g} of what "
            f"they are without a shadow. {GIVEN}: the lights of the GLB, and {MAP} where it is "
            f"there; without it, how much light comes from around is a guess. {BEST}: with the "
            f"--shadow-strength that suits the truth best. {GUESSED}: the GLB's lights taken away, "
            "the light from around estimated from the plate. The lens is the true one.",
        ),
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shaded:
    """A plate whose object casts a shadow in the truth.

    Attributes:
        case: plate, object, and the truth without a shadow.
        known: what is known of the plate.
        truth: with the shadow (H, W, 3).
        region: pixels that are compared (H, W).
    """

    case: Case
    known: Plate
    truth: UInt8
    region: Bool

    @classmethod
    def load(cls, folder: Path, known: Plate) -> Shaded | None:
        """Read the truth of a plate; None where there is none with a shadow, or nowhere to see it.

        Raises:
            InputError: a file that is there cannot be read or does not fit the others.
        """
        if not ((folder / TRUTH).is_file() and (folder / DEPTH).is_file()):
            return None
        case = case_of(folder, known)
        truth = np.ascontiguousarray(codes_of(folder / TRUTH, case.truth.shape[:2])[..., :3])
        real = read_exr(folder / DEPTH).channels["Z"]
        ground = np.abs(real * known.camera.plane_disparity(known.ground_y) - 1.0) < _ON_GROUND
        region = ground & ~_reached(known) & _darker(truth, case.truth)
        return cls(case=case, known=known, truth=truth, region=region) if region.any() else None

    def measure(self, folder: Path) -> list[Entry]:
        """All rows of the plate."""
        without = self.case.truth
        scene = Scene.load(self.case.glb)
        environment = load_environment(folder / MAP, 0.0, 0.0) if (folder / MAP).is_file() else None
        given = SceneLight(scene.light_count, environment)
        frame = Box(0, 0, without.shape[1], without.shape[0])
        plate_light = Illumination.of_plate(ArrayPicture(self.case.plate, "rgb").linear(frame))
        by_light = self._cast(scene, given.on_ground(scene.pose(0.0).lights))
        by_guess = self._cast(scene, SceneLight(0).on_ground((), plate_light))
        best = max(_STRENGTHS, key=lambda strength: self._psnr(by_light(float(strength))))
        rows = ((GIVEN, by_light, 1.0), (BEST, by_light, float(best)), (GUESSED, by_guess, 1.0))
        base = self._psnr(without)
        found = [Entry(NONE, self.known.name, {"gain_db": 0.0, "psnr_db": base})]
        for name, cast, strength in rows:
            picture = cast(strength)
            figures = {
                "gain_db": self._psnr(picture) - base,
                "psnr_db": self._psnr(picture),
                "left": self._light(picture) / self._light(self.truth),
                "strength": strength,
            }
            found.append(Entry(name, self.known.name, figures))
        return found

    def _cast(self, scene: Scene, light: Illumination) -> Callable[[float], UInt8]:
        """What gives the picture (H, W, 3) with a shadow of some strength."""
        from nlens_video.kernels.scatter.scatter import blur_reach, scatter

        known, without = self.known, self.case.truth
        frame = Box(0, 0, without.shape[1], without.shape[0])
        moment = Moment(Casters.of(scene.pose(0.0), {}), known.camera)
        darken = ApplyShadow(ReblurLayer(scatter=scatter, reach=blur_reach))

        def picture(strength: float) -> UInt8:
            shadow: Shadow | None = CastShadow(strength=strength)(
                [moment], light, known.ground_y, self.case.fit
            )
            codes = without.copy()
            if shadow is not None:
                darken(ArrayPicture(codes, "rgb"), shadow, frame)
            return codes

        return picture

    def _psnr(self, picture: UInt8) -> float:
        return psnr(picture[self.region], self.truth[self.region])

    def _light(self, picture: UInt8) -> float:
        """Mean light of the region [1]."""
        frame = Box(0, 0, picture.shape[1], picture.shape[0])
        return float(ArrayPicture(picture, "rgb").linear(frame)[self.region].mean())


def _reached(known: Plate) -> Bool:
    """Pixels (H, W) to which the lens may spread the object."""
    reach = math.ceil(0.5 * float(np.abs(known.object_coc_px).max())) + _CLEAR_PX
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    there = (known.object_coc_px != 0.0) | known.solid
    return np.asarray(cv2.dilate(there.astype(np.uint8), disc) > 0)


def _darker(truth: UInt8, without: UInt8) -> Bool:
    """Pixels (H, W) that the shadow makes darker."""
    size = (_MEAN_PX, _MEAN_PX)
    one, other = (cv2.blur(p.astype(np.float32), size).sum(axis=2) for p in (truth, without))
    return np.asarray(one < _SHADED * other)

"""Test cases of `bench`: plate, object, true lens, and ground truth by the sampled lens."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Box, UInt8
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.bench.scenes import BuiltScene, plate
from nlens_video.evaluate.metrics import WINDOW, psnr, ssim
from nlens_video.evaluate.plates import Plate, read_codes
from nlens_video.render.select import choose_renderer
from nlens_video.scene import Scene
from nlens_video.stages.l_aperture_samples import bare_points
from nlens_video.stages.l_lens_sampling import LensSetup, lens_views
from nlens_video.stages.p_projection import VISIBILITY_FLOOR_PX, ground_visibility
from nlens_video.video.pixels.picture import ArrayPicture

_LINEAR_PX = 0.25  # how far a plate's CoC may be from slope * disparity + intercept


class Case(Struct, frozen=True, kw_only=True):
    """One thing to reblur and the truth of it; pictures are display-coded RGB (H, W, 3).

    Attributes:
        name: of its column.
        glb: the object.
        layers: the object as layers rendered before, None for what the GLB gives.
        fit: the true lens, in the pixels of the frame.
        plate: without the object.
        truth: with the object, as the lens sees it.
        region: the tightest box around the sharp object, on which pictures are compared.
    """

    name: str
    glb: Path
    layers: Path | None = None
    fit: LensFit
    plate: UInt8
    truth: UInt8
    region: Box

    @property
    def frame(self) -> Box:
        """The whole picture."""
        return Box(0, 0, self.plate.shape[1], self.plate.shape[0])

    def score(self, picture: UInt8) -> dict[str, float]:
        """PSNR [dB] and SSIM [1] of a picture (H, W, 3) against the truth, in the region."""
        part = self.region.slices_in(self.frame)
        seen, truth = picture[part], self.truth[part]
        return {"psnr_db": psnr(seen, truth), "ssim": ssim(seen, truth)}


def built_case(scene: BuiltScene, size: tuple[int, int], views: int) -> Case:
    """Make the truth of a scene of `write_scenes`: the mean of views from points of the lens."""
    loaded = Scene.load(scene.glb)
    frame = Box(0, 0, *size)
    camera = loaded.camera(0.0, *size)
    clean = plate(size)
    with choose_renderer(loaded) as renderer:
        sharp = renderer.render(0.0, camera)
        if sharp is None:
            raise RuntimeError(f"the scene {scene.name!r} lies out of view")
        covered = np.zeros((frame.height, frame.width), np.bool_)
        covered[sharp.box.slices_in(frame)] = sharp.rgba[..., 3] > 0
        shot = LensSetup(time_s=0.0, camera=camera, fit=scene.fit, frame=frame)
        seen = lens_views(renderer, shot, bare_points(views))
    truth = clean.copy()
    ArrayPicture(truth, "rgb").composite_over(seen.box, seen.rgba)
    return Case(
        name=scene.name, glb=scene.glb, fit=scene.fit, plate=clean, truth=truth,
        region=Box.of(covered),
    )  # fmt: skip


def plate_case(known: Plate) -> Case:
    """The case of a plate that was rendered with and without its object by a true lens.

    Args:
        known: one with `gt_noshadow.png` and `object.exr` in its folder.

    Raises:
        InputError: a file is missing, cannot be read or does not fit the others.
    """
    layers = known.folder / "object.exr"
    if not layers.is_file():
        raise InputError(f"{layers}: no such file; the object's layers are needed on each plate")
    truth = read_codes(known.folder / "gt_noshadow.png", known.alpha.shape)
    region = Box.of(known.alpha > 0)
    if min(region.width, region.height) < WINDOW:
        raise InputError(
            f"{known.folder}: its object spans {region.width}x{region.height} pixels, SSIM needs "
            f"{WINDOW} each way; leave this plate out"
        )
    return Case(
        name=known.name,
        glb=known.folder / "object.glb",
        layers=layers,
        fit=_true_fit(known),
        plate=np.asarray(np.round(255.0 * known.rgb), np.uint8),
        truth=np.ascontiguousarray(truth[..., :3]),
        region=region,
    )


def _true_fit(known: Plate) -> LensFit:
    """The lens that gives the object's pixels their true CoC, which is affine in disparity."""
    solid = known.solid
    disparity = 1.0 / known.object_depth[solid].astype(np.float64)
    coc = known.object_coc_px[solid].astype(np.float64)
    columns = np.stack([disparity, np.ones_like(disparity)], axis=1)
    slope, intercept = np.linalg.lstsq(columns, coc, rcond=None)[0]
    height, width = known.alpha.shape
    rmse = float(np.sqrt(np.mean((columns @ [slope, intercept] - coc) ** 2)))
    if not rmse < _LINEAR_PX or slope < 0:
        raise InputError(
            f"{known.name}: its object_coc.npy is not slope / depth + intercept with a slope of 0 "
            f"or more (off by {rmse:.2f} px); expected the signed CoC of a thin lens"
        )
    fit = LensFit(
        slope=float(slope), intercept=float(intercept), rmse_px=rmse, n=len(coc),
        width=width, height=height, method="true CoC of the object",
    )  # fmt: skip
    return replace(fit, ground_seen=_true_ground(known, fit))


def _true_ground(known: Plate, fit: LensFit) -> tuple[tuple[float, float], ...]:
    """How much of the plate shows the ground plane, by the plate's true CoC."""
    plane = known.camera.plane_disparity(known.ground_y)
    seen = (plane > 0.0) & np.isfinite(known.true_coc_px)
    disparity, coc = plane[seen], known.true_coc_px[seen].astype(np.float64)
    expected = np.abs(fit.coc_px(disparity.astype(np.float32))).astype(np.float64)
    return ground_visibility(disparity, coc, np.full_like(coc, VISIBILITY_FLOOR_PX), expected)

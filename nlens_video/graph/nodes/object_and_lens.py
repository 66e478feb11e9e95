"""Nodes of object and lens: bounds, F (CoC), P (projection), R (regression), render."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from nlens_video.core.errors import LensFitError, Note, NoteKind
from nlens_video.core.known_lens import UNKNOWN_LENS, KnownLens
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.planner import DEFOCUS, SELF_SHADOW
from nlens_video.graph.base.node import IN_FRAME, Node, Unavailable
from nlens_video.graph.base.values import FoundLens, FramesFitted
from nlens_video.graph.nodes.known_lens_fit import fit_with_known
from nlens_video.stages.p_projection import GroundProjection, project_to_ground
from nlens_video.stages.r_regression import FitLens

if TYPE_CHECKING:
    from nlens_video.core.layers import CocMap, ObjectLayer, Picture
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.view import ScreenBounds
    from nlens_video.scene.illumination import Illumination
    from nlens_video.video.info import SourceFrame

_LEVEL_SIZE = 40, 24  # columns and rows that the level of a picture is read at [px]
_ONE_COLOUR = 1e-3  # difference in light, of black 3 of 255 in sRGB, that shows nothing [1]
_UNTOLD = "all pictures are of one colour, and tell no lens; give --fit FILE or --fallback constant"
_SURE_SHARE = 0.5  # of the whole error: below it most is what the readings leave open


class ObjectBounds(Node):
    """Screen bounds, depth range and camera of the object on this frame."""

    name, writes = "object-bounds", "bounds"

    def __init__(self, context: NodeContext) -> None:
        self._objects = context.objects
        self.description = "camera and depth bounds of the GLB"

    def __call__(self, frame: SourceFrame, plate_light: Illumination | None) -> ScreenBounds | None:
        bounds = self._objects.locate(frame.number, frame.time_s)
        if bounds is None or plate_light is None:
            return bounds
        return replace(bounds, plate_light=plate_light)


class EstimateCoc(Node):
    """F: CoC map of the plate from its pixels alone (paper, section 4.1).

    None where the picture is of one colour, which shows no blur, or is not looked at.
    """

    name, writes = "estimate-coc", "plate_coc"
    effect, once, when = DEFOCUS, True, IN_FRAME

    def __init__(self, context: NodeContext) -> None:
        self._estimate, self._search = context.estimate_coc, context.lens_search
        known = context.known_lens.completed_by(context.tagged_lens)
        self._needs_plate = not known.is_whole and not context.fallback_constant
        self._untold = False
        self.description = "F: CoC network, onnxruntime"

    def __call__(
        self, picture: Picture, bounds: ScreenBounds, following: tuple[Picture, ...] | None
    ) -> CocMap | None:
        seen = picture.downsample(*_LEVEL_SIZE)
        self._untold = self._needs_plate and float(np.ptp(seen, axis=(0, 1)).max()) < _ONE_COLOUR
        if self._untold or self._search.passes_over(bounds.time_s):
            return None
        return self._estimate(picture, following or ())

    @property
    def notes(self) -> tuple[str, ...]:
        """That only pictures of one colour have come so far."""
        return (_UNTOLD,) if self._untold else ()


class GroundFootprint(Node):
    """P: the object projected down on the ground plane (paper, section 4.2)."""

    name, writes = "ground-footprint", "ground"
    effect, once, when = DEFOCUS, True, IN_FRAME

    def __init__(self, context: NodeContext) -> None:
        self._context = context
        self.description = "P: footprint on the ground plane"

    def __call__(self, bounds: ScreenBounds) -> GroundProjection:
        triangles = self._context.objects.footprint(bounds.time_s)
        return project_to_ground(triangles, bounds.camera, self._context.ground_height)


class FitNode(Node):
    """R: the linear lens model, regressed over the ground plane (paper, eq. 2).

    None where the frame tells no lens, and a later one may.
    """

    name, writes = "fit", "found_lens"
    effect, once, when = DEFOCUS, True, IN_FRAME
    ranges = (("anchor_weight", 0.0, 1.0),)

    def __init__(
        self, context: NodeContext, *, whole_plane: bool = True, anchor_weight: float = 0.1
    ) -> None:
        self._fit = FitLens(
            whole_plane=whole_plane, anchor_weight=anchor_weight, region=context.fit_region,
            network=context.read_lens,
        )  # fmt: skip
        self._known, self._unit_m = context.known_lens, context.unit_m
        self._with_tags = context.known_lens.completed_by(context.tagged_lens)
        self._others, self.search = context.other_samples, context.lens_search
        self._fallback_constant = context.fallback_constant
        ground = "the ground plane" if whole_plane else "the footprint"
        where = "the given region" if context.fit_region else ground
        self.description = f"R: robust V-fit over {where}"

    @property
    def notes(self) -> tuple[str, ...]:
        """That what `--lens` gives does not tell the blur, and when the lens was found late."""
        given = replace(self._known, prefer=None) != UNKNOWN_LENS
        unused = _unused(self._with_tags, scaled=self._unit_m is not None) if given else ()
        return (*unused, self.search.note) if self.search.note else unused

    def __call__(
        self,
        plate_coc: CocMap,
        ground: GroundProjection,
        frame: SourceFrame,
        bounds: ScreenBounds,
        lens_before: LensFit | None,
        frames_fitted: FramesFitted,
    ) -> FoundLens | None:
        camera = bounds.camera
        given = [self._known, self._with_tags]
        if lens_before is not None:  # a focus that is given is that of the first frame
            given = [replace(lens, focus_m=None) for lens in given]
        known, with_tags = (
            lens.across(camera.width / camera.fx, camera.height / camera.fy).prior(
                camera.fx, camera.width, self._unit_m
            )
            for lens in given
        )
        size = camera.width, camera.height
        try:
            found = fit_with_known(
                lambda lens: self._fit(
                    plate_coc, ground, frame.index, lens, self._others,
                    with_whole_ground=frames_fitted == "one",
                ),
                known, with_tags, size, frame.index,
            )  # fmt: skip
        except LensFitError as error:
            if not self._fallback_constant:
                self.search.failed(error, bounds.time_s)
                return None
            fit = constant_fit(plate_coc, ground, frame.index)
            reason = str(error).partition("; give ")[0]  # the advice is to use this fallback
            return FoundLens(
                fit=fit, regression=None, warning=f"constant CoC instead of a fit: {reason}"
            )
        self.search.found(bounds.time_s)
        middle = 0.5 / bounds.nearest + 0.5 / bounds.farthest if bounds.nearest > 0.0 else 0.0
        fit = replace(found.fit, object_disparity=middle)
        if found.regression is None:
            return replace(found, fit=fit)
        regression = replace(found.regression, fit=fit)
        warning = found.warning or _warning(fit, ground)
        return FoundLens(fit=fit, regression=regression, warning=warning)


def _unused(known: KnownLens, *, scaled: bool) -> tuple[str, ...]:
    """A note where the parts of a lens, with the metadata's, do not tell the blur."""
    if known.is_whole:
        return ()
    if not scaled:
        return (
            "--lens changes nothing: where the scale of the scene is not known, it takes the "
            "f-number, the focal length or sensor, and the focused distance together",
        )
    if known.tells_aperture or known.focus_m is not None:
        return ()
    return (
        "--lens changes nothing: it takes the focused distance, or the f-number together with the "
        "focal length or the sensor",
    )


def constant_fit(coc: CocMap, ground: GroundProjection, frame: int = 0) -> LensFit:
    """The fallback: one CoC for every depth, behind the focus: the plate's confident median.

    It is that of the footprint of `ground`, or of the whole plate where the footprint is empty;
    `frame` is the index of the frame, kept in the fit.
    """
    known = np.isfinite(coc.coc_px) & np.isfinite(coc.sigma_px)
    use = known & ground.mask if (known & ground.mask).any() else known
    if not use.any():
        raise LensFitError("the CoC estimate holds no number at all; give --fit FILE.json")
    values, sigma = coc.coc_px[use], coc.sigma_px[use]
    confident = values[sigma <= np.quantile(sigma, 0.5)]
    height, width = coc.coc_px.shape
    return LensFit(
        slope=0.0,
        intercept=-float(np.median(confident)),
        rmse_px=float(np.median(sigma)),
        n=int(confident.size),
        inlier_fraction=0.5,
        width=width,
        height=height,
        frame=frame,
        sign="assumed",
        method="constant CoC: no usable fit, the plate's confident median",
    )


def _warning(fit: LensFit, ground: GroundProjection) -> str:
    """A warning about a fit that may be wrong, empty for a sound one."""
    if not fit.depends_on_depth:
        there = fit.object_disparity
        nothing_told = fit.coc_stderr_px(there) > max(1.0, abs(fit.slope * there + fit.intercept))
        if nothing_told or fit.readings_share < _SURE_SHARE:
            return (
                "the ground reads about alike at all depths; noise, fine grain or a mirror may "
                "hide its blur: look whether the object's fits, else give --lens"
                + (" or --prefer" if fit.sign == "ambiguous" and fit.other is not None else "")
            )
        return ""  # the words of the lens say that it blurs alike at all depths
    if fit.sign == "ambiguous":
        unclear = "the plate does not show whether the ground lies before or behind the focal plane"
        return unclear if fit.other is None else f"{unclear}; --prefer near or far chooses"
    if not ground.mask.any():
        return Note(
            "no footprint in view: fitted on the ground plane as a whole",
            NoteKind.FOOTPRINT_UNSEEN,
        )
    return ""


class SelfShadow(Node):
    """Depth of the object as its lights see it, by which its parts shade each other."""

    name, writes = "self-shadow", "bounds"
    effect = SELF_SHADOW
    description = "shadow maps of the strongest lights, edges as soft as these are wide"

    def __init__(self, context: NodeContext) -> None:
        if context.renderer is None:
            raise Unavailable("pre-rendered layers are lit already")
        self._renderer = context.renderer
        self._renderer.shade_itself()

    def __call__(self, bounds: ScreenBounds) -> ScreenBounds:
        self._renderer.see_from_lights(bounds.time_s, bounds.camera, bounds.plate_light)
        return bounds


class Render(Node):
    """Colour, coverage and depth of the object, beyond the frame as far as its blur reaches."""

    name, writes = "render", "layer"

    def __init__(self, context: NodeContext) -> None:
        self._objects = context.objects
        self.description = context.objects.description

    def __call__(self, bounds: ScreenBounds, fit: LensFit | None) -> ObjectLayer | None:
        return self._objects.render(bounds, fit)

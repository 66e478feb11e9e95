"""The compositor for OpenCV, PyAV and numpy loops: frames in, composited frames out."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, NoReturn, Self, TypeVar

import numpy.typing as npt
from msgspec.structs import replace

from nlens_video.compositor.arguments import (
    PARAMETERS,
    as_args,
    as_fit,
    as_lens,
    as_moment,
    as_objects,
    as_path,
    as_positive,
    in_python,
    naming_parameters,
)
from nlens_video.compositor.frame_loop import FrameLoop, OwnThread
from nlens_video.compositor.frames import Frames, Shown, from_samples, reformatted, show, to_samples
from nlens_video.core.errors import UsageError
from nlens_video.core.known_lens import Prefer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import NO_OVERRIDES, Aperture, LensOverrides
from nlens_video.core.settings import Device, Fallback, ObjectSettings, Occlusion
from nlens_video.graph.base.profiler import Profiler, Summary

if TYPE_CHECKING:
    import av

    from nlens_video.core.layers import Picture

R = TypeVar("R")
_CHECKED = ("fit", "aperture")  # take more than an option's text


class Compositor:
    """Puts an animated object into frames, one at a time.

    The lens is fitted on the first frame with the object in view and kept. All work happens on one
    worker thread, which owns the OpenGL context, so any thread may call it; frames are processed in
    the order of the calls. A forked process cannot use it, and makes its own.

    Options have the names that the command line gives them, with `_` for `-`, and the same meaning
    and limits (`nlens-video render --help`); None takes the default.

    Args:
        glb: the animated object; or `nlens_video.core.settings.ObjectSettings`, which hold what
            `camera` to `ground_reflectance` say.
        preset: shipped pipeline's name or path of a pipeline file.
        fps: frames per second, for frames that come without a time [1/s].
        pixel_aspect: width of a pixel by its height, for frames that do not tell it [1].
        effects: `auto`, `all`, `none`, names, or `auto,+shadow,-grain`.
        fit: the lens, when it is known: a fit or a saved one's path; its track goes by `number`.
        fallback: `constant` lets a constant CoC stand in for a fit that fails.
        budget_ms: what a frame may cost [ms].
        track_focus: `auto` follows a lens that changes, `off` keeps the first fit.
        device: where networks and kernels run.
        aperture: its shape, as `--aperture` takes it, or a `nlens_video.core.optics.Aperture`.
        cat_eye: how much a cat's eye narrows it towards the corners, 0 to 1 [radius].
        lens: what is known of it, such as `50mm f/2.8 focus 2.4m sensor full-frame`.
        prefer: `near` or `far`: of two lenses that explain the plate, the one focused so.
        fit_region: part of the frame whose ground tells the lens, as `--fit-region` [frame].
        shutter_angle: how long the shutter is open, 0 to 360 for all of a frame [deg].
        vignetting: light lost at the corners, 0 to 8 [stops].
        distortion: k1, or k1 and k2, as OpenCV defines them [1].
        camera: name of the GLB's camera, None for its first.
        camera_from: file of the frames' camera, as `nlens-video solve` writes it.
        at_frame: frame that `at` is of, where that camera moves.
        scene: name or number of the GLB's scene.
        ground_y: height of the ground plane, None for the object's lowest point [scene unit].
        footprint_node: name of the object under which the lens is fitted.
        animation: name or number of the animation that plays, or `all`.
        loop: whether it starts again after its end.
        animation_speed: seconds of the animation per second of the frames, > 0 [1].
        animation_offset: moment of the animation on the first frame [s].
        at: where a GLB without a camera stands, from the upper left [frame].
        size: height of the object there, > 0; None for a usual one [frame height].
        height: its height in place of `size`, where `camera_from` is in metres [m].
        yaw: turn about the vertical, 0 faces the viewer [deg].
        fov: field of view across the frame, 1 to 170 [deg].
        horizon: row of the horizon, above `at`; None for a level camera's [frame height].
        roll: how far the frame's camera leans to its left: the horizon falls to the right [deg].
        env_map: equirectangular map of the light from around, .hdr or .exr; None for the frame's.
        env_rotation: turn of the map about the vertical [deg].
        env_exposure: brightness of the map in stops, None for the frame's level [EV].
        sun: to the right of the view, above the horizon [deg], and strength; "none" for no sun.
        shadow_strength: 0 none, 1 as the light has it, up to 2 [1].
        holdout: matte or depth of what stands in front of the object.
        occlusion: `auto` finds what stands in front by the frame's blur.
        ground_reflectance: share of the light that the ground mirrors seen from above, 0 to 1 [1].
        optics: `vignetting` and `distortion` as one object.

    Raises:
        UsageError: an argument is out of range, or contradicts another.
        LensFitError: the saved fit cannot be read.
        SceneError: the GLB cannot be used; raised at the first frame.
    """

    def __init__(  # noqa: PLR0913  the command line's options, by name
        self,
        glb: str | Path | ObjectSettings,
        *,
        preset: str = "standard",
        fps: float = 30.0,
        pixel_aspect: float = 1.0,
        effects: str = "auto",
        fit: LensFit | str | Path | None = None,
        fallback: Fallback = "none",
        budget_ms: float = 180.0,
        track_focus: Literal["auto", "off"] = "auto",
        device: Device = "auto",
        aperture: Aperture | str = "auto",
        cat_eye: float = 0.0,
        lens: str | None = None,
        prefer: Prefer | None = None,
        fit_region: tuple[float, ...] | None = None,
        shutter_angle: float | None = None,
        vignetting: float | None = None,
        distortion: float | tuple[float, float] | None = None,
        camera: str | None = None,
        camera_from: str | Path | None = None,
        at_frame: int | None = None,
        scene: str | int | None = None,
        ground_y: float | None = None,
        footprint_node: str | None = None,
        animation: str | int | None = None,
        loop: bool = False,
        animation_speed: float | None = None,
        animation_offset: float | None = None,
        at: tuple[float, float] | None = None,
        size: float | None = None,
        height: float | None = None,
        yaw: float | None = None,
        fov: float | None = None,
        horizon: float | None = None,
        roll: float | None = None,
        env_map: str | Path | None = None,
        env_rotation: float | None = None,
        env_exposure: float | None = None,
        sun: tuple[float, ...] | Literal["none"] | None = None,
        shadow_strength: float | None = None,
        holdout: str | Path | None = None,
        occlusion: Occlusion | None = None,
        ground_reflectance: float | None = None,
        optics: LensOverrides = NO_OVERRIDES,
    ) -> None:
        given = locals()  # by the names of the command line's options
        with naming_parameters():
            fps, pixel_aspect = as_positive("fps", fps), as_positive("pixel_aspect", pixel_aspect)
            args = as_args({name: given[name] for name in PARAMETERS if name not in _CHECKED})
            request = as_lens(args, fps=fps, fit=fit, aperture=aperture, optics=optics)
            objects, profiler = as_objects(glb, args), Profiler(args.budget_ms)
            self._loop = FrameLoop(objects, request, fps, pixel_aspect, profiler)
        self._thread = OwnThread(self._loop.close)

    def process(
        self, frame: Frames, time: float | None = None, out: npt.NDArray[Any] | None = None,
        number: int | None = None,
    ) -> Frames:  # fmt: skip
        """Composite one frame.

        Args:
            frame: (H, W, 3) BGR or (H, W, 4) BGRA as OpenCV gives it, or (H, W) grey; uint8,
                uint16, float32 or float16 in [0, 1]; or a torch tensor of that shape and type, or
                of bfloat16; left as it is.
            time: of the frame in the animation [s]; default: its number / fps.
            out: array that takes the result, of the shape and type of `frame`, uint8, uint16 or
                float32; may be `frame` itself, which is changed then. Saves an allocation.
            number: position in the plate, as of `composite` [1].

        Returns:
            `out`, or a new array (or tensor on the same device) of the frame's shape and type.

        Raises:
            InputError: a shape or type that no picture has, or floats of another range.
            UsageError: no array or tensor, another size than before, no time, or an unfit `out`.
            SceneError: the GLB cannot be used.
            LensFitError: no usable lens fit.
        """
        from nlens_video.video.pixels.picture import ArrayPicture

        result = to_samples(frame, out)
        self.composite(ArrayPicture(result), time, number)
        return from_samples(result, frame)

    def process_av(self, frame: av.VideoFrame) -> av.VideoFrame:
        """Composite one of PyAV's frames into a new one of its format, pts and colour tags.

        Its time in the animation is its own time since the first frame, where it has one.

        Args:
            frame: left as it is.

        Raises:
            InputError: a format that cannot be composited in.
            SceneError: the GLB cannot be used.
            LensFitError: no usable lens fit.
        """
        from nlens_video.video.pixels.conversion import copied, unpacked
        from nlens_video.video.pixels.orientation import UPRIGHT
        from nlens_video.video.pixels.picture import AvPicture

        if type(frame).__name__ != "VideoFrame":
            raise UsageError(f"process_av takes PyAV's frames, not {type(frame).__name__}")
        picture = AvPicture(copied(unpacked(frame)), orientation=UPRIGHT)  # as it is stored
        self._call(lambda: self._loop.composite(picture, self._loop.since_first(frame)))
        return reformatted(picture.frame, frame)

    def composite(
        self, picture: Picture, time: float | None = None, number: int | None = None,
        pixel_aspect: float | None = None,
    ) -> None:  # fmt: skip
        """Composite a picture (its samples change), whatever memory it lies in; adapters call it.

        Args:
            picture: the frame.
            time: of the frame in the animation [s]; default: its number / fps.
            number: position in its stream, for grain, mattes, tracks [1]; default: frames so far.
            pixel_aspect: width of a pixel by its height [1]; default: the compositor's.

        Raises:
            NlensError: as `process`.
        """
        time_s, index = as_moment(time, number)
        self._call(lambda: self._loop.composite(picture, time_s, index, pixel_aspect))

    def stream(self, frames: Iterable[Frames]) -> Iterator[Frames]:
        """Composite frames as they come, PyAV's too, one at a time."""
        for frame in frames:
            made: Any = self.process_av if type(frame).__name__ == "VideoFrame" else self.process
            yield made(frame)

    @property
    def fit(self) -> LensFit | None:
        """The lens of the last frame, once found or given."""
        return self._loop.fit

    @fit.setter
    def fit(self, fit: LensFit) -> None:
        """Use another lens from the next frame on; focus tracking ends."""
        pinned = as_fit(fit)
        self._call(lambda: self._loop.pin_fit(pinned))

    @property
    def seeks_lens(self) -> bool:
        """Whether the next frame that shows the object decides the lens; adapters ask for it."""
        return self._loop.seeks_lens

    def swap(self, glb: str | Path | ObjectSettings) -> None:
        """Composite another object from the next frame on; the lens is held, time goes on.

        Args:
            glb: as at the beginning; a path keeps camera and ground height as they were given.

        Raises:
            UsageError: neither a path nor settings.
            SceneError: the GLB cannot be used; raised at the next frame.
        """
        if not isinstance(glb, ObjectSettings):
            glb = replace(self._loop.objects, glb=as_path(glb))
        self._call(lambda: self._loop.swap(glb))

    def show(self) -> Shown:
        """The last composite, the lens and what runs, as a notebook draws them."""
        return self._call(lambda: show(self._loop.last, self.fit, self.plan))

    @property
    def plan(self) -> tuple[str, ...]:
        """What runs on each frame and why, a line each; empty before the first frame."""
        return tuple(map(in_python, self._loop.plan))

    @property
    def timings(self) -> Summary:
        """Statistics of the frames so far."""
        return self._loop.profiler.summary()

    def close(self) -> None:
        """Free OpenGL, networks and the thread; may be called again."""
        self._thread.close()

    def __reduce__(self) -> NoReturn:
        raise UsageError("a Compositor cannot be pickled; make one in each process")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    def _call(self, work: Callable[[], R]) -> R:
        with naming_parameters():
            return self._thread.call(work)

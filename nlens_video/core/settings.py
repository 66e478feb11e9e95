"""Settings of one run: what the command line, parsed, hands to the rest of the program."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, TypedDict

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.known_lens import UNKNOWN_LENS, KnownLens, Prefer
from nlens_video.core.objects import NO_KEYS, ONCE, FurtherObject, PlaceKeys, Playback
from nlens_video.core.optics import Aperture, LensOverrides
from nlens_video.core.placement import GroundPlacing, Placement, Region
from nlens_video.core.scale import UNKNOWN_SCALE, ScaleSettings

Device = Literal["auto", "cpu", "cuda"]
Fallback = Literal["none", "constant"]
Late = Literal["keep", "drop"]
TrackFocus = Literal["auto", "off"] | int
Occlusion = Literal["none", "moving", "auto"]
REFLECTANCE = 0.04
"""Of glass, water, polished stone and lacquer (a refractive index of 1.5), from straight above."""


class InputArguments(TypedDict, total=False):
    """Keyword arguments of `video.input.source.open_source`, which say what an input does not."""

    input_format: str | None
    input_size: str | None
    input_rate: str | None
    input_transfer: str | None


class SourceSettings(Struct, frozen=True, kw_only=True):
    """The plate.

    Attributes:
        spec: file, image sequence pattern, device, URL, or `-` for standard input.
        input_format: FFmpeg's name of the format, None to detect it.
        input_size: (width, height) of raw video [px].
        input_rate: frames per second of raw video, stills and sequences [1/s].
        input_transfer: name in `color.TRANSFERS` that replaces the plate's tag.
        frames: first index and the one past the last, None for an open end.
        reconnect_s: how long to try to open a lost device or URL again, 0 not at all [s].
        ignored_lines: ends of line segments that tell nothing of the camera, x0, y0, x1, y1 of one
            after the other [frame width, frame height].
    """

    spec: str
    input_format: str | None = None
    input_size: tuple[int, int] | None = None
    input_rate: str | None = None
    input_transfer: str | None = None
    frames: tuple[int, int | None] = (0, None)
    reconnect_s: float = 0.0
    ignored_lines: tuple[float, ...] = ()

    @property
    def one_frame(self) -> bool:
        """Whether `frames` is one frame."""
        first, end = self.frames
        return end == first + 1

    @property
    def hints(self) -> InputArguments:
        """Keyword arguments of `video.input.source.open_source`."""
        size = f"{self.input_size[0]}x{self.input_size[1]}" if self.input_size else None
        return {
            "input_format": self.input_format,
            "input_size": size,
            "input_rate": self.input_rate,
            "input_transfer": self.input_transfer,
        }


SUN_STRENGTH = 2.0
"""Light of a sun on the ground by all other light, where neither option nor plate tells it [1]."""


class SunSettings(Struct, frozen=True, kw_only=True):
    """A sun.

    Attributes:
        azimuth_deg: 0 where the camera looks on the first frame, 90 to its right [deg].
        elevation_deg: above the horizon, above 0 to 90 [deg].
        strength: its light on the ground by all other light, None as the plate's own shadows
            show it, `SUN_STRENGTH` where they do not [1].
    """

    azimuth_deg: float
    elevation_deg: float
    strength: float | None = None

    @property
    def shines(self) -> bool:
        """Whether it gives light: one of strength 0 stands for no sun at all."""
        return self.strength != 0.0


NO_SUN = SunSettings(azimuth_deg=0.0, elevation_deg=90.0, strength=0.0)


class LightSettings(Struct, frozen=True, kw_only=True):
    """What lights the object beside its file's lights, and how dark its shadow is.

    Attributes:
        env: equirectangular map of the surroundings, None to estimate them from the plate.
        env_rotation_deg: turn of the map about the up axis, counter-clockwise from above [deg].
        env_exposure_ev: brightness of the map in stops, 0 as it is, None as the plate's level [EV].
        sun: a sun, which takes its part of the plate's level; None for the file's, or, where
            nothing tells the light, for one that the plate's shadows tell.
        shadow_strength: 1 as the light has it, 0 none, up to 2; above 0 the shadow is on even of
            pre-rendered layers, None leaves that to `effects` [1].
    """

    env: Path | None = None
    env_rotation_deg: float = 0.0
    env_exposure_ev: float | None = None
    sun: SunSettings | None = None
    shadow_strength: float | None = None


class RealSettings(Struct, frozen=True, kw_only=True):
    """Occlusion of the object by the plate, and its reflection in the plate's ground.

    Attributes:
        holdout: matte or depth of the foreground, None for none.
        occlusion: `moving` finds what moves in front of it in the shot of a camera that stands
            still, turns or travels, where that is certain; `auto` falls back to the plate's CoC;
            `none` does neither.
        reflectance: share of the light that the ground mirrors seen from straight above, 0 to 1;
            None for 0, or `REFLECTANCE` where `effects` names the reflection [1].
        found: what another run of the shot has found in front of it, so that this one need not
            look; a file of `foreground_pass`.
    """

    holdout: str | None = None
    occlusion: Occlusion = "moving"
    reflectance: float | None = None
    found: Path | None = None


class ObjectSettings(Struct, frozen=True, kw_only=True):
    """The object and how the frame sees it.

    Attributes:
        glb: the animated object.
        camera: name of its camera, None for the first perspective one.
        layers: pattern of pre-rendered EXR layers, None to render the GLB.
        ground_y: height of the ground plane in the GLB's world, None to find it [scene unit].
        playback: which of its animations play, and when.
        placing: where it stands in the frame under a given horizon, None without.
        on_ground: where it stands on the ground of a solved camera, None to use the GLB's camera,
            or where it has none, to choose.
        footprint: name of the node under which the lens is fitted, None for the whole object.
        light: what lights it, and its shadow.
        real: occlusion and reflection.
        scene: name or number of the file's scene, None for its default one.
        fov_deg: field of view across the frame's width of a placed object, None to find it [deg].
        camera_from: file of the plate's camera, None for the GLB's own or for `placing`.
        camera_solved: whether the run has solved that camera and written the file itself.
        at_frame: frame of the plate on which `placing` holds, where its camera moves [1].
        keys: how its place, size and turn change over time.
        others: objects beside it.
    """

    glb: Path
    camera: str | None = None
    layers: str | None = None
    ground_y: float | None = None
    playback: Playback = ONCE
    placing: Placement | None = None
    on_ground: GroundPlacing | None = None
    footprint: str | None = None
    light: LightSettings = LightSettings()
    real: RealSettings = RealSettings()
    scene: str | None = None
    fov_deg: float | None = None
    camera_from: Path | None = None
    camera_solved: bool = False
    at_frame: int = 0
    keys: PlaceKeys = NO_KEYS
    others: tuple[FurtherObject, ...] = ()


class OutputSettings(Struct, frozen=True, kw_only=True):
    """The result and its encoding; None keeps what the source has.

    Attributes:
        spec: file, image sequence pattern, or `-` for standard output.
        codec: FFmpeg's name of the encoder.
        crf: quality of encoders that have such a number.
        pix_fmt: FFmpeg's name of the pixel format.
        keep_partial: whether an interrupted or failed run leaves a playable partial file.
    """

    spec: str
    codec: str | None = None
    crf: float | None = None
    pix_fmt: str | None = None
    keep_partial: bool = False


class Settings(Struct, frozen=True, kw_only=True):
    """One run of `nlens-video render`.

    Attributes:
        source: the plate.
        scene: the object.
        scale: what tells the plate's scale where its camera is solved.
        output: the result; None for runs that write no picture (`fit`, `--plan`).
        preset: shipped pipeline's name or path of a pipeline file.
        effects: as `EffectRequest.parse` reads it, such as `auto,+shadow,-grain`.
        budget_ms: frame budget [ms].
        hold_budget: whether quality adapts to keep the budget.
        late: what happens to frames of a live source that come too fast.
        device: where networks and kernels run.
        aperture: shape of the lens' aperture, None for the one that the plate shows.
        shutter_deg: how long the shutter is open, 360 for all of a frame, None if not known [deg].
        optics: known vignetting and distortion.
        lens: what is known of the plate's lens beforehand.
        prefer: which of two lenses to take where the plate leaves it open.
        fit_region: part of the frame whose ground tells the lens, None for all of it.
        chart_m: side of the markers of a chart on which `fit` measures the lens [m].
        fit: a lens fit to use instead of finding one.
        save_fit: where to keep the fit.
        fallback: what replaces a fit that fails.
        track_focus: when the lens is fitted again: when the plate shows a change, never, or every
            so many frames.
        report: folder of the HTML report.
        aov: folder of the EXR layers of each frame.
        timings: file of the timing rows.
    """

    source: SourceSettings
    scene: ObjectSettings
    output: OutputSettings | None
    scale: ScaleSettings = UNKNOWN_SCALE
    preset: str = "standard"
    effects: str = "auto"
    budget_ms: float = 180.0
    hold_budget: bool = False
    late: Late = "keep"
    device: Device = "auto"
    aperture: Aperture | None = None
    shutter_deg: float | None = None
    optics: LensOverrides = LensOverrides()
    lens: KnownLens = UNKNOWN_LENS
    prefer: Prefer | None = None
    fit_region: Region | None = None
    chart_m: float | None = None
    fit: Path | None = None
    save_fit: Path | None = None
    fallback: Fallback = "none"
    track_focus: TrackFocus = "auto"
    report: Path | None = None
    aov: Path | None = None
    timings: Path | None = None

    @property
    def known_lens(self) -> KnownLens:
        """What is known of the plate's lens beforehand, with what is preferred."""
        return replace(self.lens, prefer=self.prefer)

    @property
    def needs_camera(self) -> bool:
        """Whether the plate's camera must be solved before the scene is looked at."""
        placed = self.scene.on_ground is not None and self.scene.camera_from is None
        return placed or self.scale.given

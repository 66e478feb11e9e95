"""What one run was asked for: the only thing that the command line hands on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nlens_video.core.aperture import ROUND, Aperture
from nlens_video.core.lens_models import LensOverrides
from nlens_video.core.placement import Placement
from nlens_video.core.playback import ONCE, Playback

Device = Literal["auto", "cpu", "cuda"]
Fallback = Literal["none", "constant"]
Late = Literal["keep", "drop"]
TrackFocus = Literal["auto", "off"] | int
Occlusion = Literal["none", "auto"]
REFLECTANCE = 0.04
"""Of glass, water, polished stone and lacquer (a refractive index of 1.5), from straight above."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceSettings:
    """The plate.

    Attributes:
        spec: file, image sequence pattern, device, URL, or `-` for standard input.
        input_format: FFmpeg's name of the format, None to detect it.
        input_size: (width, height) of raw video [px].
        input_rate: frames per second of raw video, stills and sequences [1/s].
        input_transfer: name in `color.TRANSFERS` to take instead of what the plate is tagged with.
        frames: first index and the one past the last, None for an open end.
        reconnect_s: how long a device or URL that is lost is waited for, 0 not at all [s].
    """

    spec: str
    input_format: str | None = None
    input_size: tuple[int, int] | None = None
    input_rate: str | None = None
    input_transfer: str | None = None
    frames: tuple[int, int | None] = (0, None)
    reconnect_s: float = 0.0

    @property
    def one_frame(self) -> bool:
        """Whether one frame is asked for."""
        first, end = self.frames
        return end == first + 1

    @property
    def hints(self) -> dict[str, str | None]:
        """What is said about the input beside its name, as `video.source.open_source` takes it."""
        size = f"{self.input_size[0]}x{self.input_size[1]}" if self.input_size else None
        return {
            "input_format": self.input_format,
            "input_size": size,
            "input_rate": self.input_rate,
            "input_transfer": self.input_transfer,
        }


@dataclass(frozen=True, slots=True, kw_only=True)
class LightSettings:
    """What lights the object beside its file's lights, and how dark its shadow is.

    Attributes:
        env: equirectangular map of the surroundings, None for none.
        env_rotation_deg: turn of the map about the up axis, counter-clockwise from above [deg].
        env_exposure_ev: brightness of the map in stops, 0 as it is [EV].
        shadow_strength: 1 as the light has it, 0 none, up to 2; a number above 0 asks for a shadow
            even where no light is known, None leaves that to `effects` [1].
    """

    env: Path | None = None
    env_rotation_deg: float = 0.0
    env_exposure_ev: float = 0.0
    shadow_strength: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class RealSettings:
    """What the plate's own things do to the object.

    Attributes:
        holdout: matte or depth of what stands in front of the object, None for none.
        occlusion: `auto` finds that by the plate's blur; `none` does not.
        reflectance: share of the light that the ground mirrors seen from straight above, 0 to 1;
            None where nothing is said of it: then 0, or `REFLECTANCE` where `--effects` asks [1].
    """

    holdout: str | None = None
    occlusion: Occlusion = "none"
    reflectance: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSettings:
    """The object and how the frame sees it.

    Attributes:
        glb: the animated object.
        camera: name of its camera, None for the first perspective one.
        layers: pattern of pre-rendered EXR layers, None to render the GLB.
        ground_y: height of the ground plane in the GLB's world, None to find it [scene unit].
        playback: which of its animations play, and when.
        placing: where it stands in the frame, None where its own camera tells.
        footprint: name of the node whose footprint finds the lens, None for all that is drawn.
        light: what lights it, and its shadow.
        real: what the plate's own things do to it.
        scene: name or number of the file's scene, None for its default one.
        fov_deg: field of view across the frame's width of a placed object, None to find it [deg].
    """

    glb: Path
    camera: str | None = None
    layers: str | None = None
    ground_y: float | None = None
    playback: Playback = ONCE
    placing: Placement | None = None
    footprint: str | None = None
    light: LightSettings = LightSettings()
    real: RealSettings = RealSettings()
    scene: str | None = None
    fov_deg: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class PlaceSettings:
    """One run of `nlens-video place`.

    Attributes:
        source: the plate.
        scene: the object.
        start: the place round which choices are shown.
        output: the contact sheet, a PNG.
    """

    source: SourceSettings
    scene: ObjectSettings
    start: Placement
    output: Path


@dataclass(frozen=True, slots=True, kw_only=True)
class OutputSettings:
    """The result and its encoding; None keeps what the source has.

    Attributes:
        spec: file, image sequence pattern, or `-` for standard output.
        codec: FFmpeg's name of the encoder.
        crf: quality of encoders that have such a number.
        pix_fmt: FFmpeg's name of the pixel format.
        keep_partial: whether an interrupted run leaves a playable part under its temporary name.
    """

    spec: str
    codec: str | None = None
    crf: float | None = None
    pix_fmt: str | None = None
    keep_partial: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Settings:
    """One run of `nlens-video render`.

    Attributes:
        source: the plate.
        scene: the object.
        output: the result; None for runs that write no picture (`fit`, `--plan`).
        preset: shipped pipeline's name or path of a pipeline file.
        effects: as `EffectRequest.parse` reads it, such as `auto,+shadow,-grain`.
        budget_ms: what a frame may cost [ms].
        hold_budget: whether quality steps down and up to keep it.
        late: what happens to frames that come faster than they are made.
        device: where networks and kernels run.
        aperture: shape of the lens' aperture.
        shutter_deg: how long the shutter is open, 360 for all of a frame, None if not known [deg].
        optics: what is known of the lens beside its focus.
        fit: a lens fit to use instead of finding one.
        save_fit: where to keep the fit.
        fallback: what stands in for a fit that fails.
        track_focus: whether a lens that changes is followed: when the plate shows it, never, or
            every so many frames.
        report: folder of the HTML report.
        aov: folder of the EXR layers of each frame.
        timings: file of the timing rows.
    """

    source: SourceSettings
    scene: ObjectSettings
    output: OutputSettings | None
    preset: str = "standard"
    effects: str = "auto"
    budget_ms: float = 180.0
    hold_budget: bool = False
    late: Late = "keep"
    device: Device = "auto"
    aperture: Aperture = ROUND
    shutter_deg: float | None = None
    optics: LensOverrides = LensOverrides()
    fit: Path | None = None
    save_fit: Path | None = None
    fallback: Fallback = "none"
    track_focus: TrackFocus = "auto"
    report: Path | None = None
    aov: Path | None = None
    timings: Path | None = None

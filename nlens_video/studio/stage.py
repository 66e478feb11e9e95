"""One frame of a shot as the pipeline makes it, with all kept that the next one needs again.

Plate, scene, camera, network and measurements are kept between pictures. While something is
dragged, the lens of the last picture at rest is held as well, and a cheaper pipeline runs; so is
the light, unless it is the sun that is dragged. At rest everything is found anew, by the code that
renders the shot.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from pathlib import Path

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.objects import FurtherObject
from nlens_video.core.settings import ObjectSettings, Settings, SourceSettings, SunSettings
from nlens_video.graph.base.objects_on_ground import load_scene
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import View
from nlens_video.graph.session import Session, open_session
from nlens_video.run.lens_request import lens_request
from nlens_video.run.open_run import view_of
from nlens_video.scene.scene import Scene
from nlens_video.solve.evidence import PlateLines
from nlens_video.stages.p_projection import project_to_ground
from nlens_video.studio.guides import Guides, guides
from nlens_video.studio.inspection import Inspection
from nlens_video.studio.objects import without_places
from nlens_video.studio.open_plate import Plate
from nlens_video.studio.sessions import (
    QUICK,
    Picturing,
    camera_height,
    find_lens,
    likeliest_sun,
    placed,
    previewed,
    rebuilt,
    without_lens,
    without_sun,
)
from nlens_video.video.info import SourceFrame

OnProgress = Callable[[int, int | None], None]
Solve = Callable[[Settings, OnProgress], tuple[SolvedCamera, PlateLines]]
"""Solves a plate's camera; is told the frames so far and in all."""


class Drawn(Struct, frozen=True, kw_only=True):
    """A frame with the object.

    Attributes:
        picture: the composite.
        guides: what is where on it.
        nodes_ms: time of each node on this frame [ms].
        session: what made it.
        notes: for the user.
        no_lens: why a render would stop, empty where it would not.
        fit: the lens, None where the object is out of view.
        lines: what the plate's camera was solved from, None where it was not solved.
        sun: the likeliest by the plate's shadows, None where none was looked for.
    """

    picture: Picture
    guides: Guides
    nodes_ms: dict[str, float]
    session: Session
    notes: tuple[str, ...]
    no_lens: str
    fit: LensFit | None
    lines: PlateLines | None
    sun: SunSettings | None


class _Lens(Struct, frozen=True):
    """The lens of the last picture at rest, and how high its camera stood over the ground."""

    fit: LensFit
    height: float

    def seen_from(self, height: float) -> LensFit:
        """The same lens where the object's units are others: disparities are by the unit."""
        ratio, fit = height / self.height, self.fit
        return replace(fit, slope=fit.slope * ratio, slope_stderr=fit.slope_stderr * ratio)


@dataclass(slots=True)
class _Base:
    """What is kept from picture to picture of a kind.

    Attributes:
        unplaced: the shot without places and sun.
        scene: its files.
        session: the last one.
        renderer: closes what draws.
    """

    unplaced: Settings
    scene: Scene
    session: Session
    renderer: ExitStack


@dataclass(slots=True)
class Stage:
    """Draws frames of shots; all calls come from one thread, which owns the renderer.

    Attributes:
        solve: solves a plate's camera.
        on_progress: told while a camera is solved.
        check: called between steps; may raise, to give a picture up.
    """

    solve: Solve
    on_progress: OnProgress = lambda done, total: None
    check: Callable[[], None] = lambda: None
    _plate: Plate | None = None
    _bases: dict[Picturing, _Base] = field(default_factory=dict)
    _cameras: dict[object, tuple[SolvedCamera, PlateLines]] = field(default_factory=dict)
    _scenes: dict[object, Scene] = field(default_factory=dict)
    _lens: _Lens | None = None
    _lines: PlateLines | None = None

    def draw(self, settings: Settings, index: int, kind: Picturing = "rest") -> Drawn:
        """Draw a frame of a shot.

        Args:
            settings: the shot.
            index: of the frame in the plate.
            kind: how it is drawn.

        Raises:
            NlensError: as `run.render`.
        """
        plate = self._plate_of(settings.source)
        shown = previewed(settings, kind)
        view = self._view(shown, plate)
        if kind == "sharp":
            shown = without_lens(shown, self._session(shown, plate, view, "rest").decisions)
        session = self._session(shown, plate, view, kind)
        frame = plate.frames.frame(index)
        fit, no_lens = session.executor.fit, ""
        if fit is None:
            session, fit, no_lens = self._with_lens(session, shown.preset, plate, frame, kind)
        first = plate.first()[0]
        if frame.index != first.index:
            session.executor.observe_skipped(first)
        picture = frame.picture.copy()
        state = session.executor.begin_frame(replace(frame, picture=picture))
        for node in session.graph.nodes:
            self.check()
            session.executor.run(state, (node,))
        timing = session.executor.profiler.close_frame(frame.index, frame.pts)
        scene = session.context.objects.scene
        return Drawn(
            picture=picture,
            guides=guides(settings.scene, scene, session.view, frame.index, frame.time_s),
            nodes_ms=timing.nodes,
            session=session,
            notes=session.notes,
            no_lens=no_lens,
            fit=fit,
            lines=self._lines,
            sun=likeliest_sun(session),
        )

    def inspect(self, settings: Settings) -> Inspection:
        """The blur of the frame that the lens is found on, and how it is found.

        Raises:
            NlensError: as `run.render`, except that no lens is found.
        """
        plate = self._plate_of(settings.source)
        first, *following = plate.first()
        coc = plate.estimate_coc(first.picture, [one.picture for one in following])
        shown = previewed(settings, "rest")
        session = self._session(shown, plate, self._view(shown, plate), "rest")
        fit, no_lens = session.executor.fit, ""
        if fit is None:
            session, fit, no_lens = self._with_lens(session, shown.preset, plate, first, "rest")
        found = session.executor.shot.found_lens
        context = session.context
        ground = project_to_ground(
            context.objects.footprint(first.time_s), context.objects.camera(first.time_s),
            context.ground_height,
        )  # fmt: skip
        return Inspection(
            picture=first.picture, coc=coc, ground=ground, no_lens=no_lens, fit=fit,
            regression=None if found is None else found.regression, unit_m=context.unit_m,
        )  # fmt: skip

    def forget(self) -> None:
        """Free what is kept from picture to picture: a fault may have left it half made."""
        bases, self._bases = self._bases, {}
        for base in bases.values():
            base.renderer.close()

    def close(self) -> None:
        """Free renderer, networks and files."""
        self.forget()
        if self._plate is not None:
            self._plate.frames.close()

    def _plate_of(self, source: SourceSettings) -> Plate:
        source = replace(source, ignored_lines=())  # of which the frames know nothing
        if self._plate is None or self._plate.source != source:
            self.close()
            self._plate, self._lens = Plate.opened(source), None
        return self._plate

    def _view(self, settings: Settings, plate: Plate) -> View:
        """How the reduced frames see the scene, before the object is placed."""
        view = view_of(settings, plate.frames.info)
        self._lines = None
        scene = self._scene(settings)
        unplaced = settings.scene.placing is None and settings.scene.on_ground is None
        if settings.needs_camera or (
            unplaced and view.solved is None and not scene.camera_names
        ):  # fmt: skip
            view = replace(view, solved=self._camera(settings))
        width, height = plate.frames.size
        solved = None if view.solved is None else view.solved.resized(width, height)
        return replace(view, width=width, height=height, solved=solved)

    def _camera(self, settings: Settings) -> SolvedCamera:
        lens = settings.lens.across(1.0, 1.0)  # any shape will do: it tells lenses apart
        fov = settings.scene.fov_deg or lens.fov_x_deg
        key = settings.source, settings.scale, fov
        if key not in self._cameras:
            self._cameras.clear()
            self._cameras[key] = self.solve(settings, self.on_progress)
        camera, self._lines = self._cameras[key]
        return camera

    def _scene(self, settings: Settings) -> Scene:
        objects = settings.scene
        each: tuple[ObjectSettings | FurtherObject, ...] = (objects, *objects.others)
        key = tuple((one.glb, _written_at(one.glb), one.playback, one.scene) for one in each)
        if key not in self._scenes:
            self._scenes.clear()
            self._scenes[key] = load_scene(objects)
        return self._scenes[key]

    def _session(self, settings: Settings, plate: Plate, view: View, kind: Picturing) -> Session:
        """A session for the shot: one that is kept, objects and sun where they are, or a new one.

        Its nodes are new, so that nothing of another place stays; but the light while dragging.
        """
        unplaced = replace(settings, scene=without_sun(without_places(settings.scene)))
        scene = self._scene(settings)
        kept = self._bases.get(kind)
        if kept is None or kept.unplaced != unplaced or kept.scene is not scene:
            if kept is not None:
                self._bases.pop(kind).renderer.close()
            session = open_session(
                settings.scene, lens_request(settings, plate.frames.info), view,
                Profiler(settings.budget_ms), plate.preview,
                scene=scene, estimate_coc=plate.estimate_coc,
            )  # fmt: skip
            stack = ExitStack()
            stack.enter_context(session.render_context())
            self._bases[kind] = _Base(unplaced, scene, session, stack)
            return session
        kept.session = placed(kept.session, settings, scene, view, hold_light=kind in QUICK)
        return kept.session

    def _with_lens(
        self, session: Session, preset: str, plate: Plate, frame: SourceFrame, kind: Picturing
    ) -> tuple[Session, LensFit | None, str]:
        """The session with its lens: held, or found where the run finds it; else why it is not."""
        height = camera_height(session, plate.first()[0].time_s)
        if kind in QUICK and self._lens is not None and height > 0.0:
            fit = self._lens.seen_from(height)
            session.executor.pin_fit(fit)
            return session, fit, ""
        try:
            found, no_lens = find_lens(session.executor, plate, frame), ""
        except LensFitError as error:
            no_lens = str(error)
            context = replace(session.context, fallback_constant=True)
            session = rebuilt(session, preset, context, session.view, {})
            found = find_lens(session.executor, plate, frame)
        if found is not None:
            session.executor.pin_fit(found)
            if kind == "rest" and height > 0.0:
                self._lens = _Lens(found, height)
        return session, found, no_lens


def _written_at(path: Path) -> int:
    """When a file was last written, 0 where it is not there [ns]."""
    return path.stat().st_mtime_ns if path.exists() else 0

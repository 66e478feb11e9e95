"""The report: one self-contained page that states what is missing and stays small."""

import copy
import json
import pickle
import re
from fractions import Fraction

import numpy as np
import pytest
from msgspec.structs import replace
from support.page_reader import read, without_pictures
from support.shots import (
    HEIGHT,
    INTERCEPT,
    SLOPE,
    WIDTH,
    camera,
    cube_glb,
    fit_json,
    plate,
    write_video,
)

from nlens_video.core.errors import Note, NoteKind, OutputError, kind_of
from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    CocMap,
    DefocusedLayer,
    ObjectLayer,
)
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.placement import Placement
from nlens_video.core.settings import (
    ObjectSettings,
    OutputSettings,
    Settings,
    SourceSettings,
)
from nlens_video.effects.planner import Decision
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import FrameTiming, Profiler
from nlens_video.graph.base.values import FoundLens
from nlens_video.graph.base.view import View
from nlens_video.graph.effect_plan import LensRequest
from nlens_video.graph.nodes.object_and_lens import constant_fit
from nlens_video.graph.session import open_session
from nlens_video.report.collect import PAGE, Report
from nlens_video.run.render import render
from nlens_video.stages.p_projection import project_to_ground
from nlens_video.stages.r_regression import FitLens
from nlens_video.video.info import SourceFrame
from nlens_video.video.input.source import open_source
from nlens_video.video.pixels.picture import ArrayPicture

BOX = Box(200, 120, 280, 200)
TRUE_FIT = LensFit(slope=SLOPE, intercept=INTERCEPT, width=WIDTH, height=HEIGHT)


class Bench:
    """A run whose nodes are played by hand: real source, GLB and graph; no OpenGL, no network."""

    def __init__(self, folder, *, fit=None, effects="auto", glb_name="cube.glb", **objects):
        folder.mkdir(exist_ok=True)
        self.folder = folder
        self.rgb = plate()
        video = write_video(folder / "plate.mkv", 1, codec="ffv1", audio=False, rgb=self.rgb)
        glb = cube_glb(folder / glb_name)
        self.profiler = Profiler(180.0)
        lens = LensRequest(fit=fit, effects=effects)
        view = View(width=WIDTH, height=HEIGHT)
        self.session = open_session(
            ObjectSettings(glb=glb, **objects), lens, view,
            Profiler(180.0),  # the opening takes real time, which is another in each run
            PlatePreview(lambda: ()),
        )  # fmt: skip
        with open_source(str(video)) as source:
            self.info = source.info
        self.shot = self.session.executor.shot

    def report(self, output="out.mp4", name="report"):
        return Report(self.folder / name, self.info, self.session, output)

    def enter(self, report, index=0, rgb=None):
        picture = ArrayPicture((self.rgb if rgb is None else rgb).copy(), "rgb")
        state = self.session.executor.begin_frame(
            SourceFrame(
                index=index, pts=index, time_base=Fraction(1, 25), time_s=index / 25, duration=1,
                picture=picture,
            )
        )  # fmt: skip
        report.on_frame_start(state)
        return state

    def measure(self, state):
        """What F, P and R leave behind, from the lens that made the plate."""
        footprint = np.array([[[-0.3, 0, -1.4], [0.3, 0, -1.4], [0, 0, -2.0]]])
        ground = project_to_ground(footprint, camera(), 0.0)
        coc = np.abs(SLOPE * np.maximum(ground.disparity, 0.12) + INTERCEPT)
        noise = np.random.default_rng(3).normal(0, 0.4, coc.shape)
        self.shot.plate_coc = CocMap(
            coc_px=np.maximum(coc + noise, 0).astype(np.float32),
            sigma_px=np.full(coc.shape, 0.5, np.float32),
        )
        self.shot.ground = ground
        regression = FitLens()(self.shot.plate_coc, ground, state.frame.index)
        self.shot.found_lens = FoundLens(fit=regression.fit, regression=regression)
        self.session.executor.fit = regression.fit
        state.fitted_here = True

    def composite(self, state, *, sharp=False):
        hw = (BOX.height, BOX.width)
        rgba = np.tile(np.array([0.6, 0.1, 0.05, 1.0], np.float32), (*hw, 1))
        depth = np.tile(np.linspace(1.5, 1.8, BOX.width, dtype=np.float32), (BOX.height, 1))
        layer = ObjectLayer(box=BOX, rgba=rgba, depth=depth)
        state.values.layer = layer
        if not sharp:
            coc = self.session.executor.fit.coc_px(1.0 / depth)
            state.values.defocused = DefocusedLayer(layer=layer, coc_px=coc)
        state.values.blurred = BlurredLayer(box=BOX, rgba=rgba)
        state.frame.picture.composite_over(BOX, rgba)

    def done(self, report, state, **nodes):
        for name, elapsed_ms in (nodes or {"decode": 3.0, "reblur": 40.0}).items():
            self.profiler.add(state.frame.index, name, elapsed_ms)
        timing = self.profiler.close_frame(state.frame.index, 0, warm_up=state.fitted_here)
        report.frame(state, timing)

    def finish(self, report, notes=()):
        report.finish(self.profiler.summary(), notes)
        return (self.folder / "report" / PAGE).read_text(encoding="utf-8")


def measured_run(bench, frames=5, notes=()):
    with bench.report() as report:
        for index in range(frames):
            state = bench.enter(report, index)
            if index == 0:
                bench.measure(state)
            bench.composite(state)
            bench.done(report, state)
        return bench.finish(report, notes)


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    return measured_run(Bench(tmp_path_factory.mktemp("measured")))


def test_report_is_well_formed_and_has_every_section(measured):
    page = read(measured)
    titles = [attributes["id"] for attributes in page.all("h2")]
    assert titles == [f"{name}-title" for name in
                      ("compare", "strip", "maps", "fit", "times", "plan")]  # fmt: skip
    assert len(page.all("h1")) == 1
    assert page.all("html")[0]["lang"] == "en"
    assert "missing" not in [attributes.get("class") for attributes in page.all("p")]


def test_report_loads_nothing_from_elsewhere(measured):
    page = read(measured)
    assert all(value.startswith(("data:image/jpeg;base64,", "#")) for value in page.fetched)
    assert not re.search(r"url\(|@import|@font-face", page.css)
    assert not re.search(r"https?:|fetch\(|XMLHttpRequest|import\(", without_pictures(measured))


def test_every_picture_and_chart_has_a_text_alternative(measured):
    page = read(measured)
    assert page.all("img")
    assert all(attributes["alt"].strip() for attributes in page.all("img"))
    charts = [a for a in page.all("svg") if a.get("role") == "img"]
    assert len(charts) == 3
    assert all(chart["aria-label"] for chart in charts)
    assert all("aria-hidden" in a for a in page.all("svg") if a not in charts)
    (slider,) = page.all("input")
    assert slider["type"] == "range"
    assert {"for": slider["id"]} in page.all("label")


def test_headings_skip_no_level_and_ids_are_unique(measured):
    page = read(measured)
    levels = [int(tag[1]) for tag, _ in page.tags if re.fullmatch(r"h[1-6]", tag)]
    assert all(b - a <= 1 for a, b in zip(levels, levels[1:], strict=False))
    names = [attributes["id"] for _, attributes in page.tags if "id" in attributes]
    assert len(names) == len(set(names))


def test_report_describes_the_lens_in_plain_words(measured):
    text = read(measured).text
    focus = float(re.search(r"in focus at ([\d.]+) m", text).group(1))
    assert focus == pytest.approx(2.0, rel=0.02)
    assert "in front of the focal plane, 1.5 to 1.8 m away" in text
    least, most = map(float, re.search(r"\(CoC\) is ([\d.]+) to ([\d.]+) px", text).groups())
    assert least == pytest.approx(SLOPE / 1.8 + INTERCEPT, abs=0.3)
    assert most == pytest.approx(SLOPE / 1.5 + INTERCEPT, abs=0.3)


def test_lengths_of_a_plate_without_scale_are_in_units_not_in_metres(tmp_path):
    place = Placement(at=(0.5, 0.8), size=0.3, horizon=0.3)
    text = read(measured_run(Bench(tmp_path / "run", placing=place), frames=1)).text
    assert re.search(r"in focus at [\d.]+ units from the camera", text)
    assert "units away" in text and "px units" in text and "disparity (1 / units)" in text
    assert "Lengths are in units of the GLB." in text
    assert not re.search(r"\d m\b|\(m\)|px m\b", text)


def test_a_good_fit_gives_no_warning(measured):
    assert not [a for a in read(measured).all("li") if a.get("class") == "warning"]


def test_file_names_and_notes_are_escaped_in_the_report(tmp_path):
    bench = Bench(tmp_path / "run")
    bench.info = replace(bench.info, name='<script>alert("1")</script>&.mp4')
    with bench.report(output="\"><img src=x onerror='x'>.mp4") as report:
        text = bench.finish(report, ("a mesh '<b>\"bold\"</b>' is not drawn",))
    page = read(text)
    assert len(page.all("script")) == 1
    assert page.all("b") == []
    assert all("onerror" not in attributes for attributes in page.all("img"))
    assert '<b>"bold"</b>' in page.text


def test_report_of_a_given_fit_has_no_maps_and_samples(tmp_path):
    bench = Bench(tmp_path / "run", fit=TRUE_FIT)
    with bench.report() as report:
        for index in range(3):
            state = bench.enter(report, index)
            bench.composite(state)
            bench.done(report, state)
        page = read(bench.finish(report))
    assert "The lens was given with --fit" in page.text
    assert "in focus at 2 m" in page.text
    assert "CoC of the object" in page.text
    assert "CoC of the plate" not in page.text
    assert page.all("input")


def test_report_without_effects_shows_the_sharp_composite(tmp_path):
    bench = Bench(tmp_path / "run", effects="none")
    with bench.report() as report:
        state = bench.enter(report)
        bench.composite(state, sharp=True)
        bench.done(report, state)
        page = read(bench.finish(report))
    assert "Defocus was not simulated (left out by" in page.text
    assert "sharp" in page.text
    assert page.all("input")


def test_report_states_that_the_object_was_never_in_view(tmp_path):
    bench = Bench(tmp_path / "run")
    with bench.report() as report:
        for index in range(3):
            bench.done(report, bench.enter(report, index), decode=2.0)
        page = read(bench.finish(report))
    assert "The object was never in view" in page.text
    assert page.all("img") == []
    assert [a for a in page.all("svg") if a.get("role") == "img"]  # the times are there


def test_report_of_a_fit_run_shows_plate_and_fit(tmp_path):
    bench = Bench(tmp_path / "run")
    with bench.report(output="lens.json") as report:
        state = bench.enter(report)
        bench.measure(state)
        bench.done(report, state, fit=9.0)
        page = read(bench.finish(report))
    assert "No frame was composited in this run" in page.text
    assert "lens.json the lens" in page.text
    assert "depths of the object" not in page.text
    assert "CoC of the plate" in page.text
    assert len([a for a in page.all("svg") if a.get("role") == "img"]) == 2
    assert page.all("input") == []


@pytest.mark.parametrize(
    ("changes", "words", "remedy"),
    [
        ({"sign": "ambiguous", "sign_margin": 0.02}, "hardly follows from the picture", "--fit"),
        ({"sign": "assumed"}, "was assumed", "--save-fit"),
        (
            {"sign": "ambiguous", "sign_margin": 0.02, "other": (SLOPE, 1.5 * INTERCEPT)},
            "hardly follows from the picture",
            "--prefer near",
        ),
        (
            {"sign": "ambiguous", "sign_margin": 0.02, "other": (SLOPE, 0.5 * INTERCEPT)},
            "takes the other lens that explains the plate",
            "--prefer far",
        ),
        ({"inlier_fraction": 0.3}, "Only 30% of the ground agrees", "--ground-y"),
        ({"slope_stderr": 30.0, "intercept_stderr": 9.0}, "is known to", "--range"),
        ({"intercept": -8.0}, "px less blurred than the fitted lens says", "--ground-y"),
    ],
)
def test_uncertain_fit_gives_a_warning_with_a_remedy(tmp_path, changes, words, remedy):
    bench = Bench(tmp_path / "run")
    with bench.report() as report:
        state = bench.enter(report)
        bench.measure(state)
        regression = bench.shot.found_lens.regression
        changed = replace(regression, fit=replace(regression.fit, **changes))
        bench.shot.found_lens = FoundLens(fit=changed.fit, regression=changed)
        bench.session.executor.fit = changed.fit
        bench.composite(state)
        bench.done(report, state)
        text = bench.finish(report)
    warning = re.search(r'<li class="warning">.*?</li>', text).group(0)
    assert words in warning
    option, *value = remedy.split()
    assert " ".join((f"<code>{option}</code>", *value)) in warning


def test_constant_fallback_gives_a_warning_with_its_reason(tmp_path):
    bench = Bench(tmp_path / "run")
    note = "constant CoC instead of a fit: only 3 samples"
    with bench.report() as report:
        state = bench.enter(report)
        bench.measure(state)
        fit = constant_fit(bench.shot.plate_coc, bench.shot.ground)
        bench.shot.found_lens = FoundLens(fit=fit, regression=None, warning=note)
        bench.session.executor.fit = fit
        bench.composite(state)
        bench.done(report, state)
        page = read(bench.finish(report, (note,)))
    assert "is used at every depth" in page.text
    assert page.text.count("only 3 samples") == 2  # the warning, and in place of the plot


def test_report_of_ten_thousand_frames_is_small_and_its_strip_evenly_spaced(tmp_path):
    bench = Bench(tmp_path / "run", fit=TRUE_FIT)
    small = np.zeros((36, 64, 3), np.uint8)
    blurred = BlurredLayer(box=Box(0, 0, 2, 2), rgba=np.ones((2, 2, 4), np.float32))
    with bench.report() as report:
        for index in range(10_000):
            state = bench.enter(report, index, small)
            state.values.blurred = blurred
            bench.done(report, state)
        assert len(report._plates) <= 1
        text = bench.finish(report)
    page = read(text)
    assert len(text) < 400_000
    names = [a["alt"] for a in page.all("img")]
    strip = [int(name.rsplit(" ", 1)[1]) for name in names if name.startswith("Composite, frame")]
    assert len(strip) == 12
    assert strip[0] == 0
    gaps = np.diff(strip)
    assert gaps.max() <= 2 * gaps.min()
    assert strip[-1] + gaps.max() >= 9_999
    assert "means of 32 frames" in page.text


def test_plates_of_frames_without_the_object_are_not_kept(tmp_path):
    bench = Bench(tmp_path / "run")
    with bench.report() as report:
        waiting = [bench.enter(report, index) for index in range(4)]
        assert len(report._plates) == 4
        for state in waiting:
            bench.done(report, state, decode=1.0)
        assert report._plates == {}


def test_report_folder_that_is_a_file_is_refused_in_one_line(tmp_path):
    bench = Bench(tmp_path / "run")
    (bench.folder / "report").write_text("a file")
    with pytest.raises(OutputError, match="report: is a file") as refused:
        bench.report()
    assert "\n" not in str(refused.value)


def test_failed_run_leaves_no_report(tmp_path):
    bench = Bench(tmp_path / "run")
    with pytest.raises(RuntimeError), bench.report() as report:
        bench.enter(report)
        raise RuntimeError("the run failed")
    assert list((bench.folder / "report").iterdir()) == []


def test_report_lists_the_planned_effects_with_reasons(tmp_path):
    bench = Bench(tmp_path / "run")
    reason = "because the <scene> calls for it"
    decisions = (Decision(effect="defocus", wanted=True, reason=reason),)
    bench.session = replace(bench.session, decisions=decisions)
    with bench.report() as report:
        text = bench.finish(report)
    assert reason in read(text).text


def test_identical_runs_give_identical_reports(tmp_path):
    first, second = (measured_run(Bench(tmp_path / name), frames=2) for name in ("a", "b"))
    assert first == second


@pytest.mark.needs_gl
def test_report_of_a_real_run_shows_before_and_after(tmp_path):
    video = write_video(tmp_path / "plate.mp4", 4, audio=False)
    glb = cube_glb(tmp_path / "cube.glb", end=(0.5, 0.0, -2.5), seconds=0.2)
    settings = Settings(
        source=SourceSettings(spec=str(video)),
        scene=ObjectSettings(glb=glb),
        output=OutputSettings(spec=str(tmp_path / "out.mp4")),
        fit=fit_json(tmp_path / "fit.json"),
        report=tmp_path / "report",
    )
    render(settings)
    page = read((tmp_path / "report" / PAGE).read_text(encoding="utf-8"))
    assert "plate.mp4 \N{RIGHTWARDS ARROW} out.mp4" in page.text
    assert [a["alt"] for a in page.all("img")][:2] == [
        "The composite, frame 0, 0.00 s",
        "The plate, frame 0, 0.00 s",
    ]
    assert len([a for a in page.all("img") if a["alt"].startswith("Composite, frame")]) == 4
    assert "CoC to" in page.text


def test_chart_of_timings_accepts_frames_without_nodes(tmp_path):
    bench = Bench(tmp_path / "run")
    with bench.report() as report:
        report.frame(bench.enter(report), FrameTiming(index=0, pts=0, nodes={}))
        assert read(bench.finish(report))


def test_note_keeps_its_kind_when_copied_or_pickled():
    note = Note("stream 3 is not carried over", NoteKind.STREAM_LEFT_OUT)
    for same in (copy.deepcopy(note), pickle.loads(pickle.dumps(note))):
        assert same == note
        assert kind_of(same) is NoteKind.STREAM_LEFT_OUT
    assert json.loads(json.dumps([note])) == ["stream 3 is not carried over"]
    assert kind_of("no lights") is NoteKind.OTHER

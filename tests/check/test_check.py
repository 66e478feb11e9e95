"""`nlens-video check` on composites with and without faults, through real codecs."""

import json
from array import array
from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from support import shots, takes
from support.clips import copy, trim, write_clip

from nlens_video.check.command import compare
from nlens_video.check.frames import FrameFeatures, Pair
from nlens_video.check.judge import judge_plate, objects_among, tolerance
from nlens_video.check.likeness import Likeness
from nlens_video.check.measure import Measures
from nlens_video.check.regions import Track
from nlens_video.cli.main import main
from nlens_video.core.settings import SourceSettings


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plate")
    return takes.encode(folder / "in.mp4", [takes.plate(n) for n in range(takes.FRAMES)])


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    """A plate of a camera that does not move."""
    folder = tmp_path_factory.mktemp("still")
    return takes.encode(folder / "in.mp4", [takes.plate(0)] * takes.FRAMES)


@pytest.fixture
def check(source, tmp_path):
    """Composite with some fault, and compare."""

    def run(plate=source, name="out.mp4", **options):
        return found(takes.composite(plate, tmp_path / name, **options), plate)

    return run


def found(result, plate, **options):
    return compare(str(result), SourceSettings(spec=str(plate)), **options).verdict


def edited(source, path, edit, **options):
    """A clean composite whose list of pictures (and their numbers as times) is edited."""
    pictures = [takes.with_object(one, n) for n, one in enumerate(takes.decode(source))]
    times = list(range(len(pictures)))
    pictures, times = edit(pictures, times)
    return takes.encode(path, pictures, times=times, **options)


def texts(verdict):
    return [one.text for one in verdict.findings]


@pytest.mark.parametrize(
    ("name", "options"),
    [("out.mp4", {"crf": 18}), ("out.mp4", {"crf": 28}), ("out.mkv", {"codec": "ffv1"})],
    ids=["H.264", "coarse H.264", "lossless"],
)
def test_clean_composite_has_no_findings(check, name, options):
    verdict = check(name=name, **options)
    assert texts(verdict) == []
    assert verdict.frames == (takes.FRAMES, takes.FRAMES) and verdict.object_frames == takes.FRAMES


def test_clean_composite_on_a_static_plate_has_no_findings(check, still):
    assert texts(check(plate=still)) == []


def test_unchanged_plate_passes_with_a_note_that_no_object_was_found(source):
    verdict = found(source, source)
    assert texts(verdict) == [] and "no object" in verdict.notes[0]


def test_pixels_of_another_shape_are_reported_of_videos(tmp_path):
    wide = Fraction(16, 11)
    plate = takes.encode(tmp_path / "in.mp4", [takes.plate(0)] * 6, aspect=wide)
    pictures = [takes.with_object(one, n) for n, one in enumerate(takes.decode(plate))]
    kept = takes.encode(tmp_path / "kept.mp4", pictures, aspect=wide)
    assert found(kept, plate).fine
    (text,) = texts(found(takes.encode(tmp_path / "lost.mp4", pictures), plate))
    assert "displayed 0.69 times as wide as its plate" in text
    assert "its pixels are square, the plate's 16:11" in text
    copy(kept, tmp_path / "p_%d.png")
    assert not [one for one in texts(found(tmp_path / "p_%d.png", plate)) if "wide" in one]


def test_dropped_frame_that_leaves_a_time_gap_is_reported(source, tmp_path):
    def drop(pictures, times):
        return pictures[:9] + pictures[10:], times[:9] + times[10:]

    (finding,) = found(edited(source, tmp_path / "o.mp4", drop), source).findings
    assert finding.kind == "frames" and "no frame for the input's frame 9" in finding.text


def test_dropped_frame_is_reported_when_later_frames_move_up(source, tmp_path):
    def drop(pictures, times):
        return pictures[:9] + pictures[10:], times[:-1]

    verdict = found(edited(source, tmp_path / "o.mp4", drop), source)
    assert any("frames 9 to 22: dropped" in text for text in texts(verdict)), texts(verdict)
    assert any("input's frame 23" in text for text in texts(verdict))


def test_repeated_frame_is_reported(source, tmp_path):
    def repeat(pictures, times):
        pictures[12] = pictures[11]
        return pictures, times

    verdict = found(edited(source, tmp_path / "o.mp4", repeat), source)
    assert any(text.startswith("frame 12: repeated") for text in texts(verdict)), texts(verdict)


def test_frozen_object_on_a_static_plate_is_reported(still, tmp_path):
    def repeat(pictures, times):
        pictures[12] = pictures[11]
        return pictures, times

    (finding,) = found(edited(still, tmp_path / "o.mp4", repeat), still).findings
    assert (finding.kind, finding.frame, finding.last) == ("freeze", 12, 12)


def test_delayed_frames_are_reported(source, tmp_path):
    def delay(pictures, times):
        return pictures, [time + 0.3 * (time >= 20) for time in times]

    (finding,) = found(edited(source, tmp_path / "o.mp4", delay), source).findings
    assert finding.kind == "time" and "frames 20 to 23: shown 12.0 ms late" in finding.text


def test_single_frame_with_more_blur_is_reported_as_a_jump(check):
    (finding,) = check(looks=lambda number: {"sigma": 3.0 if number == 12 else 1.5}).findings
    assert (finding.kind, finding.frame, finding.last) == ("pop", 12, 12)
    assert "sharpness" in finding.text and finding.value < -0.2


@pytest.mark.parametrize(
    ("what", "usual", "share", "least"), [("detail", 1.0, 0.1, 0.05), ("sigma", 1.5, 0.2, 0.05)]
)
def test_sharpness_flicker_is_reported(check, what, usual, share, least):
    verdict = check(looks=lambda number: {what: usual * (1 + share * (-1) ** number)})
    assert {one.kind for one in verdict.findings} == {"flicker"}, texts(verdict)
    assert "sharpness" in verdict.findings[0].text
    assert verdict.measures["sharpness_bend"] > least


def test_motion_blur_that_ends_as_the_object_stops_is_no_fault(still, tmp_path):
    def place(time):
        return 88 + 10.0 * min(time, 11.0), 100.0

    def stop(pictures, times):
        plates = takes.decode(still)
        moments = np.linspace(-0.25, 0.25, 9)
        return [
            np.mean(
                [takes.with_object(one, n, place=place(n + moment)) for moment in moments], axis=0
            )
            for n, one in enumerate(plates)
        ], times

    assert texts(found(edited(still, tmp_path / "o.mp4", stop), still)) == []


def test_plate_whose_exposure_goes_up_and_down_is_no_fault_of_the_object(tmp_path):
    gains = [1.06 if n % 2 else 0.94 for n in range(takes.FRAMES)]
    pictures = [gain * takes.plate(0) for gain in gains]
    plate = takes.encode(tmp_path / "in.mp4", pictures)
    made = [gain * takes.with_object(takes.plate(0), n) for n, gain in enumerate(gains)]
    assert texts(found(takes.encode(tmp_path / "o.mp4", made), plate)) == []


def test_lasting_change_of_blur_is_reported(check):
    verdict = check(looks=lambda number: {"sigma": 1.5 if number < 12 else 3.0})
    assert {(one.kind, one.frame) for one in verdict.findings} == {("pop", 12)}, texts(verdict)
    assert "stays so" in verdict.findings[0].text


def test_object_missing_from_one_frame_is_reported(source, tmp_path):
    def lose(pictures, times):
        pictures[7] = list(takes.decode(source))[7]
        return pictures, times

    verdict = found(edited(source, tmp_path / "o.mp4", lose), source)
    assert any(text == "frame 7: the object is missing" for text in texts(verdict)), texts(verdict)


def test_changed_plate_corner_is_reported_with_its_position(source, tmp_path):
    def dirty(pictures, times):
        for picture in pictures[5:8]:
            picture[160:, 280:] += 12 / 255
        return pictures, times

    (finding,) = found(edited(source, tmp_path / "o.mp4", dirty), source).findings
    assert (finding.kind, finding.frame, finding.last) == ("plate", 5, 7)
    assert "40x32 px at 280,160" in finding.text and 9 < finding.value < 15


@pytest.mark.slow
@pytest.mark.needs_gl
def test_composite_rendered_by_the_program_has_no_findings(tmp_path):
    plate = shots.write_video(tmp_path / "in.mp4", frames=16)
    glb = shots.cube_glb(tmp_path / "anim.glb", end=(0.3, 0.0, -2.6), seconds=0.6)
    fit, result = shots.fit_json(tmp_path / "fit.json"), tmp_path / "out.mp4"
    words = (plate, glb, result, "--fit", fit, "--preset", "realtime", "-q")
    assert main([*map(str, words)]) == 0
    verdict = found(result, plate)
    assert texts(verdict) == [] and verdict.object_frames == 16


def test_second_object_is_a_plate_change_unless_two_objects_are_expected(source, tmp_path):
    def both(picture, number):
        second = takes.with_object(np.roll(picture, -120, axis=1), number)
        return takes.with_object(np.roll(second, 120, axis=1), number)

    pictures = [both(picture, number) for number, picture in enumerate(takes.decode(source))]
    result = takes.encode(tmp_path / "o.mp4", pictures)
    assert [one.kind for one in found(result, source).findings] == ["plate"]
    assert texts(found(result, source, objects=2)) == []


def beside(source, path, edit):
    """The composite, and something done to the plate beside the object."""
    pictures = []
    for number, picture in enumerate(takes.decode(source)):
        mask = np.zeros(picture.shape[:2], np.float32)
        cv2.ellipse(mask, (230 + 2 * number, 40), (36, 18), 0, 0, 360, 1.0, -1)
        soft = cv2.GaussianBlur(mask, (0, 0), 4)[..., None]
        pictures.append(takes.with_object(edit(picture, soft), number))
    return takes.encode(path, pictures)


def test_detached_shadow_is_noted_but_is_not_a_plate_change(source, tmp_path):
    result = beside(source, tmp_path / "o.mp4", lambda picture, soft: picture * (1 - 0.45 * soft))
    verdict = found(result, source)
    assert texts(verdict) == []
    assert any("taken for the object's shadow" in note for note in verdict.notes)


@pytest.mark.parametrize(
    "edit",
    [
        lambda picture, soft: picture + 0.15 * soft,
        lambda picture, soft: picture * (1 - soft) + 0.25 * soft,
        lambda picture, soft: picture * (1 - soft * np.array([0.0, 0.5, 0.6], np.float32)),
    ],
    ids=["lighter", "painted over", "of another hue"],
)
def test_change_that_is_not_an_even_darkening_is_a_plate_change(source, tmp_path, edit):
    verdict = found(beside(source, tmp_path / "o.mp4", edit), source)
    assert [one.kind for one in verdict.findings] == ["plate"], texts(verdict)


@pytest.mark.slow
def test_audio_shifted_by_80_ms_is_reported_and_by_15_ms_is_not(check):
    verdict = check(audio_shift_s=0.08)
    assert {one.kind for one in verdict.findings} == {"sound"}
    assert "audio 0 starts" in verdict.findings[0].text
    assert verdict.findings[0].value == pytest.approx(0.08, abs=0.002)
    assert texts(check(audio_shift_s=0.015)) == []


def test_missing_audio_is_reported(check):
    (finding,) = check(audio=False).findings
    assert finding.kind == "sound" and "missing" in finding.text


@pytest.mark.slow
@pytest.mark.parametrize(
    "options", [{"loudness": 0.0}, {"audio_codec": "ac3"}], ids=["silence instead", "another codec"]
)
def test_sound_that_is_not_the_plates_own_is_said_not_to_be_compared(check, options):
    verdict = check(**options)
    assert texts(verdict) == [] and "sound" in verdict.unknown
    assert any("only its start and its end are compared" in note for note in verdict.notes)
    assert "?   audio against the pictures" in verdict.as_text()
    assert "sound" not in check().unknown


@pytest.mark.parametrize("name", ["out.png", "out_%04d.png"], ids=["still", "sequence"])
def test_sound_is_not_missing_from_pictures(source, tmp_path, name):
    plate, *_ = takes.decode(source)
    coded = np.round(255 * takes.with_object(plate, 0)).astype(np.uint8)[..., ::-1]
    cv2.imwrite(str(tmp_path / name.replace("%04d", "0000")), coded)
    verdict = compare(str(tmp_path / name), SourceSettings(spec=str(source), frames=(0, 1))).verdict
    assert verdict.of("sound") == [] and verdict.frames == (1, 1)


@pytest.mark.parametrize("name", ["p_%d.png", "p_%d.tif", "p_%d.jpg", "p_%d.webp"])
@pytest.mark.parametrize("tag", [1, 2])
def test_pictures_that_tell_no_transfer_function_have_the_plates(tmp_path, name, tag):
    coded = np.round(255 * takes.plate(0)).astype(np.uint8)
    frame = av.VideoFrame.from_ndarray(coded, "rgb24").reformat(
        format="yuv420p", dst_colorspace=1, dst_color_range=1
    )
    frame.colorspace = frame.color_primaries = frame.color_trc = tag
    plate = write_clip(tmp_path / "in.mkv", [frame] * 3)
    copy(plate, tmp_path / name)
    assert texts(found(tmp_path / name, plate)) == []


@pytest.mark.slow
def test_given_transfer_function_holds_for_a_result_with_the_plates_tag(source, tmp_path):
    result = takes.composite(source, tmp_path / "o.mp4")
    given = SourceSettings(spec=str(source), input_transfer="iec61966-2-1")
    assert texts(compare(str(result), given, search_range=True).verdict) == []
    bt709, tagged = 1, tmp_path / "tagged.mkv"  # which says itself what it is
    takes.coded_again(result, tagged, "ffv1", "yuv420p", {}, color_trc=bt709)
    said = texts(compare(str(tagged), given).verdict)
    assert any("the whole plate has" in text for text in said)


class TestCommand:
    def run(self, capsys, *words):
        code = main(["check", *map(str, words)])
        return code, capsys.readouterr()

    def test_exit_code_0_and_a_table_when_nothing_is_found(self, source, capsys):
        code, said = self.run(capsys, source, "--against", source)
        assert code == 0 and said.out.count("ok") == 8

    def test_exit_code_1_and_json_with_the_findings(self, source, tmp_path, capsys):
        result = takes.composite(source, tmp_path / "o.mp4", audio_shift_s=0.08)
        code, said = self.run(capsys, result, "--against", source, "--json")
        verdict = json.loads(said.out)
        assert code == 1 and not verdict["fine"] and verdict["findings"][0]["kind"] == "sound"

    def test_report_has_charts_of_the_measured_series(self, source, tmp_path, capsys):
        result = takes.composite(source, tmp_path / "o.mp4")
        code, _ = self.run(capsys, result, "--against", source, "--report", tmp_path / "page", "-q")
        page = (tmp_path / "page" / "index.html").read_text()
        assert code == 0 and page.count('class="chart"') == 3 and "Nothing was found" in page

    def test_exit_code_2_without_the_plate(self, source, capsys):
        code, said = self.run(capsys, source)
        assert code == 2 and "--against" in said.err

    def test_exit_code_3_for_another_frame_size_or_a_missing_file(self, source, tmp_path, capsys):
        code, said = self.run(capsys, tmp_path / "none.mp4", "--against", source)
        assert code == 3 and "none.mp4" in said.err
        small = tmp_path / "small.png"
        import cv2

        cv2.imwrite(str(small), np.zeros((10, 20, 3), np.uint8))
        code, said = self.run(capsys, small, "--against", source)
        assert code == 3 and "20x10" in said.err


def part_of(source, path, first, end):
    """A clean composite of a part of a plate, as `--range` makes it."""
    pictures = [takes.with_object(one, n) for n, one in enumerate(takes.decode(source))]
    return takes.encode(path, pictures[first:end], audio=False)


def test_result_of_a_given_range_is_compared_with_that_range(source, tmp_path):
    result = part_of(source, tmp_path / "part.mp4", 9, 17)
    told = compare(str(result), SourceSettings(spec=str(source), frames=(9, 17))).verdict
    assert told.frames == (8, 8) and [one.kind for one in told.findings] == ["sound"]


def test_sound_is_not_missing_from_a_range_that_it_does_not_reach(tmp_path):
    pictures = [takes.plate(n) for n in range(takes.FRAMES)]
    plate = takes.encode(tmp_path / "in.mp4", pictures, audio_shift_s=0.6)
    for frames, kinds in (((4, 8), []), ((4, 20), ["sound"])):
        result = part_of(plate, tmp_path / "part.mp4", *frames)
        told = compare(str(result), SourceSettings(spec=str(plate), frames=frames)).verdict
        assert [one.kind for one in told.findings] == kinds


def test_range_of_a_result_is_detected_and_noted(source, tmp_path):
    result = part_of(source, tmp_path / "part.mp4", 9, 17)
    verdict = found(result, source, search_range=True)
    assert verdict.frames == (8, 8) and [one.kind for one in verdict.findings] == ["sound"]
    assert "taken for the result of --range 9:17" in verdict.notes[0]


def test_range_is_detected_on_a_static_plate_with_one_moving_light(tmp_path):
    def lights(number):
        picture = takes.plate(0).copy()
        cv2.circle(picture, (20 + 4 * number, 20), 12, (1, 1, 0.6), -1)
        noise = np.random.default_rng(number).normal(0, 0.01, picture.shape)
        return np.clip(picture + noise, 0, 1).astype(np.float32)

    plate = takes.encode(tmp_path / "in.mp4", [lights(n) for n in range(takes.FRAMES)])
    verdict = found(part_of(plate, tmp_path / "part.mp4", 9, 17), plate, search_range=True)
    assert "taken for the result of --range 9:17" in verdict.notes[0]
    assert [one.kind for one in verdict.findings] == ["sound"]


def test_result_of_the_first_frames_is_compared_with_these_and_noted(source, tmp_path):
    result = part_of(source, tmp_path / "part.mp4", 0, 8)
    verdict = found(result, source, search_range=True)
    assert verdict.frames == (8, 8) and verdict.of("frames") == []
    assert "taken for the result of --range 0:8" in verdict.notes[0]
    assert "--range 0: is for all" in verdict.notes[0]


def test_truncated_result_is_reported_with_the_range_that_would_explain_it(source, tmp_path):
    verdict = found(part_of(source, tmp_path / "part.mp4", 0, 17), source, search_range=True)
    assert any("frames 17 to" in text for text in texts(verdict))
    assert "--range 0:17" in verdict.notes[0]


def test_complete_result_is_compared_from_its_first_frame(source, tmp_path):
    result = takes.composite(source, tmp_path / "whole.mp4")
    verdict = found(result, source, search_range=True)
    assert texts(verdict) == [] and not any("--range" in note for note in verdict.notes)


def test_complete_result_of_a_trimmed_plate_is_not_taken_for_a_part(source, tmp_path):
    plate = trim(source, tmp_path / "in.mp4", 16)
    result = takes.composite(plate, tmp_path / "out.mp4", audio=False)
    verdict = found(result, plate, search_range=True)
    assert verdict.frames == (8, 8)
    assert not any("--range" in note for note in verdict.notes)


def crossing(folder, edit=lambda pictures, plates: None):
    """Plate and result of a still camera before which somebody crosses, in front of the object."""
    plates, pictures = [], []
    for number in range(40):
        coat = np.zeros((takes.HEIGHT, takes.WIDTH, 1), np.float32)
        cv2.rectangle(coat, (12 * number - 120, 30), (12 * number - 100, 190), 1.0, -1)
        coat = cv2.GaussianBlur(coat, (0, 0), 1)[..., None]
        plate = takes.plate(0)
        plates.append(0.15 * coat + (1 - coat) * plate)
        shown = takes.with_object(plate, number / 4)
        pictures.append(0.15 * coat + (1 - coat) * shown)
    edit(pictures, plates)
    source = takes.encode(folder / "in.mp4", plates)
    return found(takes.encode(folder / "o.mp4", pictures), source)


def test_object_that_somebody_crosses_before_is_one_without_findings(tmp_path):
    verdict = crossing(tmp_path)
    assert texts(verdict) == [] and verdict.object_frames == 40
    assert any("something moves in the plate at the object" in one for one in verdict.notes)


def test_faults_before_and_after_the_crossing_are_found(tmp_path):
    def lose(pictures, plates):
        pictures[4], pictures[35] = plates[4], plates[35]

    said = texts(crossing(tmp_path, lose))
    assert "frame 4: the object is missing" in said
    assert "frame 35: the object is missing" in said


def test_plate_difference_within_the_stated_tolerance_is_not_a_finding():
    measures = Measures(noise=array("d", [0.1]), likeness=[Likeness()], pairs=2)
    mask = np.ones((2, 2), bool)
    track = Track(first=0, mask=mask, former=mask, former_at=0)
    for index in range(2):
        track.add(index, np.ones((2, 2), bool), 1.8)
    measures.tracks.alive.append(track)
    assert tolerance(measures) == pytest.approx(2.1)
    assert objects_among(measures, 1) == [] and judge_plate(measures, []) == []
    track.worst = 2.2
    assert len(judge_plate(measures, [])) == 1


@pytest.mark.parametrize(("fade", "findings"), [(0.0, 1), (5.0, 0)])
def test_light_of_a_fade_may_be_off_by_more(fade, findings):
    measures = Measures(
        noise=array("d", [0.1]), likeness=[Likeness()], compared=array("q", [0]),
        shade=array("d", [0.7, 0.0, 0.0, 0.0]), fades=array("d", [fade]),
    )  # fmt: skip
    assert len(judge_plate(measures, [])) == findings


def test_fade_is_measured_between_frames():
    fading = [FrameFeatures(
        index=n, time_s=Fraction(n, 25), luma=level * np.ones((16, 16), np.float32),
        colour=np.dstack([level * np.ones((2, 2), np.float32)] * 3),
        detail=np.zeros((2, 2), np.float32), alpha=None,
    ) for n, level in enumerate((100, 104, 110))]  # fmt: skip
    measures = Measures()
    measures.add(Pair(fading[1], fading[1], fading[0], fading[2]))
    assert list(measures.fades) == [6.0]


def test_chroma_of_every_pixel_for_a_plate_of_half_is_no_plate_change(tmp_path):
    def striped(number):
        """Saturated edges that meet those of blocks."""
        picture = takes.plate(number)
        picture[:, 200:208], picture[150:160] = (0.9, 0.1, 0.1), (0.1, 0.2, 0.9)
        return picture

    plates = [striped(number) for number in range(8)]
    plate = takes.encode(tmp_path / "in.mkv", plates, codec="ffv1", audio=False)
    made = takes.composite(plate, tmp_path / "made.mkv", codec="ffv1", audio=False)
    result = takes.coded_again(made, tmp_path / "out.mkv", "ffv1", "yuv444p", {})
    assert texts(found(result, plate)) == []

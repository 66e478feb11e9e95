from collections import Counter

import cv2
import numpy as np
import pytest
from support.terminal import Terminal, program

from nlens_video.cli.main import main
from nlens_video.evaluate.study import demo
from nlens_video.evaluate.study.page import load_stimuli

SIZE = (320, 176)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    home = tmp_path_factory.mktemp("demo")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(demo, "_APERTURES", {"f/2": 24.0})
        demo.write_demo(home, SIZE, views=64)
    return home


def picture(folder, name):
    codes = cv2.imread(str(folder / name))
    assert codes is not None and codes.shape == (SIZE[1], SIZE[0], 3)
    return codes.astype(np.float32)


@pytest.mark.slow
def test_demo_study_shows_every_position_lens_and_method_once(folder):
    stimuli = load_stimuli(folder)
    assert len(stimuli) == 3 * 1 * 3 * 3
    for name in ("position", "focus", "method"):
        assert set(Counter(getattr(one, name) for one in stimuli).values()) == {9}
    assert len({(one.position, one.focus, one.method) for one in stimuli}) == 27
    assert {one.method for one in stimuli} == {"naive", "blind augmentation", "ours"}


@pytest.mark.slow
def test_demo_pictures_of_a_plate_differ_only_at_the_virtual_ball(folder):
    naive, ours = (picture(folder, f"f2_back_red_{method}.jpg") for method in ("naive", "ours"))
    changed = np.abs(naive - ours).max(axis=2) > 24
    rows, columns = np.nonzero(changed)
    assert len(rows) > 50
    assert rows.min() > 0.4 * SIZE[1] and 0.45 * SIZE[0] < columns.min()
    assert columns.max() < 0.75 * SIZE[0]


@pytest.mark.slow
def test_our_method_blurs_only_the_ball_that_is_out_of_focus(folder):
    def kept(focus):
        """Share of steep steps on the ball, in columns 190 to 219, that is left."""
        steps = [
            np.abs(
                np.diff(picture(folder, f"f2_{focus}_red_{method}.jpg")[90:170, 190:220], axis=0)
            )
            for method in ("ours", "naive")
        ]
        return float(np.percentile(steps[0], 99) / np.percentile(steps[1], 99))

    assert kept("back") < 0.5 and kept("middle") < 0.5 and kept("front") > 0.7


@pytest.mark.needs_gl
def test_demo_study_shows_its_progress_on_a_terminal(tmp_path):
    with Terminal(program("study", "make", "--demo", tmp_path / "study.html")) as terminal:
        assert "%" in terminal.wait_for("rendering plates")


@pytest.mark.parametrize("words", [["a", "b.html", "--demo"], ["b.html"]])
def test_folder_and_demo_exclude_each_other(words, capsys):
    assert main(["study", "make", *words]) == 2
    told = capsys.readouterr().err
    assert told.startswith("nlens-video: ") and told.count("\n") == 1


def test_unwritable_study_page_is_refused_before_any_rendering(tmp_path, capsys):
    assert main(["study", "make", "--demo", str(tmp_path / "gone" / "a.html")]) == 6
    assert "gone" in capsys.readouterr().err

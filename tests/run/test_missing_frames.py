"""A range behind the plate's end is told as it was given, with the frames that there are."""

import cv2
import pytest
from support import shots
from support.command import nlens, one_line


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Six plates numbered from 1001, a film of three frames and an object."""
    folder = shots.write_shot(tmp_path_factory.mktemp("range"), 3)
    for number in range(1001, 1007):
        assert cv2.imwrite(str(folder / f"p.{number}.png"), shots.grey())
    return folder


@pytest.mark.parametrize(
    ("plate", "given", "told"),
    [
        ("p.####.png", ["--range", "1001:1003"],
         "--range 1001:1003 of the plate: no such frames; it has 6: frames 0 to 5, counted from 0, "
         "whatever the numbers of the files"),
        ("in.mp4", ["--frame", "500"],
         "--frame 500 of the plate: no such frames; it has about 3: frames 0 to 2, counted from 0"),
        ("plate.png", ["--range", "500:"],
         "--range 500: of the plate: no such frames; it has 1: frame 0, counted from 0"),
    ],
)  # fmt: skip
def test_range_behind_the_end_is_told_with_the_frames_that_there_are(folder, plate, given, told):
    run = nlens(folder / plate, folder / "anim.glb", folder / "out.png", *given)
    assert one_line(run, 2) == f"nlens-video: {told}"


def test_solve_names_the_option_that_chose_no_frame(folder):
    run = nlens("solve", folder / "in.mp4", folder / "camera.json", "--frame", "40")
    assert one_line(run, 2).startswith("nlens-video: --frame 40 of the plate: no such frames; it ")

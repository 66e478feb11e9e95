"""An uncertain camera is said to be one, with what to give; a sure one is not."""

import numpy as np
import pytest
from msgspec.structs import replace

from nlens_video.cameras.doubt import doubt, what_was_found
from nlens_video.cameras.solved import CameraErrors, CameraKey, SolvedCamera


def camera(fov_deg=50.0, **more):
    key = CameraKey(index=0, pts_s=0.0, world_to_camera=np.eye(4), fov_x_deg=fov_deg)
    errors = CameraErrors(fov_deg=1.0, pitch_deg=0.5, roll_deg=0.2)
    sure = SolvedCamera(width=96, height=64, keys=(key,), fov="measured", horizon="measured",
                        errors=errors)  # fmt: skip
    return replace(sure, **more)


VAGUE = CameraErrors(fov_deg=18.0, pitch_deg=9.0, roll_deg=2.0)


def test_measured_camera_is_not_doubted():
    assert doubt(camera()) == ""
    assert doubt(camera(errors=VAGUE)) == ""  # of a file that says no errors


def test_guessed_horizon_and_field_of_view_are_named_with_what_to_give():
    line = doubt(camera(fov="assumed", horizon="assumed", errors=VAGUE))
    assert "field of view is a guess, 50 ± 18 degrees" in line
    assert "pitch is a guess, 0 ± 9 degrees" in line
    assert "\n" not in line
    for option in ("--fov", "--horizon", "--camera-from"):
        assert option in line


def test_what_a_camera_file_excludes_is_given_to_solve_or_without_the_file():
    line = doubt(camera(fov="assumed", horizon="assumed", errors=VAGUE), from_file=True)
    assert "give --fov DEG to `nlens-video solve` if the lens is known" in line
    assert "--at, --size and --horizon without --camera-from" in line
    assert line.endswith("or another --camera-from CAMERA")


def test_camera_of_which_nothing_is_measured_is_doubted_whatever_its_errors():
    line = doubt(camera(fov="assumed", horizon="assumed"))
    assert "field of view is a guess" in line and "pitch is a guess" in line
    assert doubt(camera(fov="metadata", horizon="assumed")) == ""


@pytest.mark.parametrize("fov", ["measured", "metadata"])
def test_lens_is_not_asked_for_where_the_pitch_alone_is_a_guess(fov):
    line = doubt(camera(fov=fov, horizon="assumed", errors=VAGUE))
    assert "pitch is a guess" in line and "--horizon" in line and "--camera-from" in line
    assert "--fov" not in line
    assert "--fov" in doubt(camera(fov="assumed", horizon="assumed", errors=VAGUE))


def test_error_that_is_no_number_is_doubted():
    unknown = CameraErrors(fov_deg=float("nan"), pitch_deg=float("nan"))
    assert "pitch is a guess" in doubt(camera(horizon="assumed", errors=unknown))


@pytest.mark.parametrize("path", ["rotation", "moving"])
def test_path_beside_which_its_points_lie_is_doubted(path):
    assert doubt(camera(path=path, width=800, reprojection_px=0.5)) == ""
    line = doubt(camera(path=path, width=800, reprojection_px=0.97))
    assert "half of the points that it follows lie over 0.97 px beside its path" in line
    assert "--range" in line and "--camera-from" in line
    assert "--fov" not in line and "--horizon" not in line
    assert doubt(camera(path="still", width=800, reprojection_px=0.97)) == ""


@pytest.mark.parametrize("fov_deg", [0.4, 160.0])
def test_field_of_view_of_no_lens_is_doubted_even_where_it_is_called_measured(fov_deg):
    assert f"{fov_deg:.3g} degrees, which no usual lens has" in doubt(camera(fov_deg))


def test_assumed_field_of_view_of_a_solved_path_is_not_doubted():
    moving = camera(fov="assumed", path="moving", errors=replace(VAGUE, pitch_deg=0.5))
    assert doubt(moving) == ""
    assert doubt(replace(moving, path="still")) != ""


def test_what_was_found_has_the_digits_of_its_error_and_nothing_is_said_twice():
    line = what_was_found(camera(51.63, fov="assumed", errors=VAGUE))
    assert "field of view 52 ± 18 degrees (assumed), pitch 0.0 (measured), path still" in line
    guess = camera(51.63, fov="assumed", horizon="assumed", errors=VAGUE)
    assert what_was_found(guess) == "" and "52 ± 18" in doubt(guess)
    assert "pitch 0.0 ± 9.0 (assumed), path rotation" in what_was_found(
        replace(guess, path="rotation")
    )


def test_field_of_view_that_the_user_gave_is_called_given():
    given = camera(46.0, fov="metadata", method="rotation; field of view by --fov 46")
    assert "field of view 46 degrees (given)" in what_was_found(given)
    assert "(from metadata)" in what_was_found(replace(given, method="rotation"))


def test_camera_of_a_file_that_states_no_errors_is_not_called_measured():
    line = what_was_found(camera(errors=CameraErrors(), path="moving"))
    assert "field of view 50 degrees, pitch 0.0, path moving; its file does not say how" in line
    assert "measured" not in line


def test_given_field_of_view_that_the_movement_contradicts_is_doubted():
    line = doubt(camera(fov="metadata", path="moving", fov_told_deg=(45.13, 0.42)))
    assert "its movement tells a field of view of 45.13 ± 0.42 degrees, not 50" in line
    assert line.endswith("; give another --fov DEG or none, or --camera-from CAMERA")

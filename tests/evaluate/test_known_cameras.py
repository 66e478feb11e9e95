"""Which plates with a known camera are found, and errors of cameras against them."""

import json
import math

import numpy as np
import pytest
from msgspec.structs import replace
from support.camera_paths import rotation
from support.known_cameras import solved, write_still

from nlens_video.cameras.solved import CameraErrors, CameraKey
from nlens_video.core.errors import InputError
from nlens_video.core.layers import CocMap
from nlens_video.evaluate.camera.angles import UNSOLVED, angle_errors
from nlens_video.evaluate.camera.clip import path_figures
from nlens_video.evaluate.camera.still import coc_rms, subject_of
from nlens_video.evaluate.camera.truth import Known, find_known


@pytest.fixture(scope="module")
def still(tmp_path_factory):
    return write_still(tmp_path_factory.mktemp("known") / "deep" / "one")


def exact(known):
    """The plate's true CoC, as if a network had read it without error."""
    coc = np.abs(np.load(known.folder / "bg_coc.npy").astype(np.float32))
    return CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.3))


def change(folder, **values):
    path = folder / "params.json"
    path.write_text(json.dumps(json.loads(path.read_text()) | values))


def test_plates_are_found_at_any_depth_and_named_by_their_path(still, tmp_path):
    (one,) = find_known(still.parent.parent)
    assert (one.name, one.kind, one.plate) == ("deep/one", "still", still / "bg.png")
    assert find_known(still)[0].name == "one"
    assert one.camera.keys[0].fov_x_deg == pytest.approx(
        2 * math.degrees(math.atan(math.tan(0.35) * 320 / 180))
    )


def test_linked_folders_are_followed_and_taken_once(still, tmp_path):
    (tmp_path / "a").symlink_to(still)
    (tmp_path / "b").symlink_to(still)
    (tmp_path / "loop").symlink_to(tmp_path)
    assert [one.name for one in find_known(tmp_path)] == ["a"]


def test_camera_that_films_and_stays_is_solved_from_its_clip(tmp_path):
    folder = write_still(tmp_path / "filmed")
    (folder / "bg.mp4").write_bytes(b"clip")
    change(folder, frames=[{"frame": 0, "time_s": 0.0}])
    (one,) = find_known(tmp_path)
    assert (one.kind, one.plate.name) == ("still", "bg.mp4")


def test_folder_without_known_cameras_is_refused(tmp_path):
    (tmp_path / "params.json").write_text('{"resolution": [4, 4]}')
    with pytest.raises(InputError, match="view_matrix_gltf"):
        find_known(tmp_path)
    with pytest.raises(InputError, match="no such folder"):
        find_known(tmp_path / "gone")


@pytest.mark.parametrize(
    "values",
    [{"view_matrix_gltf": [[1, 2], [3, 4]]}, {"yfov_rad": "wide"}, {"resolution": [320]},
     {"yfov_rad": None}],
)  # fmt: skip
def test_unreadable_description_is_named(tmp_path, values):
    change(write_still(tmp_path / "one"), **values)
    with pytest.raises(InputError, match=r"one.params\.json: cannot be read as a known camera"):
        find_known(tmp_path)


def test_errors_have_signs_and_are_compared_with_the_stated_ones():
    stated = CameraErrors(fov_deg=1.0, pitch_deg=1.0, roll_deg=0.1)
    found = solved(-11.5, 0.4, 42.0, errors=stated, horizon="measured")
    errors = angle_errors(solved(-12.0, 1.0, 40.0), found)
    assert errors["pitch"].error == pytest.approx(0.5)
    # rotation() turns counter-clockwise, and the world's up leans right then
    assert errors["roll"].error == pytest.approx(-0.6)
    assert errors["fov_share"].error == pytest.approx(5.0)
    assert errors["fov_share"].stated == pytest.approx(2.5)
    assert errors["pitch"].summary() == pytest.approx(
        {"all": 0.5, "sure": 0.5, "measured": 100.0, "within": 100.0, "sure_within": 100.0}
    )
    assert errors["fov"].summary() == pytest.approx(
        {"all": 2.0, "sure": math.nan, "measured": 0.0, "within": 0.0, "sure_within": math.nan},
        nan_ok=True,
    )


def test_area_is_that_under_the_recall_curve():
    true = solved(-12.0, 0.0, 40.0)
    errors = [angle_errors(true, solved(-12.0 + e, 0.0, 40.0))["pitch"] for e in (0.5, 2.0, 30.0)]
    at = np.linspace(0.0, 5.0, 100_001)
    curve = np.mean([abs(one.error) <= at for one in errors], axis=0)
    area = np.mean([one.area(5.0) for one in errors])
    assert area == pytest.approx(100.0 * np.trapezoid(curve, at) / 5.0, abs=0.01)
    assert UNSOLVED.area(5.0) == 0.0


def test_vertical_field_of_view_follows_from_the_frames_shape():
    errors = angle_errors(solved(-12.0, 0.0, 90.0), solved(-12.0, 0.0, 100.0))
    expected = 2 * math.degrees(math.atan(math.tan(math.radians(50)) * 512 / 960))
    assert errors["yfov"].true == pytest.approx(2 * math.degrees(math.atan(512 / 960)))
    assert errors["yfov"].true + errors["yfov"].error == pytest.approx(expected)


def test_object_gets_its_coc_under_the_true_camera_whatever_the_scale(still):
    (known,) = find_known(still)
    subject, camera = subject_of(known), known.camera.at(0.0)
    assert coc_rms(subject, exact(known), camera, 0.0) < 0.3
    pose = camera.world_from_camera.copy()
    pose[:3, 3] *= 7.0
    larger = replace(camera, world_from_camera=pose)
    assert coc_rms(subject, exact(known), larger, 0.0) == pytest.approx(
        coc_rms(subject, exact(known), camera, 0.0), abs=0.01
    )


def test_object_under_another_camera_keeps_its_foot_its_height_and_its_uprightness(still):
    (known,) = find_known(still)
    subject, true = subject_of(known), known.camera.at(0.0)
    other = solved(-21.0, 2.0, 61.0, size=(320, 180)).at(0.0)
    triangles, _ = subject.under(other, 0.0)
    corners = triangles.reshape(-1, 3)
    foot = 0.5 * (corners.min(0) + corners.max(0)) * (1.0, 0.0, 1.0)
    pixels = other.pixels(other.to_camera(foot[None]))
    np.testing.assert_allclose(pixels, true.pixels(true.to_camera(subject.foot[None])), atol=1e-6)
    assert corners[:, 1].min() == pytest.approx(0.0, abs=1e-9)
    before = subject.triangles.reshape(-1, 3)
    size = np.ptp(corners[:, 1]) / np.ptp(before[:, 1])
    depth = [-c.to_camera(f[None])[0, 2] for c, f in ((other, foot), (true, subject.foot))]
    assert size * other.fy / depth[0] == pytest.approx(true.fy / depth[1])


def test_wrong_camera_costs_the_object_its_coc(still):
    (known,) = find_known(still)
    subject, true = subject_of(known), known.camera.keys[0]
    lower = solved(true.pitch_deg - 12.0, 0.0, true.fov_x_deg, size=(320, 180)).at(0.0)
    right = coc_rms(subject, exact(known), known.camera.at(0.0), 0.0)
    assert coc_rms(subject, exact(known), lower, 0.0) > 2.0 * right


def test_foot_above_the_solved_horizon_has_no_coc(still):
    (known,) = find_known(still)
    upwards = solved(60.0, 0.0, 40.0, size=(320, 180)).at(0.0)
    assert coc_rms(subject_of(known), exact(known), upwards, 0.0) == math.inf


def test_ground_stands_in_for_a_missing_object(tmp_path):
    folder = write_still(tmp_path / "bare")
    (folder / "object.glb").unlink()
    (known,) = find_known(folder)
    subject = subject_of(known)
    assert len(subject.triangles) == 0 and len(subject.points) > 1000
    np.testing.assert_allclose(subject.points[:, 1], 0.0, atol=1e-6)
    assert coc_rms(subject, exact(known), known.camera.at(0.0), 0.0) < 0.3


def path(drift_deg=0.0, scale=1.0, lift_deg=0.0):
    """A camera that walks and turns; its pan may drift, its world may have another scale."""
    keys = []
    for number in range(5):
        pose = np.eye(4)
        turn = np.radians(2.0 * number + drift_deg * number / 4)
        pose[:3, :3] = rotation(turn, np.radians(-15 + lift_deg), 0.0)
        pose[:3, 3] = scale * np.array([0.1 * number, 1.5, -0.1 * number])
        keys.append(
            CameraKey(
                index=number, pts_s=number / 24, world_to_camera=np.linalg.inv(pose), fov_x_deg=50.0
            )
        )
    return replace(solved(0.0, 0.0, 50.0, path="moving"), keys=tuple(keys))


def clip(tmp_path):
    points = np.array([[x, 0.0, z] for x in (-0.5, 0.5) for z in (-4.0, -6.0)])
    return Known(
        name="walk", folder=tmp_path, plate=tmp_path / "bg.mp4", kind="walk", camera=path(),
        ground_points=points, lens=None,
    )  # fmt: skip


def test_true_path_of_any_scale_follows_the_ground(tmp_path):
    figures = path_figures(clip(tmp_path), path(scale=3.0))
    assert figures["ground_px"] < 1e-6 and figures["worst_px"] < 1e-6
    assert figures["fov_percent"] == pytest.approx(0.0, abs=1e-9)


def test_drift_is_counted_over_all_frames(tmp_path):
    figures = path_figures(clip(tmp_path), path(drift_deg=0.4))
    # near the middle a turn by 0.4 degrees moves a point by 7.2 px; linear: rms 7.2 sqrt(0.375)
    focal = 480 / math.tan(math.radians(25))
    expected = focal * math.radians(0.4) * math.sqrt(0.375)
    assert figures["ground_px"] == pytest.approx(expected, rel=0.1)
    assert figures["worst_px"] > figures["ground_px"]


def test_points_above_the_solved_horizon_are_not_followed(tmp_path):
    assert path_figures(clip(tmp_path), path(lift_deg=40.0)) == {"ground_px": math.inf}

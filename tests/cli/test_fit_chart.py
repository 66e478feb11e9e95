"""`fit --chart`: the lens measured on the edges of markers, against the lens that blurred them."""

import json
import math

import cv2
import numpy as np
import pytest
from support import marker_plates, shots

from nlens_video.cli.main import main
from nlens_video.core.lens_fit import LensFit
from nlens_video.kernels.scatter.scatter import scatter
from nlens_video.scene.camera import Camera
from nlens_video.solve.edge_blur import edge_blurs
from nlens_video.solve.marker_edges import refine

WIDTH, HEIGHT = marker_plates.WIDTH, marker_plates.HEIGHT
SIDE_M = 0.4
AT_TWO_DISTANCES = [(64, 400, 400), (22, 1200, 500)]
FOCAL_PX = 0.5 * HEIGHT / math.tan(0.5 * shots.YFOV)
FOV = math.degrees(2.0 * math.atan(0.5 * WIDTH / FOCAL_PX))


def chart(slope, intercept, places):
    """Markers on the ground as a lens sees them, uint8 sRGB (H, W, 3)."""
    laid = [
        marker_plates.placed(number, SIDE_M, x, z, 12.0) for number, (x, z) in enumerate(places)
    ]
    sharp = marker_plates.plate(laid, shots.camera_pose(), FOV, blur_px=1e-3)
    light = np.repeat(0.9 * (sharp[..., None] / 255.0) + 0.02, 4, axis=2).astype(np.float32)
    light[..., 3] = 1.0
    camera = Camera.from_yfov(shots.camera_pose(), shots.YFOV, WIDTH, HEIGHT)
    coc = slope * np.maximum(camera.plane_disparity(0.0), 0.0) + intercept
    return coded(scatter(light, coc.astype(np.float32))[..., :3])


def coded(light):
    """Scene-linear light as uint8 sRGB."""
    codes = np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.clip(np.round(255 * codes), 0, 255).astype(np.uint8)


def facing_chart(slope, intercept, places):
    """Markers that face the camera: cells [px] and middles (x, y); uint8 sRGB (H, W, 3)."""
    light = np.full((2 * HEIGHT, 2 * WIDTH, 4), (0.8, 0.8, 0.8, 1.0), np.float32)
    coc = np.zeros(light.shape[:2], np.float32)
    names = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_50)
    for number, (cell, x, y) in enumerate(places):
        paper = np.pad(cv2.aruco.generateImageMarker(names, number, 7), 1, constant_values=255)
        drawn = np.kron(0.04 + 0.76 * (paper / 255.0), np.ones((cell, cell)))
        corner = y - len(drawn) // 2, x - len(drawn) // 2
        box = tuple(slice(start, start + len(drawn)) for start in corner)
        light[box][..., :3] = drawn[..., None]
        coc[box] = slope * 7 * cell / (2 * FOCAL_PX * SIDE_M) + intercept
    return coded(scatter(light, coc)[..., :3])


def fitted(tmp_path, rgb, *options):
    plate, kept = shots.write_png(tmp_path / "in.png", rgb), tmp_path / "fit.json"
    glb = shots.cube_glb(tmp_path / "cube.glb")
    code = main(["fit", str(plate), str(glb), str(kept), *options])
    return code, LensFit.load(kept) if code == 0 else None


@pytest.mark.slow
@pytest.mark.parametrize(("slope", "intercept"), [(24.0, -12.0), (30.0, -20.0), (20.0, -2.0)])
def test_lens_is_measured_on_markers_at_several_distances(tmp_path, slope, intercept):
    places = [(-0.35, -1.75), (0.45, -2.0), (-0.5, -2.6), (0.4, -3.0), (-0.6, -3.8)]
    code, fit = fitted(tmp_path, chart(slope, intercept, places), "--chart", f"{SIDE_M}m")
    assert code == 0
    disparity = np.linspace(0.25, 0.6, 5)
    off = np.abs(fit.coc_px(disparity)) - np.abs(slope * disparity + intercept)
    assert np.abs(off).max() < 0.3, (fit.describe(), off)
    assert "parts of markers' edges" in json.loads((tmp_path / "fit.json").read_text())["method"]


@pytest.mark.slow
@pytest.mark.parametrize(("slope", "intercept"), [(75.0, -25.0), (45.0, -30.0), (72.0, -12.0)])
def test_error_that_is_stated_holds_where_edges_are_wider_than_those_of_a_sharp_marker(
    tmp_path, slope, intercept
):
    places = [
        (64, 290, 290), (48, 850, 260), (40, 1310, 240), (28, 1690, 220), (24, 1350, 720),
        (34, 850, 740),
    ]  # fmt: skip
    code, fit = fitted(tmp_path, facing_chart(slope, intercept, places), "--chart", f"{SIDE_M}m")
    assert code == 0
    assert abs(abs(fit.slope) - slope) < 2.5 * fit.slope_stderr, fit.describe()
    assert abs(abs(fit.intercept) + intercept) < 2.5 * fit.intercept_stderr, fit.describe()
    assert fit.slope_stderr < 0.03 * slope


@pytest.mark.slow
def test_markers_at_one_distance_are_refused_unless_the_lens_is_known(tmp_path, capsys):
    slope, intercept = 24.0, -12.0
    rgb = chart(slope, intercept, [(-0.4, -1.75), (0.4, -1.75)])
    options = "--chart", f"{SIDE_M}m"
    assert fitted(tmp_path, rgb, *options)[0] == 5
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "lie at one or two distances only" in line and "three or more distances" in line
    f_number = 50.0 / (1000.0 * slope / FOCAL_PX)
    code, fit = fitted(tmp_path, rgb, *options, "--lens", f"50mm f/{f_number:.4f} focus 2m")
    assert code == 0
    assert (fit.slope, fit.intercept) == pytest.approx((slope, intercept), rel=0.1)


@pytest.mark.slow
def test_markers_at_two_distances_are_refused(tmp_path, capsys):
    assert (
        fitted(tmp_path, facing_chart(80.0, -40.0, AT_TWO_DISTANCES), "--chart", f"{SIDE_M}m")[0]
        == 5
    )
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "one or two distances only, whose blur more than one lens explains" in line
    assert "three or more distances" in line


@pytest.mark.slow
def test_distances_of_markers_that_face_the_camera_hold(tmp_path):
    rgb = facing_chart(80.0, -40.0, AT_TWO_DISTANCES)
    code, fit = fitted(tmp_path, rgb, "--chart", f"{SIDE_M}m", "--lens", "focus 2m")
    assert code == 0
    assert fit.slope == pytest.approx(80.0, abs=3.0 * fit.slope_stderr)
    assert fit.slope_stderr < 1.6


@pytest.mark.slow
def test_lens_that_the_chart_contradicts_is_told_and_one_that_it_confirms_is_not(tmp_path, capsys):
    places = [(-0.35, -1.75), (0.45, -2.0), (-0.5, -2.6), (0.4, -3.0), (-0.6, -3.8)]
    rgb, options = chart(24.0, -12.0, places), ("--chart", f"{SIDE_M}m", "-y", "--lens")
    assert fitted(tmp_path, rgb, *options, "focus 2m")[0] == 0
    assert "note" not in capsys.readouterr().err
    assert fitted(tmp_path, rgb, *options, "focus 4m")[0] == 0
    (note,) = [line for line in capsys.readouterr().err.splitlines() if line.startswith("note")]
    assert "--lens lies" in note and "standard errors from what the plate tells" in note


@pytest.mark.parametrize("option", [("--fit-region", "0,0,1,1"), ("--report", "report")])
def test_options_of_the_ground_are_refused_beside_a_chart(tmp_path, capsys, option):
    code, _ = fitted(tmp_path, shots.plate(), "--chart", "0.2m", *option)
    assert code == 2
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert line.startswith(f"nlens-video: {option[0]}: --chart measures the lens on markers")


@pytest.mark.slow
def test_sharp_markers_at_several_distances_are_a_lens_without_blur(tmp_path):
    places = [(-0.35, -1.75), (0.45, -2.0), (-0.5, -2.6), (0.4, -3.0), (-0.6, -3.8)]
    code, fit = fitted(tmp_path, chart(0.0, 0.0, places), "--chart", f"{SIDE_M}m")
    assert code == 0
    assert np.abs(fit.coc_px(np.linspace(0.25, 0.6, 5))).max() < 1.5


def test_plate_without_markers_is_refused_in_one_line(tmp_path, capsys):
    code, _ = fitted(tmp_path, shots.plate(), "--chart", "0.2m")
    assert code == 5
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "--chart: 0 parts of markers' edges can be measured" in line


def blurred_square(half, diameter):
    """A dark square on light, slanted, under a disc: light (H, W) and corners (4, 2) [px]."""
    sine, cosine = half * math.sin(0.2), half * math.cos(0.2)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) @ [[cosine, sine], [-sine, cosine]]
    corners += 2 * half
    size = 4 * half, 4 * half
    fine = np.full((8 * size[0], 8 * size[1]), 0.8, np.float32)
    cv2.fillConvexPoly(fine, np.int32(np.round((8 * corners - 0.5) * 256)), 0.05, shift=8)
    sharp = np.ones((*size, 4), np.float32)
    sharp[..., :3] = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)[..., None]
    light = scatter(sharp, np.full(size, diameter, np.float32))[..., 0]
    return np.ascontiguousarray(light), corners


@pytest.mark.parametrize("diameter", [0.0, 3.0, 9.0, 16.0, 24.0])
def test_corners_of_a_blurred_square_are_those_of_the_sharp_one(diameter):
    light, corners = blurred_square(140, diameter)
    inside = corners.mean(axis=0)
    begun = inside + (corners - inside) * (1.0 - (0.7 + 0.3 * diameter) / 140.0)
    found = refine(255.0 * light, begun)
    assert (
        np.linalg.norm(found - corners, axis=1).max() < 0.15
    )  # OpenCV draws polygons half a sample larger


@pytest.mark.parametrize("diameter", [0.0, 1.5, 4.0, 9.0])
def test_edge_tells_the_diameter_of_its_disc(diameter):
    blurs = edge_blurs(*blurred_square(80, diameter))
    assert len(blurs.coc_px) == 12
    least = 1.0 if diameter == 0.0 else 0.1  # a sharp edge is as wide as a pixel
    assert np.abs(blurs.coc_px - diameter).max() < least


def test_edge_that_is_blurred_over_the_border_is_left_out():
    light = np.full((320, 320), 0.8, np.float32)
    light[80:240, 80:240] = 0.05
    light = cv2.GaussianBlur(light, (0, 0), 15.0)
    corners = np.array([(80, 80), (240, 80), (240, 240), (80, 240)], np.float64)
    assert len(edge_blurs(light, corners).coc_px) == 0

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

WIDTH, HEIGHT = marker_plates.WIDTH, marker_plates.HEIGHT
SIDE_M = 0.4
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
    blurred = scatter(light, coc.astype(np.float32))[..., :3]
    coded = np.where(blurred < 0.0031308, 12.92 * blurred, 1.055 * blurred ** (1 / 2.4) - 0.055)
    return np.clip(np.round(255 * coded), 0, 255).astype(np.uint8)


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
def test_markers_at_one_distance_are_refused_unless_the_lens_is_known(tmp_path, capsys):
    slope, intercept = 24.0, -12.0
    rgb = chart(slope, intercept, [(-0.4, -1.75), (0.4, -1.75)])
    options = "--chart", f"{SIDE_M}m"
    assert fitted(tmp_path, rgb, *options)[0] == 5
    (line,) = capsys.readouterr().err.strip().splitlines()
    assert "lie at about one distance only" in line and "two or more distances" in line
    f_number = 50.0 / (1000.0 * slope / FOCAL_PX)
    code, fit = fitted(tmp_path, rgb, *options, "--lens", f"50mm f/{f_number:.4f} focus 2m")
    assert code == 0
    assert (fit.slope, fit.intercept) == pytest.approx((slope, intercept), rel=0.1)


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


@pytest.mark.parametrize("diameter", [0.0, 1.5, 4.0, 9.0])
def test_edge_tells_the_diameter_of_its_disc(diameter):
    sine, cosine = 80 * math.sin(0.2), 80 * math.cos(0.2)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) @ [[cosine, sine], [-sine, cosine]]
    corners += 160.0
    fine = np.full((8 * 320, 8 * 320), 0.8, np.float32)
    cv2.fillConvexPoly(fine, np.int32(np.round((8 * corners - 0.5) * 256)), 0.05, shift=8)
    sharp = np.ones((320, 320, 4), np.float32)
    sharp[..., :3] = cv2.resize(fine, (320, 320), interpolation=cv2.INTER_AREA)[..., None]
    light = scatter(sharp, np.full((320, 320), diameter, np.float32))[..., 0]
    blurs = edge_blurs(np.ascontiguousarray(light), corners)
    assert len(blurs.coc_px) == 12
    least = 1.0 if diameter == 0.0 else 0.1  # a sharp edge is as wide as a pixel
    assert np.abs(blurs.coc_px - diameter).max() < least


def test_edge_that_is_blurred_over_the_border_is_left_out():
    light = np.full((320, 320), 0.8, np.float32)
    light[80:240, 80:240] = 0.05
    light = cv2.GaussianBlur(light, (0, 0), 15.0)
    corners = np.array([(80, 80), (240, 80), (240, 240), (80, 240)], np.float64)
    assert len(edge_blurs(light, corners).coc_px) == 0

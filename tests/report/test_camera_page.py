"""The page of a solved camera: complete, self-contained, fit for a phone."""

import re

import numpy as np
import pytest
from msgspec.structs import replace
from support import browser

from nlens_video.cameras.solved import CameraErrors, CameraKey, SolvedCamera
from nlens_video.report.camera import CameraFindings, PlatePicture, camera_page, write_camera_page
from nlens_video.solve.evidence import Reprojection

LOOK = """<!doctype html><body><iframe id="page" src="index.html"
style="width:WIDTHpx;height:900px;border:0"></iframe><script>
addEventListener("load", () => {
  const page = document.getElementById("page").contentDocument;
  const root = page.documentElement;
  document.body.setAttribute("data-seen", JSON.stringify({
    overflow: root.scrollWidth - root.clientWidth,
    wide: [...page.querySelectorAll("img, svg, table, p")]
      .filter(one => one.getBoundingClientRect().right > root.clientWidth + 1)
      .filter(one => !one.closest(".scroll")).map(one => one.outerHTML.slice(0, 80)),
    broken: [...page.images].filter(one => !one.naturalWidth).length,
    pictures: page.images.length,
  }));
});
</script></body>"""


def key(index):
    pose = np.eye(4)
    pitch = np.radians(-15.0)
    pose[1:3, 1:3] = [[np.cos(pitch), -np.sin(pitch)], [np.sin(pitch), np.cos(pitch)]]
    pose[:3, 3] = 0.1 * index, 1.6, -0.05 * index
    return CameraKey(index=index, pts_s=index / 24, world_to_camera=np.linalg.inv(pose),
                     fov_x_deg=50.0)  # fmt: skip


def findings(frames=6, *, tracked=True, lines=True, **more):
    rng = np.random.default_rng(1)
    solved = SolvedCamera(
        width=640, height=360, keys=tuple(key(n) for n in range(frames)), path="moving",
        **{"method": "structure <from> motion", "reprojection_px": 0.41, **more},
    )  # fmt: skip
    count = 40 if tracked else 0
    spots = np.tile(rng.uniform(20, 340, (count, 2)), (frames, 1))
    return CameraFindings(
        plate="/some/where/a <plate>.mp4", output="camera.json", solved=solved,
        pictures=[
            PlatePicture(n, n / 24, rng.integers(0, 255, (180, 320, 3), dtype=np.uint8))
            for n in (0, frames // 2, frames - 1)
        ],
        lines=rng.uniform(10, 350, (5, 2, 2)),
        groups=np.array([0, 1, 1, 2, -1]) if lines else np.full(5, -1),
        tracked=Reprojection(
            np.tile(np.arange(count), frames), np.repeat(np.arange(frames), count), spots,
            rng.uniform(0, 1, len(spots)),
        ),
        frames=list(range(frames)),
    )  # fmt: skip


SURE = {"fov": "measured", "horizon": "measured", "errors": CameraErrors(pitch_deg=0.5)}


@pytest.mark.parametrize(
    ("method", "source"),
    [("straight lines; field of view by --fov 50", "given"), ("straight lines", "from metadata")],
)
def test_page_tells_a_given_field_of_view_from_that_of_metadata(method, source):
    text = camera_page(findings(**{**SURE, "fov": "metadata", "method": method}))
    assert f"<td>{source}</td>" in text


def test_page_shows_values_with_their_source_and_error():
    text = camera_page(findings(**SURE))
    assert "<plate>" not in text and "&lt;plate&gt;" in text
    assert "50.0 \N{PLUS-MINUS SIGN} 20.0 degrees" in text and "measured" in text
    assert "-15.0 \N{PLUS-MINUS SIGN} 0.5 degrees" in text
    assert "0.41 px" in text and "6 frames" in text
    assert text.count("Grid on the ground of frame") == 3
    assert "Camera path from above" in text and "Reprojection error over the frames" in text
    assert not re.search(r'(src|href)="(?!data:|#)', text)


@pytest.mark.parametrize("roll_deg", [-0.01, 0.01])
def test_level_camera_has_no_roll_of_minus_zero(roll_deg):
    turn = np.eye(4)
    c, s = np.cos(np.radians(roll_deg)), np.sin(np.radians(roll_deg))
    turn[:2, :2] = [[c, -s], [s, c]]
    shown = findings(**SURE)
    level = replace(key(0), world_to_camera=turn @ key(0).world_to_camera)
    text = camera_page(replace(shown, solved=replace(shown.solved, keys=(level,))))
    assert "<td>0.0 \N{PLUS-MINUS SIGN}" in text and "-0.0 " not in text


def test_uncertain_camera_is_said_first():
    vague = CameraErrors(fov_deg=20.0, pitch_deg=12.0, roll_deg=3.0)
    text = camera_page(findings(fov="assumed", horizon="assumed", errors=vague))
    lead = re.search(r'class="lead">(.*?)</p>', text).group(1)
    assert "is uncertain" in lead and "12 degrees" in lead and "--horizon" in lead
    assert "is uncertain" not in camera_page(findings(**SURE))


def test_plate_that_tells_nothing_says_so_in_place_of_pictures():
    text = camera_page(findings(tracked=False, lines=False, **SURE))
    assert "Nothing in the plate tells the camera" in text
    assert "No point was tracked over several frames." in text


def test_page_is_the_same_each_time():
    assert camera_page(findings(**SURE)) == camera_page(findings(**SURE))


@pytest.mark.needs_chromium
@pytest.mark.slow
@pytest.mark.parametrize("width", [400, 1200])
def test_page_fits_a_phone_and_a_screen(tmp_path, width):
    write_camera_page(tmp_path, findings(**SURE))
    harness = tmp_path / "look.html"
    harness.write_text(LOOK.replace("WIDTH", str(width)))
    seen = browser.seen(harness)
    assert seen == {"overflow": 0, "wide": [], "broken": 0, "pictures": 5}

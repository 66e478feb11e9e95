"""Objects that stand in each other's shadow are dark there, where that is simulated."""

import cv2
import numpy as np
import pytest
from support import shots
from support.command import nlens
from support.glb_builder import GlbBuilder
from support.quads import material

from nlens_video.core.lens_fit import LensFit

pytestmark = pytest.mark.needs_gl


def box(path, x, size):
    """A white box on the ground two metres ahead, with the shot's camera."""
    builder = GlbBuilder()
    points = shots.CUBE[shots.CUBE_FACES].reshape(-1, 3)
    mesh = builder.mesh(points, range(36), material=material(builder))
    low = float(points[:, 1].min())
    builder.node(mesh=mesh, translation=[x, -low * size[1], -2.0], scale=list(size))
    lens = builder.camera(shots.YFOV)
    builder.node(camera=lens, matrix=shots.camera_pose().T.ravel().tolist())
    return builder.write(path)


@pytest.mark.parametrize(
    ("preset", "effects", "shaded"),
    [
        ("standard", "self-shadow", True),
        ("standard", "shadow", False),
        ("draft", "none", False),
    ],
)
def test_an_object_in_the_shadow_of_another_is_dark(tmp_path, preset, effects, shaded):
    shots.write_png(tmp_path / "plate.png", shots.grey())
    fit = LensFit(slope=0.0, intercept=0.0, width=shots.WIDTH, height=shots.HEIGHT)
    (tmp_path / "fit.json").write_text(fit.to_json())
    box(tmp_path / "tall.glb", -0.45, (0.1, 0.8, 0.1))
    box(tmp_path / "low.glb", 0.2, (0.25, 0.25, 0.25))
    (tmp_path / "shot.toml").write_text(
        'version = 2\n[plate]\nfile = "plate.png"\n'
        '[[object]]\nfile = "tall.glb"\n[[object]]\nfile = "low.glb"\n'
    )
    seen = {}
    for sun in ("-90,35", "90,35"):  # from the tall box's side, and from the other
        out = tmp_path / "out.png"
        done = nlens(
            tmp_path / "shot.toml", out, "--preset", preset, "--effects", effects,
            "--fit", tmp_path / "fit.json", f"--sun={sun},4", "-y", "-q",
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        seen[sun] = cv2.imread(str(out)).astype(float)
    view, top = shots.camera(), 0.25 * np.ptp(shots.CUBE[:, 1])
    x, y = np.floor(view.pixels(view.to_camera(np.array([[0.2, top, -2.0]])))[0]).astype(int)
    lit, behind = (seen[sun][y - 1 : y + 2, x - 4 : x + 5].mean() for sun in ("90,35", "-90,35"))
    assert (behind < 0.75 * lit) == shaded

"""An object that is out of focus enters and leaves the frame, and so do its blur and its shadow."""

import json

import av
import numpy as np
import pytest
from support import shots
from support.command import nlens

FRAMES = 24
WAYS = {
    "in from the left": ((-1.8, 0.0, -1.2), (-0.4, 0.0, -1.2)),
    "out to the right": ((0.4, 0.0, -1.2), (1.8, 0.0, -1.2)),
    "in from above": ((0.1, 1.6, -1.3), (0.1, 0.3, -1.3)),
    "past the camera": ((0.3, 0.0, -2.0), (0.3, 0.0, 0.5)),
}


def frames(path):
    with av.open(str(path)) as container:
        return [frame.to_ndarray() for frame in container.decode(video=0)]


@pytest.mark.parametrize("sun", ["none", "90,30"])
@pytest.mark.parametrize("aperture", [1, 4])
@pytest.mark.parametrize("way", WAYS)
def test_object_out_of_focus_crosses_the_border(way, aperture, sun, tmp_path):
    start, end = WAYS[way]
    plate = shots.write_video(tmp_path / "in.mkv", FRAMES, codec="ffv1", audio=False)
    way_s = FRAMES / 25
    glb = shots.cube_glb(tmp_path / "anim.glb", start=start, end=end, seconds=way_s, sun=False)
    lens = {"slope": aperture * shots.SLOPE, "intercept": aperture * shots.INTERCEPT}
    fit, out = tmp_path / "fit.json", tmp_path / "out.mkv"
    fit.write_text(json.dumps(lens | {"width": shots.WIDTH, "height": shots.HEIGHT}))
    run = nlens(plate, glb, out, "--fit", fit, "--sun", sun, "-q")
    assert run.returncode == 0, run.stderr
    changed = [(a != b).any() for a, b in zip(frames(plate), frames(out), strict=True)]
    assert any(changed) and not all(changed)
    shown = np.flatnonzero(changed)
    assert len(shown) == shown[-1] - shown[0] + 1  # one passage, without gaps

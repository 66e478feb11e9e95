"""A plate whose pixels are not square is solved as it is displayed."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from support import marker_plates as plates

from nlens_video.cli.plate_solver import solve_plate
from nlens_video.core.scale import ScaleSettings
from nlens_video.core.settings import SourceSettings
from nlens_video.report.camera import PlatePicture
from nlens_video.report.findings import EvenPick

pytestmark = pytest.mark.slow
FOV_DEG, PITCH_DEG, HEIGHT_M = 50.0, -24.0, 1.5
MARKERS = [
    plates.placed(number, 0.4, x, z, 12.0 * number)
    for number, (x, z) in enumerate([(-0.7, -2.8), (0.6, -2.7), (-0.4, -3.6), (0.8, -4.0)])
]


def clip(path, stored, aspect):
    """Two frames of a plate that is displayed as 960x512, at a stored size."""
    camera = plates.pose(PITCH_DEG, 1.0, HEIGHT_M)
    gray = cv2.resize(plates.plate(MARKERS, camera, FOV_DEG), stored, interpolation=cv2.INTER_AREA)
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", 25, {"qp": "4"})
        (stream.width, stream.height), stream.pix_fmt = stored, "yuv420p"
        stream.codec_context.sample_aspect_ratio = aspect
        for _ in range(2):
            frame = av.VideoFrame.from_ndarray(gray, "gray").reformat(format="yuv420p")
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path


@pytest.mark.parametrize(
    ("stored", "aspect"), [((640, 512), Fraction(3, 2)), ((960, 384), Fraction(3, 4))]
)
def test_camera_of_a_plate_with_wide_or_high_pixels_is_that_of_the_displayed_one(
    tmp_path, stored, aspect
):
    source = SourceSettings(spec=str(clip(tmp_path / "plate.mov", stored, aspect)))
    pictures: EvenPick[PlatePicture] = EvenPick(4)
    found = solve_plate(
        source, ScaleSettings(marker_m=0.4), None, 0, lambda done, total: None, pictures, ("lines",)
    )
    camera, key = found.camera, found.camera.keys[0]
    assert (camera.width, camera.height, camera.pixel_aspect) == (*stored, float(aspect))
    assert key.fov_x_deg == pytest.approx(FOV_DEG, rel=0.02)
    assert key.pitch_deg == pytest.approx(PITCH_DEG, abs=0.3)
    assert key.world_from_camera[1, 3] == pytest.approx(HEIGHT_M, rel=0.01)
    # lines lie in a frame with the plate's pixels, over its pictures
    assert found.solver.size[0] / found.solver.size[1] == pytest.approx(
        stored[0] / stored[1], rel=0.01
    )
    ends = found.solver.segments.ends / found.solver.size
    assert len(ends) > 8 and 0.4 < ends[..., 1].max() <= 1.0
    assert np.ptp(ends[..., 0]) > 0.3

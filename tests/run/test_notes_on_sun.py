"""What was read of the sun is told where a shadow is drawn, and only there."""

import pytest
from support import shots

from nlens_video.cli.main import main
from nlens_video.graph.nodes.plate_light import EstimateLight

pytestmark = [pytest.mark.slow, pytest.mark.needs_gl]
NOTE = "shadows on the plate tell a sun"


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (["--effects", "shadow"], True),
        (["--effects", "defocus,occlusion"], False),
        (["--preset", "draft"], False),
    ],
)
def test_sun_is_told_where_a_shadow_is_drawn(tmp_path, capsys, monkeypatch, more, told):
    monkeypatch.setattr(EstimateLight, "notes", property(lambda node: (NOTE,)))
    shots.write_shot(tmp_path, 3, still=False)
    words = [
        *(str(tmp_path / name) for name in ("in.mp4", "anim.glb", "out.mp4")),
        "--fit", str(tmp_path / "fit.json"), "--no-progress",
    ]  # fmt: skip
    assert main([*words, *more]) == 0
    shown = capsys.readouterr().err
    assert (NOTE in shown) == told
    assert "the plate's own light" in shown

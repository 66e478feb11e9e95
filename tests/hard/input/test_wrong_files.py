"""Every type of file in the place of every other is read or refused in one line."""

import contextlib
import io
import shutil

import av
import numpy as np
import pytest
from support import shots
from support.clips import write_clip
from support.folders import ROOT

from nlens_video.cli.main import main
from nlens_video.video.exr import write_layers

pytestmark = pytest.mark.needs_gl
PIPELINES = ROOT / "pipelines"
KINDS = (
    "in.mp4", "plate.png", "layers.exr", "anim.glb", "fit.json", "pipeline.toml", "sky.hdr",
    "empty", "headers.mkv", "text", "folder",
)  # fmt: skip
ROLES = ("IN", "ANIM", "--fit", "--layers", "--env", "--holdout", "--preset")


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("kinds")
    shots.write_video(folder / "in.mp4", 2)
    shots.write_png(folder / "plate.png")
    shots.cube_glb(folder / "anim.glb")
    shots.fit_json(folder / "fit.json")
    size = (shots.HEIGHT, shots.WIDTH)
    write_layers(folder / "layers.exr", {name: np.ones(size, np.float32) for name in "RGBAZ"})
    shutil.copy(PIPELINES / "draft.toml", folder / "pipeline.toml")
    (folder / "sky.hdr").write_bytes(
        b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\n\n-Y 4 +X 8\n" + bytes([90, 90, 90, 128]) * 32
    )
    (folder / "empty").write_bytes(b"")
    whole = write_clip(
        folder / "whole.mkv", [av.VideoFrame(64, 48, "yuv420p") for _ in range(2)], codec="ffv1"
    ).read_bytes()
    (folder / "headers.mkv").write_bytes(whole[: whole.index(b"\x1f\x43\xb6\x75")])  # no cluster
    (folder / "text").write_text("neither a picture nor a scene\n" * 99)
    (folder / "folder").mkdir()
    return folder


def command(files, role, given, out):
    words = {"IN": files / "plate.png", "ANIM": files / "anim.glb", "--fit": files / "fit.json"}
    words[role] = given
    options = [str(word) for name in words if name[0] == "-" for word in (name, words[name])]
    return [str(words["IN"]), str(words["ANIM"]), str(out), "--preset", "draft", "-q", *options]


@pytest.mark.parametrize("role", ROLES)
@pytest.mark.parametrize("extension", ["its own", "the one expected"])
def test_file_of_another_type_is_read_or_refused_in_one_line(files, tmp_path, role, extension):
    expected = {
        "IN": ".mp4", "ANIM": ".glb", "--fit": ".json", "--layers": ".exr", "--env": ".hdr",
        "--holdout": ".png", "--preset": ".toml",
    }[role]  # fmt: skip
    codes = {}
    for kind in KINDS:
        given = files / kind
        if extension == "the one expected" and given.is_file():
            given = tmp_path / f"{kind.replace('.', '_')}{expected}"
            given.write_bytes((files / kind).read_bytes())
        before = {path: path.stat().st_mtime_ns for path in files.iterdir()}
        said, out = io.StringIO(), tmp_path / "out.png"
        with contextlib.redirect_stderr(said):
            codes[kind] = main(command(files, role, given, out))
        text = said.getvalue()
        assert codes[kind] in (0, 2, 3, 4, 5, 6), (kind, text)
        if codes[kind]:
            assert text.startswith("nlens-video: ") and text.count("\n") == 1, (kind, text)
        assert out.exists() == (codes[kind] == 0), (kind, text)
        out.unlink(missing_ok=True)
        assert {path: path.stat().st_mtime_ns for path in files.iterdir()} == before
    assert len(set(codes.values())) > 1  # what belongs there is taken, other things are not

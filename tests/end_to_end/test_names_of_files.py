"""Names of files as FFmpeg has them: `file:` in front says that a path is meant."""

import pytest
from support.command import nlens
from support.shots import cube_glb, fit_json, write_video


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder to work in, with a plate, a scene and a fit."""
    write_video(tmp_path / "p.mp4", frames=3)
    cube_glb(tmp_path / "a.glb")
    fit_json(tmp_path / "fit.json")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize("prefix", ["file:", "file://{here}/"])
def test_file_prefix_is_not_part_of_the_name(folder, prefix):
    start = prefix.format(here=folder)
    run = nlens(
        f"{start}p.mp4", f"{start}a.glb", f"{start}out.mp4", "--fit", f"{start}fit.json",
        "--preset", "draft",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert sorted(one.name for one in folder.iterdir()) == [
        "a.glb", "fit.json", "out.mp4", "p.mp4",
    ]  # fmt: skip


def test_existing_file_with_the_prefix_in_its_name_is_opened(folder):
    (folder / "p.mp4").rename(folder / "file:p.mp4")
    run = nlens("file:p.mp4", "a.glb", "out.mp4", "--fit", "fit.json", "--preset", "draft")
    assert run.returncode == 0, run.stderr

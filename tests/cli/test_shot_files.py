"""Shot files on the command line: saved, rendered, guarded like any file that is read."""

import json
import re

import pytest
from support import shots
from support.command import nlens, one_line
from support.documents import ROOT

from nlens_video.cli.farm_commands import read_shot_list
from nlens_video.cli.main import main
from nlens_video.farm.job import absolute
from nlens_video.options.parser import parse
from nlens_video.options.shot_file import TABLES
from nlens_video.options.to_settings import settings


@pytest.fixture
def still(tmp_path):
    """The words of a quick run, in a folder of its own."""
    plate = shots.write_png(tmp_path / "in.png", shots.plate())
    glb = shots.cube_glb(tmp_path / "anim.glb")
    return [str(plate), str(glb), str(tmp_path / "out.png"), "--fit"] + [
        str(shots.fit_json(tmp_path / "fit.json")), "--preset", "draft", "-q",
    ]  # fmt: skip


@pytest.mark.slow
def test_saved_shot_file_renders_the_same_picture(still, tmp_path, monkeypatch):
    kept = tmp_path / "shot.toml"
    assert main([*still, "--save-shot", str(kept)]) == 0
    first = (tmp_path / "out.png").read_bytes()
    (tmp_path / "out.png").unlink()
    monkeypatch.chdir("/")
    assert main([str(kept), "-q"]) == 0
    assert (tmp_path / "out.png").read_bytes() == first


@pytest.mark.slow
def test_plan_saves_the_shot_and_renders_nothing(still, tmp_path, capsys):
    kept = tmp_path / "shot.toml"
    assert main([*still, "--plan", "--json", "--save-shot", str(kept)]) == 0
    assert json.loads(capsys.readouterr().out)
    assert kept.exists() and not (tmp_path / "out.png").exists()


def test_shot_file_is_not_written_over(still, tmp_path):
    kept = tmp_path / "shot.toml"
    kept.write_text('version = 1\n[plate]\nfile="in.png"\n[object]\nfile="anim.glb"\n'
                    '[output]\nfile="out.png"\n')  # fmt: skip
    before = kept.read_text()
    said = one_line(nlens(str(kept), "--save-shot", str(kept), "--plan", "-y"), 6)
    assert "is the shot file as well" in said
    assert kept.read_text() == before


@pytest.fixture
def finished(still, tmp_path):
    """A shot file whose result is there."""
    kept = tmp_path / "shot.toml"
    kept.write_text('version = 1\n[plate]\nfile="in.png"\n[object]\nfile="anim.glb"\n[lens]\n'
                    'fit="fit.json"\n[quality]\npreset="draft"\n[output]\nfile="out.png"\n'
                    )  # fmt: skip
    (tmp_path / "out.png").write_bytes(b"the finished picture")
    return kept


@pytest.mark.parametrize("words", [["--frame", "0"], ["--range", "0:1", "--device", "cpu"]])
def test_finished_result_of_a_shot_is_not_replaced_by_a_part_of_it(finished, tmp_path, words):
    said = one_line(nlens(finished, *words, "-q"), 2)
    assert f"give the part another OUT, nlens-video {finished} OUT, or --overwrite" in said
    assert (tmp_path / "out.png").read_bytes() == b"the finished picture"
    assert nlens(finished, *words, "-q", "--plan").returncode == 0


def test_part_of_a_shot_goes_where_it_is_told(finished, tmp_path):
    assert nlens(finished, tmp_path / "look.png", "--frame", "0", "-q").returncode == 0
    assert (tmp_path / "look.png").stat().st_size > 1000
    assert (tmp_path / "out.png").read_bytes() == b"the finished picture"
    assert nlens(finished, "--frame", "0", "-q", "--overwrite").returncode == 0
    assert (tmp_path / "out.png").read_bytes() == (tmp_path / "look.png").read_bytes()


def test_whole_shot_may_be_rendered_again_by_a_script(finished, tmp_path):
    assert nlens(finished, "-q").returncode == 0
    assert (tmp_path / "out.png").stat().st_size > 1000


def test_shot_file_that_cannot_be_written_is_told(still, tmp_path):
    said = one_line(nlens(*still, "--save-shot", str(tmp_path / "none" / "a.toml")), 6)
    assert "does not exist; make it first" in said
    assert not (tmp_path / "out.png").exists()


def test_list_of_shots_takes_shot_files(still, tmp_path):
    kept, listed = tmp_path / "a.toml", tmp_path / "jobs.toml"
    kept.write_text('version = 1\n[plate]\nfile="in.png"\n[object]\nfile="anim.glb"\n'
                    '[output]\nfile="out.png"\n')  # fmt: skip
    listed.write_text(f'[[shot]]\nshot = "{kept}"\noptions = ["--preset", "realtime"]\n')
    (run,) = read_shot_list(listed)
    assert (run.source.spec, run.preset) == (str(tmp_path / "in.png"), "realtime")


def test_list_of_shots_takes_shots_of_several_objects(still, tmp_path, monkeypatch):
    kept, listed = tmp_path / "a.toml", tmp_path / "jobs.toml"
    kept.write_text('version = 2\n[plate]\nfile="in.png"\n[[object]]\nfile="anim.glb"\n'
                    '[[object]]\nfile="anim.glb"\n[output]\nfile="out.png"\n')  # fmt: skip
    monkeypatch.chdir(tmp_path)
    listed.write_text('[[shot]]\nshot = "a.toml"\n')
    (run,) = read_shot_list(listed)
    (other,) = absolute(run).scene.others
    assert other.glb == tmp_path / "anim.glb"


def test_shot_files_on_their_page_can_be_read(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "shots.md").read_text()
    blocks = re.findall(r"^```toml\n(.*?)^```", text, re.M | re.S)
    assert len(blocks) == 2
    for block in blocks:
        (tmp_path / "shot.toml").write_text(block)
        settings(parse(["shot.toml"]))


def test_page_about_shot_files_shows_every_table():
    text = (ROOT / "docs" / "shots.md").read_text()
    assert all(f"[{table}]" in text for table in TABLES)

"""Where the files of a local Ray lie: the path of a socket among them has a limit."""

from pathlib import Path

import pytest

from nlens_video.core.errors import OutputError
from nlens_video.farm import ray_folder


@pytest.fixture
def long(tmp_path, monkeypatch):
    """A temporary folder with a path too long for a socket."""
    folder = tmp_path / ("long" * 30)
    folder.mkdir()
    monkeypatch.delenv("RAY_TMPDIR", raising=False)
    monkeypatch.setenv("TMPDIR", str(folder))
    return folder


@pytest.mark.parametrize("variable", ["RAY_TMPDIR", "TMPDIR"])
def test_short_temporary_folder_is_left_to_ray(monkeypatch, long, variable):
    if variable == "TMPDIR":
        monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv(variable, "/tmp/mine")
    with ray_folder.ray_folder(local=True) as folder:
        assert folder is None


@pytest.mark.parametrize("variable", ["RAY_TMPDIR", "TMPDIR"])
def test_ray_has_a_short_folder_while_it_runs_where_the_path_is_too_long(
    monkeypatch, long, variable
):
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setenv(variable, str(long))
    with ray_folder.ray_folder(local=True) as folder:
        there = Path(folder)
        assert there.is_dir() and len(folder) < 30
        (there / "session").mkdir()
    assert not there.exists()


@pytest.mark.parametrize(("excess", "own"), [(0, True), (1, False)])
def test_longest_path_that_ray_takes_is_left_to_it(monkeypatch, long, excess, own):
    monkeypatch.setattr("sys.platform", "linux")
    socket = "/ray/session_2026-11-22_18-24-27_123456_1234567/sockets/plasma_store.1"
    most = ray_folder._MOST_BYTES - len(socket) + excess
    monkeypatch.setenv("TMPDIR", "/" + "x" * (most - 1))
    with ray_folder.ray_folder(local=True) as folder:
        assert (folder is None) is own


def test_long_path_without_a_short_folder_is_refused_in_one_line(monkeypatch, long):
    monkeypatch.setattr("sys.platform", "linux")
    monkeypatch.setattr(ray_folder, "_SHORT", str(long / "missing"))
    with (
        pytest.raises(OutputError, match="set RAY_TMPDIR to a folder") as raised,
        ray_folder.ray_folder(local=True),
    ):
        pass
    assert "\n" not in str(raised.value) and str(long) in str(raised.value)

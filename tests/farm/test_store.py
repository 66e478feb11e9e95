"""Chunks in a store that fsspec opens: there whole or not at all, the bits those of a folder."""

import os
import subprocess
import sys

import fsspec
import pytest
from support import shots

from nlens_video.cli.main import main
from nlens_video.core.errors import InputError, OutputError, UsageError
from nlens_video.farm.job import absolute
from nlens_video.farm.store import Bucket, Folder, store_of
from nlens_video.farm.tasks import Progress, Shot, plan
from nlens_video.farm.worker import Worker
from nlens_video.options.parser import parse
from nlens_video.options.to_settings import settings

FRAMES = 12


@pytest.fixture(autouse=True)
def own_temporaries(tmp_path_factory, monkeypatch):
    """Local copies of a URL's files lie in a folder of the test."""
    folder = tmp_path_factory.mktemp("local")
    monkeypatch.setenv("TMPDIR", str(folder))
    monkeypatch.setattr("tempfile.tempdir", None)
    return folder


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    slide = {"start": (-0.2, 0, -1.6), "end": (0.3, 0, -1.5), "seconds": 0.4}
    return shots.write_shot(tmp_path_factory.mktemp("store"), FRAMES, fit=False, **slide)


def arguments(shot, out):
    given = [str(shot / "in.mp4"), str(shot / "anim.glb"), str(out)]
    return [*given, "--preset", "realtime", "--codec", "ffv1"]


@pytest.fixture(scope="module")
def whole(shot):
    assert main([*arguments(shot, shot / "whole.mkv"), "-q"]) == 0
    return shots.read_planes(shot / "whole.mkv")


def urls(folder):
    """A file server, where a file grows as it is written, and an object store."""
    return (f"file://{folder}/of url", f"memory://{folder.name}/shot")


@pytest.mark.parametrize("which", [0, 1])
def test_stored_file_can_be_fetched_and_removed(which, tmp_path):
    store = store_of(urls(tmp_path)[which])
    assert isinstance(store, Bucket)
    with store.held():
        assert not store.has("fit-0123456789abcdef.json")
        assert not store.existing(["fit-0123456789abcdef.json"])
        (store.local / "fit-0123456789abcdef.json").write_text("{}")
        store.put("fit-0123456789abcdef.json")
        assert store.has("fit-0123456789abcdef.json")
        assert not (store.local / "fit-0123456789abcdef.json").exists()
        fetched = store.fetch("fit-0123456789abcdef.json")
        assert fetched.read_text() == "{}"
        assert store.fetch("fit-0123456789abcdef.json") == fetched
        store.forget(fetched.name)
        assert not fetched.exists() and store.has(fetched.name)
        assert store.existing([fetched.name, "fit-00000000deadbeef.json"]) == {fetched.name}
    files, folder = fsspec.core.url_to_fs(store.url)
    assert [path.rsplit("/", 1)[-1] for path in files.ls(folder, detail=False)] == [fetched.name]
    files.pipe_file(f"{folder}/keep.txt", b"mine")
    store.clear()
    assert [path.rsplit("/", 1)[-1] for path in files.ls(folder, detail=False)] == ["keep.txt"]
    assert not store.local.exists()


def test_chunk_folder_that_is_a_file_is_refused_in_one_line(tmp_path):
    file = tmp_path / "out.mp4"
    file.write_bytes(b"mine")
    words = "out.mp4: is a file; name a folder for the chunks$"
    with pytest.raises(OutputError, match=words), Folder(file).held():
        pass
    assert file.read_bytes() == b"mine"


def test_folder_that_stays_empty_is_removed_unless_it_was_there_before(tmp_path):
    made, there, filled = tmp_path / "made", tmp_path / "there", tmp_path / "filled"
    there.mkdir()
    for folder in (made, there, filled):
        with Folder(folder).held():
            if folder == filled:
                (folder / "0123456789abcdef-00000000-00000002.nut").touch()
    assert sorted(tmp_path.iterdir()) == [filled, there]


def test_plain_path_is_a_folder_store(tmp_path):
    assert store_of(str(tmp_path)) == Folder(tmp_path)


def test_truncated_chunk_file_does_not_count_as_present(tmp_path):
    name = f"{'0' * 16}-00000000-00000010.nut"
    (tmp_path / name).write_bytes(b"cut short")
    assert not Folder(tmp_path).has(name)


@pytest.mark.slow
@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.needs_gl
def test_farm_through_a_url_equals_the_single_run_and_leaves_no_local_files(
    which, shot, whole, tmp_path, own_temporaries
):
    """The farm's own tasks, done one after the other by one worker in this process."""
    url = urls(tmp_path)[which]
    run = absolute(settings(parse(["farm", *arguments(shot, tmp_path / "out.mkv")])))
    asked = plan(Shot(settings=run, store=store_of(url), chunk_s=0.2), Progress(1, lambda *a: None))
    bench, answers = Worker(), None
    with store_of(url).held():
        while True:
            try:
                tasks = asked.send(answers)
            except StopIteration as end:
                merged = end.value
                break
            answers = [task.work(bench, *task.arguments) for task in tasks]
    assert (merged.frames, merged.chunks) == (FRAMES, 3)
    shots.assert_same_frames(shots.read_planes(tmp_path / "out.mkv"), whole)
    files, folder = fsspec.core.url_to_fs(url)
    assert len(files.ls(folder)) == 5  # three chunks, the fit, and what moves in front
    assert not [path for path in own_temporaries.rglob("*.nut")]


@pytest.mark.slow
@pytest.mark.needs_gl
def test_farm_of_two_processes_sharing_a_url_equals_the_single_run(
    shot, whole, tmp_path, own_temporaries
):
    """Its temporary folder's path is longer than that of a socket may be."""
    temporaries = own_temporaries / ("long" * 30)
    temporaries.mkdir()
    command = [sys.executable, "-m", "nlens_video", "farm", *arguments(shot, tmp_path / "out.mkv")]
    command += ["--workers", "2", "--chunk", "0.12", "--chunks", f"file://{tmp_path}/url", "-q"]
    environment = {**os.environ, "TMPDIR": str(temporaries)}
    ran = subprocess.run(command, capture_output=True, text=True, timeout=200, env=environment)
    assert ran.returncode == 0, ran.stderr
    shots.assert_same_frames(shots.read_planes(tmp_path / "out.mkv"), whole)
    assert len(list((tmp_path / "url").glob("*.nut"))) == 4


def test_unusable_store_url_is_refused_in_one_line(tmp_path):
    for url, kind, says in (
        ("nosuch://x/y", UsageError, "nosuch"),
        (f"file://{tmp_path}/a file/b", OutputError, "cannot be made"),
    ):
        (tmp_path / "a file").write_text("")
        with pytest.raises(kind, match=says) as raised, store_of(url).held():
            pass
        assert "\n" not in str(raised.value) and url in str(raised.value)
    store = store_of("memory://empty")
    with pytest.raises(InputError, match="cannot be read"):
        store.fetch("gone.nut")

"""A run that stays open from chunk to chunk, and a merge that follows it, change no bit."""

import threading
import time
from contextlib import closing

import pytest
from msgspec.structs import replace
from support import shots

from nlens_video.cli.main import main
from nlens_video.core.errors import InputError, OutputError, UsageError
from nlens_video.farm.chunk import mark_of
from nlens_video.farm.merge import merge, merge_arriving
from nlens_video.farm.store import Bucket, Folder
from nlens_video.farm.worker import PersistentRun, Worker
from nlens_video.options.parser import parse
from nlens_video.options.to_settings import settings

FRAMES = 14


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    slide = {"start": (-0.2, 0, -1.6), "end": (0.3, 0, -1.5), "seconds": 0.5}
    return shots.write_shot(tmp_path_factory.mktemp("open"), FRAMES, **slide)


def arguments(shot, out):
    given = [str(shot / "in.mp4"), str(shot / "anim.glb"), str(out), "--codec", "ffv1"]
    return [*given, "--fit", str(shot / "fit.json")]


@pytest.fixture(scope="module")
def run(shot):
    return settings(parse(["farm", *arguments(shot, shot / "out.mkv")]))


@pytest.fixture(scope="module")
def whole(shot):
    assert main([*arguments(shot, shot / "whole.mkv"), "-q"]) == 0
    return shots.read_planes(shot / "whole.mkv")


def marks(run, *spans):
    known = mark_of(run)
    return [replace(known, first=first, end=end) for first, end in spans]


@pytest.mark.slow
@pytest.mark.needs_gl
def test_alternating_chunks_of_two_open_runs_equal_the_single_run(shot, run, whole, tmp_path):
    """Two workers take turns, so each passes over what the other renders; one chunk has pieces."""
    first, second = PersistentRun(run, Folder(tmp_path)), PersistentRun(run, Folder(tmp_path))
    parts = marks(run, (0, 3), (3, 7), (7, 8), (8, 9), (9, 11), (11, 13), (13, 20))
    chunks = (parts[:1], parts[1:2], parts[2:3], parts[3:6], parts[6:])
    for chunk, worker in zip(chunks, (first, second, first, second, first), strict=True):
        assert worker.accepts(run, Folder(tmp_path), chunk[0])
        worker.render(chunk)
        assert all((tmp_path / mark.file_name).is_file() for mark in chunk)
    assert not first.accepts(run, Folder(tmp_path), parts[1])  # behind it
    assert not second.accepts(replace(run, preset="draft"), Folder(tmp_path), parts[6])  # other
    first.close()
    second.close()
    merge(run.source, [tmp_path], run.output)
    shots.assert_same_frames(shots.read_planes(shot / "out.mkv"), whole)


@pytest.mark.slow
@pytest.mark.needs_gl
def test_worker_keeps_its_run_open_and_restarts_for_an_earlier_chunk(run, tmp_path):
    chunk_worker = Worker()
    late, early, missing = marks(run, (5, 7), (2, 4), (40, 50))
    before = threading.active_count()
    chunk_worker.chunk(run, None, (late,), Folder(tmp_path))
    chunk_worker.chunk(run, None, (early, late), Folder(tmp_path))  # of which one is there
    assert sorted(path.name for path in tmp_path.iterdir()) == [early.file_name, late.file_name]
    with pytest.raises(UsageError, match="ends before frame 40"):
        chunk_worker.chunk(run, None, (missing,), Folder(tmp_path))
    chunk_worker.prepare(run, Folder(tmp_path), 1.0)  # something else: the run is closed
    assert threading.active_count() == before


@pytest.mark.needs_gl
def test_error_of_an_open_run_reaches_the_caller_that_waits_for_a_chunk(run, tmp_path):
    (mark,) = marks(run, (0, 3))
    broken = replace(run, source=replace(run.source, spec=str(tmp_path / "gone.mp4")))
    worker = PersistentRun(broken, Folder(tmp_path))
    with pytest.raises(InputError, match="no such file"):
        worker.render([mark])
    assert not worker.accepts(broken, Folder(tmp_path), mark)
    worker.close()


class Full(Folder, frozen=True):
    """A folder that takes nothing."""

    def put(self, name):
        raise OutputError("no space left")


@pytest.mark.needs_gl
def test_rendering_of_a_chunk_stops_if_a_piece_cannot_be_stored(run, tmp_path):
    pieces = marks(run, *((first, first + 1) for first in range(14)))
    worker = PersistentRun(run, Full(tmp_path))
    with pytest.raises(OutputError, match="no space"):
        worker.render(pieces)
    assert not worker.accepts(run, Full(tmp_path), pieces[-1])
    worker.close()
    assert len(list(tmp_path.glob("[!.]*.nut"))) < len(pieces)


@pytest.mark.slow
@pytest.mark.needs_gl
def test_merge_proceeds_while_chunks_are_still_being_rendered(shot, run, whole, tmp_path):
    parts = marks(run, (0, 6), (6, 10), (10, 14))
    output = replace(run.output, spec=str(tmp_path / "followed.mkv"))
    looks = []
    merging = threading.Thread(
        target=merge_arriving,
        args=(run.source, parts, Folder(tmp_path), output, lambda: looks.append(time.monotonic())),
    )
    merging.start()
    chunk_worker = Worker()
    for mark in parts[::-1]:
        assert merging.is_alive() and not (tmp_path / "followed.mkv").exists()
        chunk_worker.chunk(run, None, (mark,), Folder(tmp_path))
    chunk_worker.prepare(run, Folder(tmp_path), 1.0)
    merging.join(60)
    assert looks and not merging.is_alive()
    shots.assert_same_frames(shots.read_planes(tmp_path / "followed.mkv"), whole)


@pytest.mark.needs_gl
def test_cancelled_merge_leaves_no_file(run, tmp_path):
    parts = marks(run, (0, 2), (2, 14))
    with closing(Worker()) as chunk_worker:
        chunk_worker.chunk(run, None, (parts[0],), Folder(tmp_path))
    output = replace(run.output, spec=str(tmp_path / "never.mkv"))
    looked = []

    def look():
        looked.append(1)
        if len(looked) > 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        merge_arriving(run.source, parts, Folder(tmp_path), output, look)
    assert [path.name for path in tmp_path.iterdir()] == [parts[0].file_name]


@pytest.mark.needs_gl
def test_merge_refuses_a_file_whose_content_does_not_match_its_name(run, tmp_path):
    one, other = marks(run, (0, 2), (2, 14))
    with closing(Worker()) as chunk_worker:
        chunk_worker.chunk(run, None, (one,), Folder(tmp_path))
    (tmp_path / other.file_name).write_bytes((tmp_path / one.file_name).read_bytes())
    assert not Folder(tmp_path).has(other.file_name)  # there it would be rendered again
    output = replace(run.output, spec=str(tmp_path / "never.mkv"))
    with pytest.raises(InputError, match="is not the chunk that its name says"):
        merge_arriving(run.source, [one, other], Bucket(f"file://{tmp_path}"), output, lambda: None)

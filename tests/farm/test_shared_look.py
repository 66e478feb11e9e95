"""What moves before the object is looked for once, by whoever renders parts of a shot."""

import cv2
import numpy as np
import pytest
from support import shots

from nlens_video.cli.main import main
from nlens_video.farm.chunk import look_once, mark_of, with_stored_look
from nlens_video.farm.job import run_job
from nlens_video.farm.merge import merge
from nlens_video.farm.store import Folder
from nlens_video.graph import occlusion_source
from nlens_video.options.parser import parse
from nlens_video.options.to_settings import settings
from nlens_video.run import foreground_pass

pytestmark = [pytest.mark.slow, pytest.mark.needs_gl]
FRAMES, RATE = 24, 12


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    """A plate over which a card walks before a cube."""
    folder = tmp_path_factory.mktemp("walk")
    rng = np.random.default_rng(0)
    for index in range(FRAMES):
        rgb = shots.plate()
        rgb[60:240, 10 + 18 * index : 60 + 18 * index] = (200, 30, 40)
        grain = rng.normal(0, 1, rgb.shape)
        codes = np.clip(rgb + grain, 0, 255).astype(np.uint8)
        assert cv2.imwrite(str(folder / f"{index:03d}.png"), codes[..., ::-1])
    shots.fit_json(folder / "fit.json")
    shots.cube_glb(folder / "cube.glb", start=(0.0, 0.0, -2.2), size=0.4)
    return folder


def arguments(shot, out, *more):
    given = [str(shot / "%03d.png"), str(shot / "cube.glb"), *([str(out)] if out else [])]
    given += ["--input-rate", str(RATE), "--fit", str(shot / "fit.json"), "--preset", "realtime"]
    return [*given, "--effects", "defocus,occlusion", *more]


@pytest.fixture(scope="module")
def whole(shot):
    assert main([*arguments(shot, shot / "whole.mkv"), "--codec", "ffv1", "-q"]) == 0
    return shot / "whole.mkv"


@pytest.fixture
def looks(monkeypatch):
    """Counts looks at the whole shot."""
    counted = []
    real = occlusion_source.find_moving_foreground

    def look(*given):
        found = real(*given)
        counted.append(found[1])
        return found

    for module in (occlusion_source, foreground_pass):
        monkeypatch.setattr(module, "find_moving_foreground", look)
    return counted


def test_a_resumable_run_looks_once_and_equals_the_single_run(shot, whole, looks, tmp_path):
    run = settings(parse(["farm", *arguments(shot, tmp_path / "out.mkv", "--codec", "ffv1")]))
    run_job(run, tmp_path / "chunks", 0.5, lambda done, total: None)
    assert [finding.wanted for finding in looks] == [True]
    shots.assert_same_frames(whole, tmp_path / "out.mkv")
    next((tmp_path / "chunks").glob("*.nut")).unlink()
    run_job(run, tmp_path / "chunks", 0.5, lambda done, total: None)
    assert len(looks) == 1
    Folder(tmp_path / "chunks").clear()
    assert not (tmp_path / "chunks").exists()


def test_chunks_rendered_by_separate_commands_look_once(shot, whole, looks, tmp_path):
    chunks = tmp_path / "chunks"
    for part in ("0:9", "9:24"):
        given = arguments(shot, None, "--range", part, "--chunk-out", str(chunks))
        assert main([*given, "-q"]) == 0
    assert [finding.wanted for finding in looks] == [True]
    run = settings(parse(["farm", *arguments(shot, tmp_path / "out.mkv", "--codec", "ffv1")]))
    merge(run.source, sorted(chunks.glob("*.nut")), run.output)
    shots.assert_same_frames(whole, tmp_path / "out.mkv")


def test_a_run_that_is_told_looks_nowhere(shot, looks, tmp_path):
    run = settings(parse(["farm", *arguments(shot, tmp_path / "o.mkv", "--occlusion", "none")]))
    key = mark_of(run).key
    look_once(run, Folder(tmp_path), key)
    assert not looks and with_stored_look(run, Folder(tmp_path), key) == run


def test_the_name_of_a_chunk_does_not_depend_on_whether_somebody_looked(shot, tmp_path):
    run = settings(parse(["farm", *arguments(shot, tmp_path / "o.mkv")]))
    key = mark_of(run).key
    look_once(run, Folder(tmp_path), key)
    known = with_stored_look(run, Folder(tmp_path), key)
    assert known != run and mark_of(known) == mark_of(run)

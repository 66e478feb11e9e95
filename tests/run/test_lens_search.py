"""Streams whose first frames tell no lens, as bars and noise do not."""

import json
import subprocess
import sys

import av
import numpy as np
import pytest
from support import shots
from support.command import nlens, one_line

from nlens_video.core.errors import LensFitError
from nlens_video.graph.base.lens_search import LensSearch

BEFORE, FRAMES, RATE = 5, 14, 25
UNTOLD = "the ground under the object does not tell the blur"


def beginning(kind):
    """A picture that tells no lens (H, W, 3)."""
    picture = np.zeros_like(shots.plate())
    if kind == "bars":
        picture[:] = np.repeat(np.linspace(40, 215, 8), shots.WIDTH // 8)[None, :, None]
    else:
        picture[:] = np.random.default_rng(0).normal(100.0, 4.0, picture.shape)
    return picture


def streamed(folder, pictures, *words):
    """The summary of a run on raw frames on its standard input, and the plates' changed pixels."""
    out = folder / "out.mkv"
    size = f"{shots.WIDTH}x{shots.HEIGHT}"
    command = [
        sys.executable, "-m", "nlens_video", "-", folder / "anim.glb", out, "--input-format",
        "rgb24", "--input-size", size, "--input-rate", str(RATE), "--preset", "realtime",
        "--codec", "ffv1", "--effects", "defocus", "--json", "-y", *words,
    ]  # fmt: skip
    given = b"".join(picture.tobytes() for picture in pictures)
    run = subprocess.run([str(word) for word in command], input=given, capture_output=True)
    if run.returncode:
        return run, []
    with av.open(str(out)) as made:
        frames = [frame.to_ndarray(format="rgb24") for frame in made.decode(video=0)]
    changed = [(one != other).any(axis=2) for one, other in zip(frames, pictures, strict=True)]
    return run, [int(one.sum()) for one in changed]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return shots.write_shot(tmp_path_factory.mktemp("shot"), 1, still=False, sun=True)


@pytest.mark.needs_gl
@pytest.mark.parametrize("kind", ["bars", "noise"])
def test_object_is_shown_once_a_frame_of_a_stream_tells_the_lens(folder, kind):
    after = FRAMES - BEFORE
    run, changed = streamed(folder, [beginning(kind)] * BEFORE + [shots.plate()] * after)
    assert run.returncode == 0, run.stderr.decode()
    shown = next(index for index, count in enumerate(changed) if count)
    assert BEFORE <= shown <= BEFORE + RATE // 4 + 1
    assert all(count > 500 for count in changed[shown:])
    (note,) = [
        note for note in json.loads(run.stdout)["notes"] if "no lens is found before" in note
    ]
    assert "until then the object is not shown" in note


@pytest.mark.needs_gl
def test_stream_that_never_tells_its_lens_ends_with_that_error(folder):
    (folder / "out.mkv").unlink(missing_ok=True)
    run, _ = streamed(folder, [beginning("noise")] * FRAMES)
    assert run.returncode == 5
    assert UNTOLD in run.stderr.decode() and not (folder / "out.mkv").exists()


@pytest.mark.needs_gl
def test_file_that_tells_no_lens_is_refused(folder, tmp_path):
    plate = tmp_path / "noise.mkv"
    shots.write_video(plate, 3, rgb=beginning("noise"))
    assert UNTOLD in one_line(nlens(plate, folder / "anim.glb", tmp_path / "out.mkv", "-q"), 5)


def test_search_looks_again_after_a_pause_and_ends_after_its_patience():
    search, error = LensSearch(1.0), LensFitError("no")
    assert not search.passes_over(3.0)
    search.failed(error, 3.0)
    assert [search.passes_over(at) for at in (3.04, 3.2, 3.25, 2.0)] == [True, True, False, False]
    search.failed(error, 3.9)
    with pytest.raises(LensFitError):
        search.failed(error, 4.0)


def test_search_without_patience_ends_at_the_first_frame():
    with pytest.raises(LensFitError):
        LensSearch().failed(LensFitError("no"), 0.0)

"""Full disks: complete files are kept, incomplete ones removed or kept as asked, in one line."""

import itertools
import json
import subprocess
import sys

import cv2
import pytest
from support import shots
from support.clips import read_times
from support.command import nlens, one_line
from support.disks import fill, small_disk

from nlens_video.video.atomic_files import partial_name

pytestmark = pytest.mark.needs_gl
BESIDE = {"--report": "report", "--timings": "t.json", "--save-fit": "fit.json", "--aov": "aov"}


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    slide = {"end": (0.3, 0.0, -2.6), "seconds": 0.5}
    return shots.write_shot(tmp_path_factory.mktemp("shot"), 6, **slide)


@pytest.fixture
def full(tmp_path):
    """A folder on a disk without room."""
    with small_disk(tmp_path / "small", 16) as folder:
        filler = fill(folder)
        yield folder
        assert list(folder.rglob(".*")) == []
        filler.unlink()


def rendered(shot, out, *more):
    return nlens(shot / "in.mp4", shot / "anim.glb", out, "--fit", shot / "fit.json", *more)


@pytest.mark.needs_mount
@pytest.mark.parametrize("option", BESIDE)
def test_finished_video_is_kept_if_a_side_file_does_not_fit(shot, tmp_path, full, option):
    out = tmp_path / "out.mp4"
    others = [word for key, name in BESIDE.items() if key != option
              for word in (key, tmp_path / name)]  # fmt: skip
    run = rendered(shot, out, option, full / BESIDE[option], *others, "-q")
    line = one_line(run, 6)
    assert f"{out} is complete, but not what was asked for beside it: {option} {full}" in line
    assert "No space left on device" in line
    assert len(shots.read_planes(out)) == 6
    for key, name in BESIDE.items():
        assert (tmp_path / name).exists() == (key != option)
    if option != "--timings":
        assert len(json.loads((tmp_path / "t.json").read_text())["frames"]) == 6
    if option != "--aov":
        assert len(list((tmp_path / "aov").iterdir())) == 6


@pytest.mark.needs_mount
def test_every_missing_side_file_is_named_in_the_summary(shot, tmp_path, full):
    words = [word for key, name in BESIDE.items() for word in (key, full / name)]
    run = rendered(shot, tmp_path / "out.mp4", *words, "--json")
    line = one_line(run, 6)
    assert all(f"{key} {full / name}: " in line for key, name in BESIDE.items())
    told = json.loads(run.stdout)
    assert told["timing"]["frames"] == 6 and len(told["missing"]) == 4


@pytest.mark.needs_mount
def test_lens_fit_is_kept_if_its_report_does_not_fit(shot, tmp_path, full):
    fit = tmp_path / "found.json"
    run = nlens("fit", shot / "plate.png", shot / "anim.glb", fit, "--report", full / "r", "-q")
    assert f"{fit} is complete, but not" in one_line(run, 6)
    assert "slope" in json.loads(fit.read_text())


@pytest.mark.needs_mount
def test_findings_are_printed_if_the_check_report_does_not_fit(shot, full):
    plate = shot / "in.mp4"
    run = nlens("check", plate, "--against", plate, "--report", full / "r", "--json")
    assert "No space left on device" in one_line(run, 6)
    assert json.loads(run.stdout)["frames"]


@pytest.mark.needs_mount
@pytest.mark.parametrize("command", ["render", "place", "fit"])
def test_result_that_does_not_fit_keeps_the_former_file(shot, tmp_path, command):
    name = {"render": "out.mp4", "place": "out.png", "fit": "out.json"}[command]
    with small_disk(tmp_path / "small", 16) as folder:
        (folder / name).write_text("of yesterday")
        fill(folder)
        run = nlens(command, shot / "in.mp4", shot / "anim.glb", folder / name)
        assert f"{name}: cannot be written" in one_line(run, 6)
        assert (folder / name).read_text() == "of yesterday"
        assert sorted(path.name for path in folder.iterdir()) == ["filler", name]


@pytest.mark.parametrize("option", BESIDE)
def test_full_disk_for_a_side_file_keeps_the_result(shot, tmp_path, option):
    """The same as above where nothing can be mounted: a device that is always full."""
    out, target = tmp_path / "out.png", tmp_path / BESIDE[option]
    if option in ("--report", "--aov"):
        target.mkdir()
    file = {"--report": target / "index.html", "--aov": target / "000000.exr"}.get(option, target)
    partial_name(file).symlink_to("/dev/full")
    words = [shot / "plate.png", shot / "anim.glb", out, "--fit", shot / "fit.json", "-q"]
    line = one_line(nlens(*words, option, target), 6)
    assert f"{out} is complete, but not what was asked for beside it: {option} {target}" in line
    assert out.is_file() and not file.exists() and not partial_name(file).is_symlink()


def test_file_size_limit_is_handled_as_a_full_disk(shot, tmp_path):
    """`ulimit -f`, as quotas of batch systems are set: 64 KiB hold the picture, not the page."""
    words = [shot / "in.mp4", shot / "anim.glb", "out.mp4", "--fit", shot / "fit.json"]
    command = [sys.executable, "-m", "nlens_video", *map(str, words), "--report", "r", "-q"]
    command += ["--crf", "40"]
    shell = ["sh", "-c", 'ulimit -f 128; exec "$@"', "sh", *command]
    run = subprocess.run(
        shell, capture_output=True, text=True, timeout=120, check=False, cwd=tmp_path
    )
    line = one_line(run, 6)
    assert line.startswith("nlens-video: out.mp4 is complete, but not")
    assert "r/index.html: cannot be written (File too large)" in line
    assert len(shots.read_planes(tmp_path / "out.mp4")) == 6
    assert list((tmp_path / "r").iterdir()) == []


@pytest.fixture(scope="module")
def long_shot(tmp_path_factory):
    return shots.write_shot(tmp_path_factory.mktemp("long"), 40, still=False)


def rendered_in_little_room(shot, out, kilobytes, *more):
    """A run whose files may have a size at most, as on a disk that has no more room."""
    words = [shot / "in.mp4", shot / "anim.glb", out, "--fit", shot / "fit.json", "-q", *more]
    command = [sys.executable, "-m", "nlens_video", *map(str, words), "--preset", "draft"]
    shell = ["sh", "-c", f'ulimit -f {2 * kilobytes}; exec "$@"', "sh", *command]
    return subprocess.run(shell, capture_output=True, text=True, timeout=120, check=False)


@pytest.mark.parametrize("name", ["out.mkv", "out.mp4", "out.mov", "out.ts", "out.avi"])
def test_frames_that_fit_on_a_full_disk_are_kept_where_asked(long_shot, tmp_path, name):
    kept = tmp_path / name.replace("out", "out.partial")
    words = ("--codec", "mpeg4", "--keep-partial")
    line = one_line(rendered_in_little_room(long_shot, tmp_path / name, 100, *words), 6)
    assert f"{name}: cannot be written (File too large)" in line
    assert line.endswith(f"; the part written so far is {kept}")
    assert list(tmp_path.iterdir()) == [kept]
    times = read_times(kept)
    assert 5 <= len(times) < 40
    assert all(later > earlier for earlier, later in itertools.pairwise(times))


def test_full_disk_that_took_no_frame_keeps_nothing_and_says_so(long_shot, tmp_path):
    words = ("--codec", "mpeg4", "--keep-partial")
    line = one_line(rendered_in_little_room(long_shot, tmp_path / "out.mp4", 4, *words), 6)
    assert line.endswith("; nothing that plays was written, so --keep-partial keeps nothing")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.needs_mount
def test_pictures_that_fit_on_a_full_disk_are_kept_whole(shot, tmp_path):
    with small_disk(tmp_path / "small", 600) as folder:
        run = rendered(shot, folder / "out_%04d.png", "--keep-partial", "-q")
        kept = folder / "out_%04d.partial"
        assert one_line(run, 6).endswith(f"; the part written so far is {kept}")
        pictures = sorted(kept.iterdir())
        assert [one.name for one in pictures] == ["out_0000.png", "out_0001.png"]
        assert all(cv2.imread(str(one)).shape == (270, 480, 3) for one in pictures)

"""Existing output files: replaced with their permissions, asked about on a terminal, or kept."""

import os
import stat

import pytest
from support import shots
from support.command import nlens, one_line
from support.disks import small_disk
from support.terminal import CTRL_C, Terminal, program

pytestmark = pytest.mark.needs_gl


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    return shots.write_shot(tmp_path_factory.mktemp("shot"), 3)


def arguments(shot, out, *more, plate="plate.png"):
    return [
        shot / plate, shot / "anim.glb", out, "--fit", shot / "fit.json", "--effects", "defocus",
        "--preset", "draft", *more,
    ]  # fmt: skip


def mode(path):
    return stat.S_IMODE(path.stat().st_mode)


@pytest.mark.parametrize(
    ("plate", "out"), [("plate.png", "out.png"), ("in.mp4", "out.mp4"), ("in.mp4", "o_%04d.png")]
)
def test_rerun_in_a_script_overwrites_and_keeps_permissions(shot, tmp_path, plate, out):
    report = ["--report", tmp_path / "r", "--save-fit", tmp_path / "f.json"]
    assert nlens(*arguments(shot, tmp_path / out, *report, plate=plate)).returncode == 0
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert len(files) >= 3
    for number, path in enumerate(files):
        path.chmod(0o640 + number % 2)
    rights = {path: mode(path) for path in files}
    inodes = {path: path.stat().st_ino for path in files}
    run = nlens(*arguments(shot, tmp_path / out, *report, plate=plate))
    assert run.returncode == 0, run.stderr
    assert {path: mode(path) for path in files} == rights
    assert all(path.stat().st_ino != inodes[path] for path in files)  # replaced, not written into


@pytest.mark.skipif(os.name != "posix" or os.geteuid() != 0, reason="gives files away, as root may")
def test_file_replaced_by_root_keeps_its_owner(shot, tmp_path):
    out = tmp_path / "out.png"
    out.write_bytes(b"of somebody")
    os.chown(out, 12345, 23456)
    assert nlens(*arguments(shot, out)).returncode == 0
    assert (out.stat().st_uid, out.stat().st_gid) == (12345, 23456)


@pytest.mark.parametrize("command", ["render", "fit", "place", "--save-fit", "--timings"])
def test_write_protected_file_is_kept_unless_overwriting_is_requested(shot, tmp_path, command):
    target = tmp_path / {"render": "out.png", "place": "out.png"}.get(command, "out.json")
    target.write_text("kept")
    target.chmod(0o444)
    plate, glb = shot / "plate.png", shot / "anim.glb"
    given = {
        "render": arguments(shot, target),
        "fit": ["fit", plate, glb, target],
        "place": ["place", plate, glb, target],
    }.get(command, arguments(shot, tmp_path / "o.png", command, target))
    line = one_line(nlens(*given), 6)
    assert f"{target}: is write-protected; give -y (--overwrite) to replace it" in line
    assert target.read_text() == "kept" and not (tmp_path / "o.png").exists()
    assert nlens(*given, "-y").returncode == 0
    assert target.read_bytes() != b"kept" and mode(target) == 0o444


@pytest.mark.parametrize("command", ["render", "check"])
def test_html_page_of_another_program_is_not_overwritten(shot, tmp_path, command):
    page = tmp_path / "site" / "index.html"
    page.parent.mkdir()
    page.write_text("<html><title>My holidays</title></html>")
    given = arguments(shot, tmp_path / "o.png", "--report", page.parent)
    if command == "check":
        plate = shot / "plate.png"
        given = ["check", plate, "--against", plate, "--report", page.parent]
    line = one_line(nlens(*given), 6)
    assert f"{page}: was not written by nlens-video; give -y" in line
    assert "holidays" in page.read_text()
    assert nlens(*given, "-y").returncode == 0
    assert "holidays" not in page.read_text()
    assert nlens(*given).returncode == 0  # ours now


def test_plan_does_not_ask_about_overwriting(shot, tmp_path):
    out = tmp_path / "out.png"
    out.write_text("kept")
    out.chmod(0o444)
    assert nlens(*arguments(shot, out, "--plan")).returncode == 0


@pytest.mark.parametrize(
    ("keys", "code", "replaced"),
    [
        ("y\n", 0, True),
        ("n\n", 6, False),
        ("\n", 6, False),
        ("\x04", 6, False),
        (CTRL_C, 130, False),
    ],
)
def test_terminal_user_is_asked_before_a_file_is_replaced(shot, tmp_path, keys, code, replaced):
    out = tmp_path / "out.png"
    out.write_text("kept")
    with Terminal(program(*arguments(shot, out, "--save-fit", tmp_path / "f.json"))) as terminal:
        terminal.wait_for("replace? [y/N]")
        assert "out.png exists; replace? [y/N]" in terminal.text.replace("\r\n", "")
        terminal.type(keys)
        assert terminal.end() == code, terminal.screen
    assert (out.read_bytes() != b"kept") == replaced
    assert (tmp_path / "f.json").exists() == replaced


def test_y_option_replaces_without_asking(shot, tmp_path):
    out = tmp_path / "out.png"
    out.write_text("kept")
    with Terminal(program(*arguments(shot, out, "-y"))) as terminal:
        assert terminal.end() == 0, terminal.screen
    assert "replace?" not in terminal.text


class TestLinks:
    @pytest.mark.parametrize("there", [True, False], ids=["to a file", "to nothing yet"])
    @pytest.mark.parametrize(("plate", "name"), [("plate.png", "out.png"), ("in.mp4", "out.mp4")])
    def test_result_is_written_through_a_symbolic_link(self, shot, tmp_path, plate, name, there):
        (tmp_path / "data").mkdir()
        target, link = tmp_path / "data" / "0af3", tmp_path / name  # a name without an extension
        if there:
            target.write_text("of yesterday")
            target.chmod(0o600)
        link.symlink_to("data/0af3")
        run = nlens(*arguments(shot, link, plate=plate))
        assert run.returncode == 0, run.stderr
        assert link.is_symlink() and target.stat().st_size > 1000
        assert mode(target) == 0o600 or not there
        assert len(shots.read_planes(link)) == (1 if plate == "plate.png" else 3)
        assert sorted(p.name for p in tmp_path.rglob("*")) == sorted(["data", "0af3", name])

    def test_side_files_are_written_through_symbolic_links(self, shot, tmp_path):
        (tmp_path / "data").mkdir()
        for name in ("f.json", "t.json", "index.html"):
            (tmp_path / name).symlink_to(tmp_path / "data" / name)
        run = nlens(*arguments(
            shot, tmp_path / "o.png", "--save-fit", tmp_path / "f.json", "--timings",
            tmp_path / "t.json", "--report", tmp_path,
        ))  # fmt: skip
        assert run.returncode == 0, run.stderr
        assert all((tmp_path / name).is_symlink() for name in ("f.json", "t.json", "index.html"))
        assert len(list((tmp_path / "data").iterdir())) == 3

    def test_sequence_is_written_through_symbolic_links(self, shot, tmp_path):
        (tmp_path / "data").mkdir()
        (tmp_path / "data" / "first").write_text("old")
        (tmp_path / "o_0000.png").symlink_to("data/first")
        run = nlens(*arguments(shot, tmp_path / "o_%04d.png", plate="in.mp4"))
        assert run.returncode == 0, run.stderr
        assert (tmp_path / "o_0000.png").is_symlink()
        assert (tmp_path / "data" / "first").read_bytes()[1:4] == b"PNG"
        assert not (tmp_path / "o_0001.png").is_symlink()

    def test_interrupted_write_keeps_the_existing_file(self, shot, tmp_path):
        """The plate ends in nothing that can be decoded: the run fails after it has begun."""
        target, link = tmp_path / "target.png", tmp_path / "out.png"
        target.write_text("kept")
        link.symlink_to(target)
        shots.write_png(tmp_path / "grey.png", shots.grey())
        run = nlens(tmp_path / "grey.png", shot / "anim.glb", link)
        assert run.returncode == 5, run.stderr
        assert target.read_text() == "kept" and link.is_symlink()
        assert len(list(tmp_path.iterdir())) == 3

    @pytest.mark.parametrize(
        ("to", "words_"),
        [
            ("out.png", "is a link that leads in a circle"),
            ("no/such/folder/out.png", "does not exist; make it first"),
            (".", "is a folder"),
            ("/dev/null", "is a device or a pipe"),
        ],
    )
    def test_dangling_symbolic_link_is_refused_before_the_run(self, shot, tmp_path, to, words_):
        (tmp_path / "out.png").symlink_to(to)
        assert words_ in one_line(nlens(*arguments(shot, tmp_path / "out.png")), 6)
        assert [path.name for path in tmp_path.iterdir()] == ["out.png"]

    @pytest.mark.needs_mount
    def test_result_is_written_through_a_link_to_another_disk(self, shot, tmp_path):
        with small_disk(tmp_path / "other", 4096) as disk:
            (tmp_path / "out.mp4").symlink_to(disk / "out.mp4")
            (tmp_path / "o_0001.png").symlink_to(disk / "one.png")
            assert nlens(*arguments(shot, tmp_path / "out.mp4", plate="in.mp4")).returncode == 0
            assert nlens(*arguments(shot, tmp_path / "o_%04d.png", plate="in.mp4")).returncode == 0
            assert len(shots.read_planes(disk / "out.mp4")) == 3
            assert sorted(path.name for path in disk.iterdir()) == ["one.png", "out.mp4"]


@pytest.mark.needs_mount
def test_read_only_disk_is_refused_before_the_run(shot, tmp_path):
    with small_disk(tmp_path / "disk", 64, options="ro") as disk:
        line = one_line(nlens(*arguments(shot, disk / "out.png")), 6)
        assert "cannot be written to" in line
        for option in ("--report", "--aov"):
            given = arguments(shot, tmp_path / "o.png", option, disk / "r")
            assert "cannot be" in one_line(nlens(*given), 6)
    assert not (tmp_path / "o.png").exists()

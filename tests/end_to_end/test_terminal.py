"""The main command on a terminal: its progress bar, sizes, colours, and keys that stop it."""

import re
import shlex

import av
import pytest
from support import shots
from support.terminal import CTRL_C, CTRL_Z, Terminal, program

pytestmark = pytest.mark.needs_gl
BAR = re.compile(r"compositing .*\d+%.*\d+ frames?, [\d.]+ fps")

LONG = 500  # frames that take seconds at any speed


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shot")
    plate = shots.plate()
    shots.write_video(folder / "in.mp4", frames=12, rgb=plate)
    write_long_video(folder / "long.mp4", plate)
    shots.cube_glb(folder / "anim.glb", end=(0.3, 0.0, -2.6), seconds=0.5)
    shots.fit_json(folder / "fit.json")
    return folder


def write_long_video(path, rgb):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=25, options={"preset": "ultrafast"})
        stream.height, stream.width = rgb.shape[:2]
        stream.pix_fmt = "yuv420p"
        for _ in range(LONG):
            container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb, "rgb24")))
        container.mux(stream.encode())


def quick(files, out, *more, plate="in.mp4"):
    """A command that needs no search for the lens."""
    return program(
        files / plate, files / "anim.glb", out, "--fit", files / "fit.json",
        "--effects", "defocus", "--preset", "draft", *more,
    )  # fmt: skip


def test_main_command_shows_progress_on_a_terminal(files, tmp_path):
    command = program(files / "in.mp4", files / "anim.glb", tmp_path / "out.mp4")
    with Terminal(command, columns=100) as terminal:
        assert terminal.end() == 0, terminal.screen
    assert any(BAR.search(screen) for screen in terminal.screens), terminal.text
    assert "wrote" in terminal.text
    assert len(shots.read_planes(tmp_path / "out.mp4")) == 12


@pytest.mark.parametrize("columns", [40, 80, 200])
def test_progress_is_one_line_at_every_width_and_is_cleared(files, tmp_path, columns):
    command = quick(files, tmp_path / "out.mp4", plate="long.mp4")
    with Terminal(command, columns=columns) as terminal:
        terminal.wait_for("compositing")
        bar = terminal.wait_for(lambda screen: re.search(r"[1-9]\d* frames", screen) is not None)
        assert len(bar.splitlines()) == 1, bar
        assert re.search(r"^compositing .*\d% \d+ frames.* (\d?\d:\d\d|--:--)$", bar), bar
        cells = len(re.findall("[━╸╺]", bar))
        assert cells == 0 or cells >= 10, bar
        assert terminal.end() == 0
    assert "compositing" not in terminal.screen and "wrote" in terminal.text


def test_progress_follows_a_resized_terminal(files, tmp_path):
    command = quick(files, tmp_path / "out.mp4", plate="long.mp4")
    with Terminal(command, columns=120) as terminal:
        terminal.wait_for("compositing")
        terminal.resize(50)
        terminal.wait_for(lambda screen: "compositing" in screen and len(screen.splitlines()) < 4)
        terminal.resize(150)
        assert terminal.end() == 0
    assert "wrote" in terminal.text


@pytest.mark.parametrize(
    "words, environment",
    [
        (("--no-progress",), {}),
        (("-q",), {}),
        (("--json",), {"TERM": "dumb"}),
        ((), {"TERM": "dumb"}),
    ],
)
def test_progress_bar_is_off_when_disabled_or_not_drawable(files, tmp_path, words, environment):
    command = quick(files, tmp_path / "out.mp4", *words)
    with Terminal(command, environment=environment) as terminal:
        assert terminal.end() == 0, terminal.screen
    assert "compositing" not in terminal.text and "\x1b" not in terminal.text
    assert (terminal.text == "") == ("-q" in words)


def test_no_color_variable_disables_colour(files, tmp_path):
    command = quick(files, tmp_path / "out.mp4", plate="long.mp4")
    with Terminal(command, environment={"NO_COLOR": "1"}) as terminal:
        assert terminal.end() == 0, terminal.screen
    colours = re.findall(r"\x1b\[[\d;]*m", terminal.text)
    assert any("compositing" in screen for screen in terminal.screens)
    assert not [one for one in colours if re.search(r"[\[;](3|4|9|10)\d", one)], colours


@pytest.mark.parametrize(
    "phase", ["starting", "compositing", r"\d\d frames"], ids=["first fit", "frames", "more frames"]
)
def test_ctrl_c_stops_the_run_with_one_line(files, tmp_path, phase):
    command = program(files / "long.mp4", files / "anim.glb", tmp_path / "out.mp4")
    with Terminal(command, columns=100) as terminal:
        terminal.wait_for(lambda screen: re.search(phase, screen) is not None)
        terminal.type(CTRL_C)
        assert terminal.end() == 130, terminal.screen
    assert terminal.screen.replace("^C", "").strip() == (
        "nlens-video: interrupted, no output written"
    )
    assert terminal.raw.count(b"\x1b[?25h") == terminal.raw.count(b"\x1b[?25l"), "cursor is hidden"
    assert list(tmp_path.iterdir()) == []


def test_run_continues_after_ctrl_z_and_fg(files, tmp_path):
    out = tmp_path / "out.mp4"
    line = shlex.join(quick(files, out, plate="long.mp4"))
    shell = ["bash", "--norc", "--noprofile", "-i"]
    with Terminal(shell, columns=100, environment={"PS1": "$ ", "HISTFILE": None}) as terminal:
        terminal.wait_for("$")
        terminal.type(f"{line}\n")
        terminal.wait_for(lambda screen: BAR.search(screen) is not None)
        terminal.type(CTRL_Z)
        terminal.wait_for("Stopped")
        terminal.type("fg\n")
        terminal.wait_for("wrote")
        terminal.type("echo code=$?; exit\n")
        terminal.wait_for("code=0")
        terminal.end()
    assert len(shots.read_planes(out)) == LONG

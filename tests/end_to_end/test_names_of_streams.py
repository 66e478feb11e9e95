"""Standard streams, named pipes, process substitution and addresses as IN and OUT."""

import stat
from pathlib import Path

import pytest
from support import shots
from support.command import nlens, one_line
from support.live_shot import FRAMES, QUICK, pictures, shell, succeeded, write_shot

from nlens_video.options.parser import parse

pytestmark = [pytest.mark.needs_gl, pytest.mark.needs_programs("ffmpeg", "ffprobe")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_shot(tmp_path_factory.mktemp("names"))


@pytest.mark.parametrize(
    ("given", "made"), [("pipe:0", "pipe:1"), ("/dev/stdin", "/dev/stdout"), ("-", "-")]
)
def test_ffmpeg_names_of_standard_streams_are_accepted(folder, given, made):
    succeeded(f"nlens-video {given} anim.glb {made} {QUICK} < in.mkv > stdout.nut", folder)
    assert pictures(folder / "stdout.nut") == ("rawvideo", FRAMES)


def test_every_command_accepts_the_names_of_standard_streams():
    for words in (
        ["fit", "pipe:", "a.glb", "f.json"],
        ["place", "/dev/fd/0", "a.glb", "x.png"],
        ["check", "out.nut", "--against", "pipe:0"],
        ["merge", "pipe:1", "chunks", "--from", "/proc/self/fd/0"],
        ["farm", "/dev/stdin", "a.glb", "/dev/fd/1"],
    ):
        parsed = parse(words)
        assert parsed.input == "-"
        assert getattr(parsed, "output", "-") in ("-", Path("x.png"))


def test_process_substitution_works_for_input_and_output(folder):
    line = f"nlens-video <(cat in.mkv) anim.glb >(cat > substituted.nut) {QUICK}; wait $!"
    succeeded(line, folder)
    assert pictures(folder / "substituted.nut") == ("rawvideo", FRAMES)


@pytest.mark.parametrize(("name", "codec"), [("in", "rawvideo"), ("in.mp4", "h264")])
def test_named_pipe_is_written_in_the_format_of_its_extension(folder, tmp_path, name, codec):
    pipe = tmp_path / name
    line = f"mkfifo {pipe}; cat {pipe} > {tmp_path}/got & nlens-video in.mkv anim.glb {pipe}"
    succeeded(f"{line} {QUICK} && wait", folder)
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert pictures(tmp_path / "got") == (codec, FRAMES)


def test_named_pipe_is_read_as_a_stream(folder, tmp_path):
    pipe = tmp_path / "camera"
    line = f"mkfifo {pipe}; cat in.mkv > {pipe} & nlens-video {pipe} anim.glb fifo.mkv {QUICK}"
    succeeded(f"{line} --late keep && wait", folder)
    assert pictures(folder / "fifo.mkv") == ("h264", FRAMES)


def test_device_files_are_written_and_not_replaced(folder):
    succeeded(f"nlens-video in.mkv anim.glb /dev/null {QUICK}", folder)
    run = shell(f"nlens-video in.mkv anim.glb /dev/full {QUICK}", folder)
    assert run.returncode == 6 and run.stderr.count(b"\n") == 1
    assert b"No space left" in run.stderr


def test_camera_device_as_output_is_refused_with_advice(folder):
    line = one_line(
        nlens(folder / "in.mkv", folder / "anim.glb", "/dev/video9", "--fit", folder / "fit.json"),
        6,
    )
    assert "| ffmpeg -i - -pix_fmt yuv420p -f v4l2 /dev/video9" in line


@pytest.mark.parametrize("name", ["v4l2", "video4linux2", "video4linux2,v4l2"])
def test_every_camera_format_name_reaches_the_device(folder, name):
    run = nlens(
        "fit", "/dev/video77", folder / "anim.glb", folder / "f.json", "--input-format", name
    )
    assert "/dev/video77: no camera can be opened there (No such file or" in one_line(run, 3)


@pytest.mark.parametrize(
    ("name", "file"),
    [
        *((name, "in.mp4") for name in ("mov", "mp4", "m4a", "3gp", "mov,mp4,m4a,3gp,3g2,mj2")),
        *((name, "in.mkv") for name in ("matroska", "webm", "matroska,webm")),
    ],
)
def test_explicit_container_format_opens_the_file_as_without_it(folder, name, file):
    words = (folder / file, folder / "anim.glb", folder / "o.mkv", "--plan")
    named, plain = nlens(*words, "--input-format", name), nlens(*words)
    assert named.returncode == 0, named.stderr
    assert named.stdout == plain.stdout


def test_device_formats_of_other_systems_are_refused_with_the_local_ones(folder):
    for name in ("dshow", "avfoundation", "gdigrab"):
        run = nlens("Camera", folder / "anim.glb", folder / "o.mkv", "--input-format", name)
        line = one_line(run, 2)
        assert f"--input-format {name}: FFmpeg has no such" in line and "v4l2" in line


def test_ffmpeg_filter_source_is_a_live_source(folder):
    source = f"testsrc2=size={shots.WIDTH}x{shots.HEIGHT}:rate=25:duration=0.4"
    words = (source, folder / "anim.glb", folder / "filters.mkv", "--input-format", "lavfi")
    run = nlens(*words, "--fit", folder / "fit.json", "--preset", "draft", "--late", "keep", "-q")
    assert run.returncode == 0, run.stderr
    assert pictures(folder / "filters.mkv")[1] == 10
    line = one_line(nlens(*words, "--input-size", "640x360"), 2)
    assert "--input-size 640x360" in line and "leave it out" in line


@pytest.mark.parametrize(
    ("source", "result"),
    [
        ("tcp://127.0.0.1:{port}?listen", None),
        ("http://127.0.0.1:{port}/x.mkv", None),
        (None, "tcp://127.0.0.1:{port}?listen"),
        (None, "http://127.0.0.1:{port}/x.mkv"),
    ],
)
def test_network_addresses_are_read_and_written_with_ffmpeg_as_peer(
    folder, free_ports, source, result
):
    """The listener is started first; the other end tries until it is there."""
    address = (source or result).format(port=free_ports[0])
    plain = address.removesuffix("?listen")
    if source and "listen" in source:
        other = f"ffmpeg -v error -i in.mkv -c copy -f matroska {plain}"
        line = f"{_until(other)} & nlens-video '{address}' anim.glb net.mkv {QUICK} && wait"
    elif source:
        other = f"ffmpeg -v error -i in.mkv -c copy -f matroska -listen 1 {address}"
        line = f"{other} & {_until(f'nlens-video {address} anim.glb net.mkv {QUICK}')} && wait"
    elif "listen" in result:
        other = f"ffmpeg -v error -y -i {plain} -c copy net.mkv"
        line = f"{_until(other)} & nlens-video in.mkv anim.glb '{address}' {QUICK} && wait"
    else:
        other = f"ffmpeg -v error -y -listen 1 -i {address} -c copy net.mkv"
        line = f"{other} & {_until(f'nlens-video in.mkv anim.glb {address} {QUICK}')} && wait"
    run = shell(line, folder)
    assert run.returncode == 0, run.stderr.decode()
    assert pictures(folder / "net.mkv")[1] == FRAMES


def _until(command):
    """A command of the shell, again until it finds its other end."""
    return f"for i in $(seq 40); do {command} 2>>tries && break; sleep 0.25; done"

"""Lines of the public pages that need a shell: pasted into Bash, other programs and all.

What is not here has a stand-in: `lavfi` and `videotestsrc` for cameras, a listening `ffmpeg` on
this machine for servers, `ffmpeg -f null` for `ffplay`.
"""

import json
import re
import shutil

import pytest
from support.documents import PAGES, blocks, commands
from support.live_shot import FRAMES, pictures, shell, succeeded, write_shot
from support.study_answers import METHODS, answer, write_folder

pytestmark = [
    pytest.mark.needs_gl,
    pytest.mark.needs_programs("ffmpeg", "ffprobe", "gst-launch-1.0"),
]
STAND_INS = (
    (r"/dev/video0 (.*)--input-format v4l2", r"movie=in.mp4 \1--input-format lavfi"),
    (r"/dev/video0 anim.glb -", r"movie=in.mp4 anim.glb - --input-format lavfi"),
    (r"-f v4l2 /dev/video10", "-f null -"),
    (r"rtsp://camera/stream", "tcp://127.0.0.1:{port}?listen"),
    (r"rtsp://server/live", "rtsp://127.0.0.1:{other_port}/live"),
    (r"v4l2src", "videotestsrc num-buffers=24"),
    (r"ffplay -", "ffmpeg -v error -i - -f null -"),
    (r"producer", "ffmpeg -v error -i in.mp4 -vf scale=960:512 -f rawvideo -pix_fmt bgr24 -"),
)
CAMERA = "for i in $(seq 80); do ffmpeg -v error -i in.mp4 -c copy -f mpegts tcp://127.0.0.1:{port}"
SERVER = (
    "timeout 60 ffmpeg -v error -rtsp_flags listen -i rtsp://127.0.0.1:{other_port}/live -f null -"
)
IN_A_SHELL = re.compile(r" \| |/dev/video|rtsp://|PICTURES|study analyse")
ELSEWHERE = re.compile(r"^vspipe |! nlens glb=|-out\.(mkv|mov|webm)$")
"""Lines that tests/adapters and test_ffmpeg_page.py run."""
LINES = [line for line in commands() if IN_A_SHELL.search(line) and not ELSEWHERE.search(line)]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = write_shot(tmp_path_factory.mktemp("pasted"))
    succeeded("ffmpeg -v error -i in.mp4 -c copy in.mov", folder)
    write_folder(folder / "PICTURES")
    for person in ("a", "b"):
        rows = [
            answer(person, number, METHODS[number % 3], failed=number % 2 == 0)
            for number in range(6)
        ]
        text = json.dumps({"participant": person, "answers": rows})
        (folder / f"answers-{person}.json").write_text(text)
    return folder


@pytest.fixture
def folder(files, tmp_path):
    return shutil.copytree(files, tmp_path / "pasted")


@pytest.mark.parametrize("line", LINES)
def test_documented_shell_pipelines_run_as_written(line, folder, free_ports):
    for shown, stand_in in STAND_INS:
        line = re.sub(shown, stand_in, line)
    port, other_port = free_ports
    before = ""
    if "{port}" in line:
        before += f"{CAMERA} 2> tries && break; sleep 0.25; done & "
    if "{other_port}" in line:
        before += f"{SERVER} & "
    line = line.replace("tcp://127.0.0.1:{port}?listen", "'tcp://127.0.0.1:{port}?listen'")
    script = f"{before}{{ {line}; }} < /dev/null; code=$?; wait; exit $code"
    run = shell(script.replace("{port}", port).replace("{other_port}", other_port), folder)
    assert run.returncode == 0, run.stderr.decode()
    assert b"Traceback" not in run.stderr
    if "in.mov" in line:
        assert pictures(folder / "out.mov") == ("hevc", FRAMES)


def test_documented_chunk_loop_runs_as_written(folder):
    (loop,) = (block for page in PAGES for block in blocks(page) if "for first in" in block)
    short = loop.replace("frames=1500", f"frames={FRAMES}").replace("length=250", "length=6")
    assert short != loop
    succeeded(f"set -e\n{short}", folder)
    assert pictures(folder / "out.mp4") == ("h264", FRAMES)


def test_documents_contain_the_commands_that_the_tests_replace():
    shown = "\n".join(LINES)
    assert [was for was, _ in STAND_INS if not re.search(was, shown)] == []

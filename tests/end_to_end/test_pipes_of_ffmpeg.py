"""The `ffmpeg` program on both sides of a pipe."""

import os
import select
import subprocess
import time

import numpy as np
import pytest
from support import shots
from support.command import process
from support.live_shot import (
    FRAMES,
    QUICK,
    RUN,
    picture_times,
    pictures,
    shell,
    streams,
    succeeded,
    write_shot,
)

pytestmark = [pytest.mark.needs_gl, pytest.mark.needs_programs("ffmpeg", "ffprobe")]
SIZE = f"{shots.WIDTH}x{shots.HEIGHT}"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return write_shot(tmp_path_factory.mktemp("pipes"))


@pytest.mark.parametrize(
    ("source", "words"),
    [
        ("-f nut -c:v rawvideo -c:a copy", ""),
        ("-f matroska -c copy", ""),
        ("-f mpegts -c copy", ""),
        ("-f yuv4mpegpipe -an", ""),
        ("-f mjpeg -an -q:v 3 -pix_fmt yuvj420p", "--input-format mjpeg --input-rate 25"),
        ("-f image2pipe -an -c:v png", "--input-format image2pipe --input-rate 25"),
        ("-f mp4 -movflags frag_keyframe+delay_moov -c copy", ""),
        ("-f flv -c copy", ""),
    ],
)
def test_every_picture_piped_by_ffmpeg_is_written(folder, source, words):
    line = f"ffmpeg -v error -i in.mp4 {source} - | nlens-video - anim.glb - {words} {QUICK}"
    succeeded(f"{line} | ffmpeg -v error -y -i - -fps_mode passthrough -c:v ffv1 out.mkv", folder)
    assert pictures(folder / "out.mkv") == ("ffv1", FRAMES)
    times = [round(moment * 25) for moment in picture_times(folder / "out.mkv")]
    assert times == list(range(FRAMES))


def test_audio_through_a_nut_pipe_is_unchanged(folder):
    line = "ffmpeg -v error -i in.mkv -f nut -c:v rawvideo -c:a copy - | nlens-video - anim.glb -"
    succeeded(f"{line} {QUICK} | ffmpeg -v error -y -i - -map 0:a -c copy sound.mkv", folder)
    assert shots.audio_packets(folder / "sound.mkv") == shots.audio_packets(folder / "in.mkv")


def test_pcm_audio_keeps_picture_times_and_passes_the_check(folder):
    """As AAC it begins before zero: the first ffmpeg then moves the pictures, the last adds one."""
    line = (
        "ffmpeg -v error -i in.mp4 -f nut -c:v rawvideo -c:a pcm_s16le - | nlens-video - anim.glb -"
    )
    last = "ffmpeg -v error -y -i - -c:v libx264 -crf 14 pcm.mov"
    words = succeeded(
        f"{line} {QUICK} | {last} && nlens-video check pcm.mov --against in.mp4", folder
    )
    assert pictures(folder / "pcm.mov") == ("h264", FRAMES), words


def test_audio_taken_from_the_original_file_is_kept_bit_for_bit(folder):
    line = "ffmpeg -v error -i in.mp4 -an -f nut -c:v rawvideo - | nlens-video - anim.glb -"
    last = "ffmpeg -v error -y -i - -i in.mp4 -map 0:v -map 1:a -c:a copy -c:v libx264 own.mov"
    succeeded(f"{line} {QUICK} | {last}", folder)
    assert pictures(folder / "own.mov") == ("h264", FRAMES)
    assert shots.audio_packets(folder / "own.mov") == shots.audio_packets(folder / "in.mp4")


@pytest.mark.parametrize(
    ("name", "out"),
    [("bgr24", "mkv"), ("rgb24", "mkv"), ("yuv420p", "mov"), ("gray16le", "avi"), ("nv12", "mkv")],
)
def test_raw_frames_from_a_pipe_are_written_as_video(folder, name, out):
    line = f"ffmpeg -v error -i in.mp4 -frames:v 4 -f rawvideo -pix_fmt {name} - | nlens-video -"
    words = f"--input-format {name} --input-size {SIZE} --input-rate 30 {QUICK}"
    succeeded(f"{line} anim.glb raw.{out} {words}", folder)
    assert pictures(folder / f"raw.{out}")[1] == 4
    shown, plate = (_first_picture(folder, name) for name in (f"raw.{out}", "in.mp4"))
    beside = slice(0, shots.WIDTH // 4)  # the object stands in the middle
    assert np.abs(shown[:, beside] - plate[:, beside]).mean() < 6


def _first_picture(folder, name):
    """Grey values as the ffmpeg program shows them."""
    line = f"ffmpeg -v error -i {name} -frames:v 1 -f rawvideo -pix_fmt gray -"
    run = shell(line, folder)
    assert run.returncode == 0, run.stderr
    return np.frombuffer(run.stdout, np.uint8).reshape(shots.HEIGHT, shots.WIDTH).astype(int)


def test_variable_frame_rate_keeps_its_times_through_pipes(folder):
    wanted = [0, 1, 2, 5, 6, 7, 8, 11]
    choose = "+".join(f"eq(n\\,{number})" for number in wanted)
    line = f"ffmpeg -v error -i in.mp4 -an -vf \"select='{choose}'\" -fps_mode vfr"
    last = "ffmpeg -v error -y -i - -fps_mode passthrough -enc_time_base -1 -c:v libx264 vfr.mkv"
    succeeded(f"{line} -f nut - | nlens-video - anim.glb - {QUICK} | {last}", folder)
    assert [round(moment * 25) for moment in picture_times(folder / "vfr.mkv")] == wanted


def test_frame_size_change_midway_is_scaled_to_the_first_size_with_a_note(folder):
    made = "ffmpeg -v error -y -i in.mp4 -an -frames:v 6"
    succeeded(
        f"{made} -f mpegts one.ts && "
        f"{made} -vf scale=320:180 -output_ts_offset 0.24 -f mpegts two.ts && "
        "cat one.ts two.ts | nlens-video - anim.glb sizes.mkv --preset draft --fit fit.json "
        "2> told",
        folder,
    )
    (video,) = (one for one in streams(folder / "sizes.mkv") if one["codec_type"] == "video")
    assert (video["width"], video["height"]) == (shots.WIDTH, shots.HEIGHT)
    assert pictures(folder / "sizes.mkv")[1] >= 11  # ffmpeg itself loses one at such a joint
    assert "320x180" in (folder / "told").read_text()


def test_slow_and_stalling_producer_is_waited_for(folder):
    line = "(sleep 2; head -c 40000 in.ts; sleep 2; tail -c +40001 in.ts)"
    made = "ffmpeg -v error -y -i in.mp4 -c copy in.ts"
    succeeded(f"{made} && {line} | nlens-video - anim.glb late.mkv {QUICK}", folder)
    assert pictures(folder / "late.mkv")[1] == FRAMES


def test_frames_before_a_producers_crash_are_kept_and_the_damage_reported(folder):
    raw = "ffmpeg -v error -i in.mp4 -an -f nut -c:v rawvideo -"
    half = shots.WIDTH * shots.HEIGHT * 3 // 2 * 5 + 1000  # five frames and a bit
    line = f"({raw} | head -c {half}; true) | nlens-video - anim.glb dead.mkv"
    words = succeeded(f"set +o pipefail; {line} --preset draft --fit fit.json", folder)
    codec, count = pictures(folder / "dead.mkv")
    assert codec == "rawvideo" and 4 <= count <= 6, words


def test_producer_that_dies_before_its_first_picture_is_a_one_line_error(folder):
    for producer in ("true", "head -c 300 in.mkv"):
        run = shell(f"{producer} | nlens-video - anim.glb none.mkv {QUICK}", folder)
        assert run.returncode == 3 and run.stderr.count(b"\n") == 1, run.stderr
    assert not (folder / "none.mkv").exists()


def test_reader_that_closes_the_pipe_ends_the_run_silently(folder):
    run = shell(f"nlens-video in.mkv anim.glb - {QUICK} | head -c 100000 | wc -c", folder)
    assert (run.returncode, run.stdout.strip(), run.stderr) == (0, b"100000", b"")


def test_error_output_of_a_failing_reader_is_not_altered(folder):
    run = shell(
        f"nlens-video in.mkv anim.glb - {QUICK} | ffmpeg -v error -i - no/such/out.mp4", folder
    )
    assert run.returncode != 0
    assert b"nlens-video" not in run.stderr and b"Traceback" not in run.stderr


def test_interrupt_is_handled_while_a_reader_stalls(folder):
    """A signal to the program alone, as a service manager sends it: the reader lives on."""
    line = f"{RUN} in.mkv anim.glb - {QUICK} 2> told & echo $! >&9; wait $!; echo $? > code"
    stall = "until [ -s code ] || [ $SECONDS -gt 60 ]; do sleep 0.2; done"
    reader = f"head -c 1000 > got; sleep 1; kill -INT $(cat number); {stall}"
    script = f"exec 9> number; ({line}) | ({reader})"
    shell(script, folder, timeout=90)
    told = (folder / "told").read_text()
    assert told == "nlens-video: interrupted; the stream to standard output ends here\n"
    assert (folder / "code").read_text() == "130\n"


@pytest.mark.slow
@pytest.mark.parametrize("codec", ["rawvideo", "ffvhuff"])
def test_each_frame_of_a_stream_comes_out_before_the_next_one_goes_in(codec, tmp_path):
    shots.cube_glb(tmp_path / "anim.glb")
    shots.fit_json(tmp_path / "fit.json")
    frame = np.random.default_rng(0).bytes(shots.WIDTH * shots.HEIGHT * 3 // 2)
    given = "--input-format", "rawvideo", "--input-rate", "25", "--input-size", SIZE
    run = process(
        "-", tmp_path / "anim.glb", "-", "--fit", tmp_path / "fit.json", "--preset", "draft",
        "--codec", codec, "-q", *given, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
    )  # fmt: skip
    with run:
        for number in range(6):
            run.stdin.write(frame)
            run.stdin.flush()
            if not read_more(run.stdout, len(frame) // 2, 60):
                run.kill()
                pytest.fail(f"frame {number} is held back")
        run.stdin.close()
        run.stdout.read()
    assert run.returncode == 0


def read_more(pipe, least, seconds):
    """Read that many bytes or more of a pipe; False if they have not come after some seconds."""
    got, end = 0, time.monotonic() + seconds
    while got < least:
        ready, _, _ = select.select([pipe], [], [], max(0.0, end - time.monotonic()))
        if not ready:
            return False
        got += len(os.read(pipe.fileno(), 1 << 20))
    return True

"""Each word of each command once with sense and with nonsense."""

from __future__ import annotations

from dataclasses import replace

from end_to_end.option_rows import (
    EFFECTS,
    ENCODING,
    EVALUATE,
    INPUT,
    JOB,
    LENGTHS,
    LENS,
    LINES,
    NO_FILE,
    NO_TARGET,
    NOT_NUMBERS,
    OBJECT,
    OF_A_VIDEO,
    OUTPUT,
    PLACING,
    PLANNED,
    PLATE,
    PLAYBACK,
    RANGE,
    RESULTS,
    RUN,
    SCALE,
    SCALE_ELSEWHERE,
    SHOWN,
    STREAM,
    TALK,
    TALK_ELSEWHERE,
    VIDEO,
    Command,
    Row,
    option,
)

BENCH, STUDY_PAGE, STUDY_DEMO, STUDY_ANALYSIS = (
    f"tests/evaluate/test_{name}.py"
    for name in ("bench_command", "study_page", "study_demo", "study_analysis")
)

STUDIO = "tests/studio/test_server.py"

OF_SINGLE_RUNS = {
    "range": replace(RANGE["range"], nonsense=RANGE["range"].nonsense[:-1]),
    "frame": RANGE["frame"],
    **{
        name: {**LENS, **EFFECTS, **PLANNED}[name]
        for name in ("hold_budget", "save_fit", "aov", "timings", "report")
    },
}
"""What a farm refuses."""

COMMANDS = {
    "render": Command(
        words=("render", "in.png", "anim.glb", "{tmp}/out.png", "--preset", "draft", "--fit",
               "fit.json", "--no-progress"),
        places={"input": 1, "glb": 2, "output": 3},
        rows={
            **TALK, "input": INPUT, **OBJECT, "output": OUTPUT, **LENS, **PLATE, **RANGE, **SHOWN,
            **SCALE_ELSEWHERE,
            **EFFECTS, **RUN, **{name: replace(row, words=VIDEO) for name, row in ENCODING.items()},
            "input_format": replace(PLATE["input_format"], words=STREAM),
            "as_chunk": option("--as-chunk", words=(*VIDEO[:3], "{tmp}/chunks", *VIDEO[4:])),
            "resume": option("--resume", words=VIDEO),
            "progress_lines": option("--progress-lines"),
        },
    ),
    "fit": Command(
        words=("fit", "in.png", "anim.glb", "{tmp}/fit.json", "--preset", "draft",
               "--no-progress"),
        places={"input": 1, "glb": 2, "save_fit": 3},
        rows={
            **TALK, "input": INPUT, **OBJECT, **LENS, **PLATE, **RANGE, **SHOWN,
            **SCALE_ELSEWHERE,
            "chart": option("--chart", "0.2m", nonsense=LENGTHS, code=5),  # no plate here has one
            "save_fit": Row(sense=("{tmp}/other.json",), nonsense=NO_TARGET, codes=(2, 6)),
        },
    ),
    "farm": Command(
        words=("farm", "in.mp4", "anim.glb", "{tmp}/out.mkv", "--preset", "draft", "--fit",
               "fit.json", "--plan"),
        places={"input": 1, "glb": 2, "output": 3},
        rows={
            **TALK, "input": INPUT, **OBJECT, "output": Row(sense=("{tmp}/out.mkv",)),
            **LENS, **OF_A_VIDEO, **EFFECTS, **PLANNED, "no_progress": SHOWN["no_progress"],
            "overwrite": SHOWN["overwrite"],
            **{name: replace(row, code=2) for name, row in OF_SINGLE_RUNS.items()},
            "layers": replace(OBJECT["layers"], nonsense=("",)),
            "workers": option("--workers", "2", nonsense=(*NOT_NUMBERS, "0", "-1", "1.5")),
            "chunk": option("--chunk", "5", nonsense=(*NOT_NUMBERS, "0", "-1")),
            "address": option("--address", "auto", nonsense=("",)),
            "chunks": option("--chunks", "{tmp}/chunks", nonsense=("", "x" * 300)),
            "jobs": option(elsewhere=JOB),
        },
    ),
    "merge": Command(
        words=("merge", "{tmp}/out.mkv", "chunks", "--from", "in.mp4"),
        places={"output": 1, "chunks": 2},
        rows={
            **TALK, **ENCODING, "no_progress": SHOWN["no_progress"],
            **{name: replace(row, code=2) for name, row in OF_A_VIDEO.items()},  # another plate
            "overwrite": SHOWN["overwrite"],
            "output": Row(sense=("{tmp}/out.mkv",), nonsense=RESULTS, codes=(2, 3, 6)),
            "chunks": Row(sense=("chunks",), nonsense=NO_FILE, codes=(2, 3)),
            "input": option("--from", "in.mp4", nonsense=NO_FILE, codes=(2, 3, 6)),
        },
    ),
    "solve": Command(
        words=("solve", "in.png", "{tmp}/camera.json", "--no-progress"),
        places={"input": 1, "output": 2},
        rows={
            **TALK, "input": INPUT, **PLATE, **RANGE, **SCALE, **LINES,
            "overwrite": SHOWN["overwrite"], "no_progress": SHOWN["no_progress"],
            "output": Row(sense=("{tmp}/camera.chan",), nonsense=(*NO_TARGET, "camera.txt"),
                          codes=(2, 6)),
            "fov": option("--fov", "50", nonsense=(*NOT_NUMBERS, "0", "180", "-40")),
            "report": SHOWN["report"],
            "every": option("--every", "2", nonsense=(*NOT_NUMBERS, "-1", "1.5")),
        },
    ),
    "place": Command(
        words=("place", "in.png", "bare.glb", "{tmp}/sheet.png"),
        places={"input": 1, "glb": 2, "output": 3},
        rows={
            **TALK, "input": INPUT, "glb": OBJECT["glb"], **PLATE, **RANGE, **PLACING,
            "output": Row(sense=("{tmp}/sheet.png",), nonsense=RESULTS, codes=(2, 6)),
            "ground_y": OBJECT["ground_y"], "scene": OBJECT["scene"], **PLAYBACK,
            "overwrite": SHOWN["overwrite"], "camera_from": OBJECT["camera_from"],
            "no_grid": option("--no-grid"),
        },
    ),
    "studio": Command(  # a run with sense serves until it is interrupted
        words=("studio", "in.mp4", "bare.glb", "--no-browser"),
        places={"input": 1, "glb": 2},
        rows={
            **{name: row if name in ("help", "version") else replace(row, elsewhere=STUDIO)
               for name, row in TALK.items() if name != "json"},
            "input": replace(INPUT, elsewhere=STUDIO),
            "glb": Row(nonsense=NO_FILE, codes=(2, 4), elsewhere=STUDIO),
            "shot": option("--shot", "new.toml", nonsense=("", "folder/", "text.txt", "x" * 300),
                           elsewhere=STUDIO),
            "port": option("--port", "0", nonsense=(*NOT_NUMBERS, "65536", "-1", "1.5"),
                           elsewhere=STUDIO),
            "host": option("--host", "127.0.0.1", elsewhere=STUDIO,
                           nonsense=("", "0.0.0.0", "no such host", "192.0.2.1", "x" * 300)),
            "i_know_it_is_unencrypted": option("--i-know-it-is-unencrypted", elsewhere=STUDIO),
            "no_browser": option("--no-browser", elsewhere=STUDIO),
        },
    ),
    "check": Command(
        words=("check", "in.png", "--against", "in.png"),
        places={"result": 1},
        rows={
            **TALK, **PLATE, **RANGE, "overwrite": SHOWN["overwrite"],
            "input_transfer": replace(PLATE["input_transfer"], sense=("--input-transfer", "srgb")),
            "result": Row(sense=("in.png",), nonsense=NO_FILE, codes=(2, 3)),
            "input": option("--against", "in.png", nonsense=NO_FILE, codes=(2, 3)),
            "objects": option("--objects", "2", nonsense=(*NOT_NUMBERS, "0", "-1", "1.5")),
            "report": SHOWN["report"], "camera_from": OBJECT["camera_from"],
        },
    ),
    "graph": Command(
        words=("graph", "draft"),
        places={"preset": 1},
        rows={
            **{name: row for name, row in TALK.items() if name != "json"},
            "preset": Row(sense=("paper",), nonsense=("", "fast", "text.txt", "missing.toml")),
            "dot": option("--dot"),
        },
    ),
    "evaluate": Command(
        words=("evaluate", "coc", "folder"),
        places={"what": 1, "folder": 2},
        rows={
            **TALK_ELSEWHERE,
            "what": Row(nonsense=("", "speed"), elsewhere=EVALUATE),
            "folder": Row(nonsense=NO_FILE, codes=(2, 3),
                          elsewhere=EVALUATE),
            "out": option(nonsense=("", "text.txt", "x" * 300, "{tmp}/new"), codes=(2, 3, 6),
                          elsewhere=EVALUATE),
        },
    ),
    "bench": Command(
        words=("bench", "folder"),
        places={"folder": 1},
        rows={
            **TALK_ELSEWHERE,
            "folder": Row(nonsense=NO_FILE, codes=(2, 3),
                          elsewhere=BENCH),
            "out": option(nonsense=("", "text.txt", "x" * 300, "{tmp}/new"), codes=(2, 3, 6),
                          elsewhere=BENCH),
            "quick": option(elsewhere=BENCH),
        },
    ),
    "study make": Command(
        words=("study", "make", "folder", "{tmp}/page.html"),
        places={"folder": 2, "page": 3},
        rows={
            "help": TALK["help"],
            "folder": Row(nonsense=NO_FILE, codes=(2, 3), elsewhere=STUDY_PAGE),
            "page": Row(nonsense=("", "folder", "x" * 300), codes=(2, 3, 6),
                        elsewhere=STUDY_PAGE),
            "overwrite": option(elsewhere=STUDY_PAGE),
            "demo": option(elsewhere=STUDY_DEMO),
            "choices": option(nonsense=("", ","), codes=(2, 3),
                              elsewhere=STUDY_PAGE),
            "things": option(nonsense=("",), elsewhere=STUDY_PAGE),
        },
    ),
    "study analyse": Command(
        words=("study", "analyse", "text.txt"),
        places={"answers": 2},
        rows={
            "help": TALK["help"], "json": option(elsewhere=STUDY_ANALYSIS),
            "answers": Row(nonsense=NO_FILE, codes=(2, 3),
                           elsewhere=STUDY_ANALYSIS),
            "reference": option(nonsense=("", "nosuch"), codes=(2, 3),
                                elsewhere=STUDY_ANALYSIS),
        },
    ),
    "doctor": Command(words=("doctor",), places={}, rows=TALK),
    "completion": Command(
        words=("completion", "bash"),
        places={"shell": 1},
        rows={**TALK, "shell": Row(sense=("zsh",), nonsense=("", "tcsh", "BASH"))},
    ),
}  # fmt: skip

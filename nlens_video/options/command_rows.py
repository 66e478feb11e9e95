"""Options of single commands, and what they read and write."""

from __future__ import annotations

import argparse

from nlens_video.options import files
from nlens_video.options import readers as read
from nlens_video.options.commands import ANALYSE, ANY, BAR, JOBS, MAKE, RUN, SHOT
from nlens_video.options.option import Option

# fmt: off
COMMAND_OPTIONS: dict[str, tuple[Option, ...]] = {
    "": (
        Option("what", ["evaluate"],
               choices=("camera", "coc", "composite", "scene", "sequences", "occlusion"),
               help="solved cameras; the plate's CoC and the lens fit; composites; the rendered "
               "object and its shadow; clips: the lens found against the true one; what walks in "
               "front of an object"),
        Option("folder", ["evaluate"], "FOLDER", read.path, "one subfolder per plate",
               files=files.PLATE_FOLDER),
        Option("folder", ["bench"], "FOLDER", read.path, "plates rendered with their object",
               nargs="?", files=files.PLATE_FOLDER),
        Option("folder", [MAKE], "FOLDER", read.path, "pictures and stimuli.csv", nargs="?",
               files=(files.Files("reads", "FOLDER", files.PICTURES),)),
        Option("page", [MAKE], "OUT.html", read.path, "the page",
               files=(files.Files("writes", "the page"),)),
        Option("answers", [ANALYSE], "ANSWERS", read.path, "JSON or CSV", nargs="+",
               files=(files.Files("reads", "the answers"),)),
        Option("shell", ["completion"], choices=("bash", "zsh", "fish"), help="which shell"),
        Option("preset", ["graph"], "PRESET", help="a preset, or the path of a pipeline file",
               files=files.PIPELINE),
        Option("result", ["check"], "OUT", read.plate_name, "what nlens-video has written",
               files=(files.Files("reads", "the result"),)),
        Option("input", SHOT, "IN", read.plate_name,
               "video, still, plate_%%04d.png, device, URL, -",
               feeds="source.spec", files=files.PLATE),
        Option("input", ["place", "solve"], "IN", read.plate_name, "the plate, as of nlens-video",
               feeds="source.spec", files=files.PLATE),
        Option("output", ["solve"], "CAMERA", read.path, ".json, .glb, .chan or .usda",
               files=files.CAMERA),
        Option("--every", ["solve"], "N", read.count, "frames between keyframes"),
        Option("glb", SHOT, "ANIM.glb", read.path, "the animated object (glTF 2.0)",
               feeds="scene.glb", files=files.SCENE),
        Option("glb", ["place"], "ANIM.glb", read.path, "the object (glTF 2.0)",
               feeds="scene.glb", files=files.SCENE),
        Option("output", ["render"], "OUT", read.result_name,
               "video, still, out_%%04d.png, pipe, URL, -", feeds="output.spec",
               files=(*files.RESULT, files.CHUNK_FOLDER, files.RESUMED_CHUNKS)),
        Option("output", ["farm"], "OUT", read.result_name,
               "video, still, out_%%04d.png, pipe, URL, -",
               feeds="output.spec", files=(*files.RESULT, files.CHUNKS_BESIDE)),
        Option("output", ["merge"], "OUT", read.result_name, "video, out_%%04d.png, pipe, -",
               feeds="output.spec", files=files.RESULT),
        Option("output", ["place"], "OUT.png", read.path, "the contact sheet",
               files=(files.Files("writes", "the contact sheet"),)),
        Option("--no-grid", ["place"], help="leave the grid on the ground out"),
        Option("chunks", ["merge"], "CHUNK", read.path, "files or folders of --chunk-out",
               nargs="+", files=(files.Files("reads", "a chunk", files.CHUNKS),)),
        Option("save_fit", ["fit"], "FIT.json", read.path, "the lens fit to write",
               feeds="run.save_fit", files=(files.Files("writes", "the lens fit"),)),

        Option("-v --verbose", ANY, help="tell more; tracebacks"),
        Option("-q --quiet", ANY, help="errors only"),
        Option("--json", [one for one in ANY if one != "graph"], often=True,
               help="print the summary as JSON"),
        Option("--json", [ANALYSE], default=argparse.SUPPRESS, help="print the tables as JSON"),
        Option("-y --overwrite", (*BAR, "place", "check", MAKE),
               help="replace what is there without asking"),
        Option("--dot", ["graph"], help="Graphviz' language in place of Mermaid"),
        Option("--plate --against", ["check"], "IN", read.plate_name, "its plate", dest="input",
               required=True, feeds="source.spec", files=files.PLATE),
        Option("--plate --from", ["merge"], "IN", read.plate_name, "the plate they were made from",
               dest="input", required=True, feeds="source.spec", files=files.PLATE),
        Option("--max-objects --objects", ["check"], "N", read.count, "separate changed places (1)",
               dest="objects", default=1),
        Option("--report", ["check"], "DIR", read.path, "a page with the plots",
               files=files.REPORT),
        Option("--jobs", [JOBS], "JOBS.toml", read.path,
               "a [[shot]] for each, with in, object, out, and options, a list of words",
               required=True, files=files.READ),
        Option("--out", ["evaluate"], "DIR", read.path, "tables (Markdown, CSV) and plots",
               files=(files.Files("writes", inside=files.TABLES),)),
        Option("--out", ["bench"], "DIR", read.path, "bench.md, bench.csv, bench.png",
               files=(files.Files("writes", inside=files.BENCH),)),
        Option("--quick", ["bench"], help="a coarser truth, fewer frames"),
        Option("--demo", [MAKE], help="pictures of rendered balls on a table"),
        Option("--choices", [MAKE], "LIST", help="answers, such as red,green,blue"),
        Option("--subject --things", [MAKE], "THINGS", help="what is looked for",
               dest="things", default="billiard balls"),
        Option("--reference", [ANALYSE], "METHOD", help="tested against", default="ours"),
        Option("--track-focus", [*RUN, "fit"], "T", read.track_focus,
               "follow a lens that changes: auto, off, or every N frames (files)", default="auto",
               feeds="run.track_focus", parameter=True),
    ),
}
# fmt: on

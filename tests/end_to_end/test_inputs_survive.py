"""No command writes over a file that it reads, whatever the two names look like."""

import pytest
from support.command import nlens, one_line, process

from nlens_video.cli.output_files import file_options
from nlens_video.options.files import CHUNKS

RUN = (
    "{input} {glb} {output} --layers {layers} --holdout {holdout} --env {env} "
    "--camera-from {camera_from} --aperture {aperture} --preset {preset} --fit {fit} "
    "--save-fit {save_fit} --save-shot {save_shot} --timings {timings} --report {report} "
    "--aov {aov}"
)
COMMANDS = {
    "render": f"render {RUN} --keep-partial",
    "render --as-chunk": f"render {RUN} --as-chunk",
    "farm": f"farm {RUN} --chunks {{chunks}}",
    "fit": "fit {input} {glb} {save_fit} --layers {layers} --holdout {holdout} --env {env} "
    "--camera-from {camera_from} --aperture {aperture} --preset {preset} --report {report}",
    "merge": "merge {output} {chunks} --from {input}",
    "solve": "solve {input} {output} --report {report}",
    "place": "place {input} {glb} {output} --camera-from {camera_from}",
    "check": "check {result} --against {input} --camera-from {camera_from} --report {report}",
    "evaluate": "evaluate coc {folder} --out {out}",
    "bench": "bench {folder} --out {out}",
    "study make": "study make {folder} {page}",
}
NAMES = {
    "input": "in.mp4", "glb": "anim.glb", "layers": "layer.exr", "holdout": "matte.png",
    "env": "sky.hdr", "camera_from": "camera.json",
    "aperture": "blades.png", "preset": "own.toml", "fit": "fit.json",
    "result": "result.mp4", "chunks": "chunk.nut", "folder": "plates",
    "output": "out.mp4", "save_fit": "found.json", "save_shot": "kept.toml",
    "timings": "times.json", "report": "report", "aov": "aov", "out": "tables", "page": "page.html",
}  # fmt: skip
FOLDERS = {"render --as-chunk": {"output": "chunks"}, "farm": {"chunks": "chunks"}}


def arguments(form, folder, **changed):
    """A command line in which every word that names a file names one in `folder`."""
    names = {**NAMES, **FOLDERS.get(form, {}), **changed}
    return [
        part.format_map({key: folder / name for key, name in names.items()})
        for part in COMMANDS[form].split()
    ]


def inputs(folder):
    """Files of everything that is read; what they hold does not matter, for none is opened."""
    (folder / "plates").mkdir()
    read = ("input", "glb", "layers", "holdout", "env", "camera_from", "aperture", "preset", "fit")
    for dest in (*read, "result"):
        (folder / NAMES[dest]).write_bytes(f"{dest} of somebody".encode())
    (folder / "chunk.nut").write_bytes(b"a chunk")
    (folder / "plates" / "bg.png").write_bytes(b"a plate")
    (folder / "plates" / "stimuli.csv").write_bytes(b"a list")
    return contents(folder)


def contents(folder):
    return {
        path: path.readlink() if path.is_symlink() else path.read_bytes()
        for path in folder.rglob("*")
        if not path.is_dir()
    }


def pairs():
    """Every word that names a written file, with every word that names a read one."""
    for form in COMMANDS:
        chunk = form.endswith(" --as-chunk")
        row = list(file_options(form.removesuffix(" --as-chunk")))
        for option, files in row:
            alone = not files.inside and files.of is None and not (chunk and files.when)
            for other, read in row if files.role == "writes" and alone else ():
                if read.role == "reads" and other.attribute != "folder":
                    yield form, option.attribute, other.attribute
        if form == "study make":
            yield form, "page", "folder"


@pytest.mark.parametrize(("form", "written", "read"), list(pairs()))
def test_output_that_is_also_an_input_is_refused(tmp_path, form, written, read):
    before = inputs(tmp_path)
    name = "plates/stimuli.csv" if read == "folder" else NAMES[read]
    line = one_line(nlens(*arguments(form, tmp_path, **{written: name})), 6)
    assert "as well; give it another name" in line
    assert contents(tmp_path) == before


@pytest.mark.parametrize("form", [form for form in COMMANDS if "{report}" in COMMANDS[form]])
def test_report_over_an_input_is_refused(tmp_path, form):
    before = inputs(tmp_path)
    (tmp_path / "in.mp4").rename(tmp_path / "index.html")
    line = one_line(nlens(*arguments(form, tmp_path, input="index.html", report=".")), 6)
    assert "is the folder of the plate as well; give another folder" in line
    assert len(contents(tmp_path)) == len(before)


@pytest.mark.parametrize(
    ("form", "written", "read", "name"),
    [
        ("render", "aov", "layers", "000003.exr"),
        ("render --as-chunk", "output", "fit", f"fit-{'0' * 16}.json"),
        ("farm", "chunks", "fit", f"fit-{'0' * 16}.json"),
        ("bench", "out", "folder", "bg.png"),
    ],
)
def test_output_folder_that_holds_an_input_is_refused(tmp_path, form, written, read, name):
    inputs(tmp_path)
    (tmp_path / "both").mkdir()
    (tmp_path / "both" / name).write_bytes(b"of somebody")
    given = {written: "both", read: f"both/{name}"}
    if form == "bench":
        (tmp_path / "both" / "bench.md").symlink_to(tmp_path / "plates" / "bg.png")
        given = {written: "both"}
    before = contents(tmp_path)
    line = one_line(nlens(*arguments(form, tmp_path, **given)), 6)
    assert "is the folder of" in line
    assert contents(tmp_path) == before


def test_side_files_of_the_result_may_not_be_inputs(tmp_path):
    """The part that an interrupted run has kept, and the lens that lies among its chunks."""
    inputs(tmp_path)
    (tmp_path / "in.mp4").rename(tmp_path / "out.partial.mp4")
    kept = nlens(*arguments("render", tmp_path, input="out.partial.mp4"))
    assert "the part that --keep-partial keeps" in one_line(kept, 6)
    assert "is the plate as well" in kept.stderr
    (tmp_path / "out.mp4.chunks").mkdir()
    fit = f"out.mp4.chunks/fit-{'0' * 16}.json"
    (tmp_path / fit).write_text("{}")
    resumed = nlens(*arguments("render", tmp_path, fit=fit), "--resume")
    assert "is the folder of --fit as well" in one_line(resumed, 6)


@pytest.fixture
def shot(tmp_path, monkeypatch):
    """A plate, a sequence and a scene of several files, each under several names."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "plate.png").write_bytes(b"a plate")
    (tmp_path / "symbolic.png").symlink_to("plate.png")
    (tmp_path / "hard.png").hardlink_to(tmp_path / "plate.png")
    (tmp_path / "here").symlink_to(tmp_path)
    for number in (1, 2):
        (tmp_path / f"s{number:04d}.png").write_bytes(b"a plate")
    (tmp_path / "other_0001.png").symlink_to("s0002.png")
    (tmp_path / "anim.gltf").write_text(
        '{"buffers": [{"uri": "data.bin"}],'
        ' "images": [{"uri":"my%20wood.png"}, {"uri": "t\\u00e9.png"}]}'
    )
    for name in ("data.bin", "my wood.png", "té.png", "seg 1.ts", "seg2.ts"):
        (tmp_path / name).write_bytes(b"a part")
    (tmp_path / "list.m3u8").write_text("#EXTM3U\n#EXTINF:1,\nseg 1.ts\n#EXTINF:1,\nseg2.ts\n")
    (tmp_path / "list.ffconcat").write_text("ffconcat version 1.0\nfile 'seg 1.ts'\nfile seg2.ts\n")
    return tmp_path


@pytest.mark.parametrize("command", ["render", "place"])
@pytest.mark.parametrize(
    ("plate", "output"),
    [
        ("plate.png", "plate.png"),
        ("plate.png", "./here/plate.png"),
        ("plate.png", "../{folder}/plate.png"),
        ("{path}/plate.png", "plate.png"),
        ("plate.png", "symbolic.png"),
        ("symbolic.png", "plate.png"),
        ("plate.png", "hard.png"),
        ("file:plate.png", "plate.png"),
        ("plate.png", "file:plate.png"),
        ("file://{path}/plate.png", "plate.png"),
        ("s%04d.png", "s0001.png"),
        ("s%04d.png", "here/s0002.png"),
        ("s%d.png", "s1.png"),
        ("s0001.png", "s%04d.png"),
        ("s%04d.png", "s%04d.png"),
        ("s%04d.png", "s%d.png"),
        ("s%04d.png", "other_%04d.png"),
        ("s%04d.png", "other_0001.png"),
        ("file:s%04d.png", "s0001.png"),
    ],
)
def test_plate_is_recognised_under_all_its_names(shot, command, plate, output):
    if plate == "s%d.png":
        (shot / "s1.png").write_bytes(b"a plate")
    if output == "s%d.png":
        (shot / "s1000.png").write_bytes(b"a plate")
        plate = "s%d.png"
    before = contents(shot)
    given = [name.format(path=shot, folder=shot.name) for name in (plate, output)]
    line = one_line(nlens(command, given[0], "anim.glb", given[1]), 6)
    assert "is the plate as well; give it another name" in line
    assert contents(shot) == before


@pytest.mark.parametrize("name", ["data.bin", "my wood.png", "té.png"])
def test_buffers_and_textures_of_the_scene_are_not_overwritten(shot, name):
    run = nlens("fit", "plate.png", "anim.gltf", name)
    assert "is a file of the scene as well" in one_line(run, 6)


@pytest.mark.parametrize("plate", ["list.m3u8", "list.ffconcat"])
@pytest.mark.parametrize("name", ["seg 1.ts", "seg2.ts"])
def test_files_listed_in_a_playlist_are_not_overwritten(shot, plate, name):
    run = nlens(plate, "anim.gltf", name)
    assert "is a file of the plate as well" in one_line(run, 6)


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (
            ["--save-fit", "x.json", "--timings", "x.json"],
            "--timings x.json: is --save-fit as well",
        ),
        (["--timings", "out.mp4"], "--timings out.mp4: is the result as well"),
        (["--timings", "r/index.html", "--report", "r"], "--report r: is the folder of --timings"),
        (["--fit", "fit.json", "--save-fit", "fit.json"], "--save-fit fit.json: is --fit as well"),
    ],
)
def test_two_options_cannot_write_the_same_file(shot, more, words):
    assert words in one_line(nlens("plate.png", "anim.gltf", "out.mp4", *more), 6)


def test_shots_of_a_list_cannot_overwrite_each_others_plates(shot):
    def listed(*outputs):
        entries = [
            f'[[shot]]\nin = "{plate}"\nobject = "anim.gltf"\nout = "{out}"\n'
            for plate, out in zip(("plate.png", "s0001.png"), outputs, strict=True)
        ]
        (shot / "jobs.toml").write_text("\n".join(entries))
        return nlens("farm", "--jobs", "jobs.toml")

    before = contents(shot)
    assert "the result symbolic.png: is the plate as well" in one_line(
        listed("a.mp4", "symbolic.png"), 6
    )
    assert "the result jobs.toml: is --jobs as well" in one_line(listed("jobs.toml", "b.mp4"), 6)
    assert {**contents(shot), shot / "jobs.toml": b""} == {**before, shot / "jobs.toml": b""}


def test_merge_cannot_overwrite_its_chunks(shot):
    (shot / "chunks").mkdir()
    (shot / "chunks" / "a.nut").write_bytes(b"a chunk")
    run = nlens("merge", "chunks/a.nut", "chunks", "--from", "plate.png")
    assert "is a chunk as well" in one_line(run, 6)
    assert CHUNKS[0] == "*.nut"


def test_preset_and_aperture_names_are_not_taken_for_files(shot):
    """A file that is called as a preset is, is not in the way."""
    (shot / "standard").write_bytes(b"of somebody")
    run = nlens("plate.png", "none.glb", "out.png", "--save-fit", "standard", "--plan")
    assert "as well" not in run.stderr


@pytest.mark.parametrize("given", ["-", "/dev/stdin", "pipe:0", "/proc/self/fd/0"])
def test_result_does_not_replace_the_file_on_standard_input(tmp_path, given):
    plate = tmp_path / "in.mkv"
    plate.write_bytes(b"a plate")
    with plate.open("rb") as stdin:
        run = process(given, tmp_path / "anim.glb", plate, "-y", stdin=stdin)
        _, told = run.communicate(timeout=60)
    assert run.returncode == 6 and b"is standard input as well" in told
    assert plate.read_bytes() == b"a plate"


@pytest.mark.parametrize("given", ["-", "/dev/stdout"])
@pytest.mark.parametrize("mode", ["ab", "r+b"])
def test_standard_output_does_not_go_into_the_plate(tmp_path, given, mode):
    plate = tmp_path / "in.mkv"
    plate.write_bytes(b"a plate")
    with plate.open(mode) as stdout:
        run = process(plate, tmp_path / "anim.glb", given, "-y", stdout=stdout)
        _, told = run.communicate(timeout=60)
    assert run.returncode == 6 and b"is the plate as well" in told
    assert plate.read_bytes() == b"a plate"

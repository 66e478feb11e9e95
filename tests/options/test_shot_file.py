"""Shot files: they mean what a command line means, and say what is wrong with them."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlens_video.core.errors import UsageError
from nlens_video.options.parser import parse
from nlens_video.options.shot_file import TABLES
from nlens_video.options.shot_objects import LISTED
from nlens_video.options.shot_writer import save
from nlens_video.options.table import ROWS
from nlens_video.options.to_settings import settings as settings_of

NOT_OF_THE_SHOT = {
    "verbose", "quiet", "json", "overwrite", "no_progress", "plan", "as_chunk", "resume",
    "save_shot", "progress_lines",
}  # fmt: skip
WHOLE = """\
version = 1
[plate]
file = "plates/in.mp4"
range = "4:20"
[object]
file = "anim.glb"
loop = true
[place]
at = [0.5, -0.25]
size = 0.3
[effects]
shutter = 90
ground-reflectance = true
[output]
file = "out.mp4"
"""


def shot(folder, text):
    """A shot file, and the plate that it names."""
    path = folder / "shot.toml"
    path.write_text(text)
    return str(path)


def saved(words, path):
    """What `--save-shot` writes of a command line."""
    args = parse([*words, "--save-shot", str(path)])
    save(args.save_shot, args.given)
    return tomllib.loads(path.read_text())


def same_settings(one, other):
    assert settings_of(one) == settings_of(other)


def test_every_option_of_a_run_is_in_one_table_or_left_out_on_purpose():
    held = [attribute for table in TABLES.values() for attribute in table]
    assert len(held) == len(set(held))
    of_a_run = {row.attribute for row in ROWS if "render" in row.commands}
    assert set(held) | set(LISTED) | NOT_OF_THE_SHOT == of_a_run


def test_shot_file_means_what_the_command_line_means(tmp_path):
    args = parse([shot(tmp_path, WHOLE)])
    same_settings(
        args,
        parse([
            f"{tmp_path}/plates/in.mp4", f"{tmp_path}/anim.glb", f"{tmp_path}/out.mp4",
            "--range", "4:20", "--loop", "--at", "0.5,-0.25", "--size", "0.3", "--shutter", "90",
            "--reflect",
        ]),
    )  # fmt: skip


def test_options_after_a_shot_file_win(tmp_path):
    path = shot(tmp_path, WHOLE)
    args = parse([path, "--shutter-angle", "45", "--siz", "0.5", "--frame", "7"])
    assert (args.shutter, args.size, args.range) == (45.0, 0.5, (7, 8))


@pytest.mark.parametrize(
    ("option", "kept"),
    [
        ("--animation=1", ("animation_speed", 0.5)),
        ("--at=0.5,0.9", ("at_frame", 3)),
        ("--env=studio", ("env_exposure", 1.0)),
        ("--fit=lens.json", ("fit_region", "0,0.5,1,1")),
    ],
)
def test_option_after_a_shot_file_leaves_those_whose_names_begin_alike(tmp_path, option, kept):
    text = WHOLE.replace("at =", "at-frame = 3\nat =").replace(
        "loop =", "animation-speed = 0.5\nloop ="
    )
    text += '[light]\nenv-exposure = 1.0\n[lens]\nfit-region = "0,0.5,1,1"\n'
    attribute, value = kept
    before = getattr(parse([shot(tmp_path, text)]), attribute)
    assert before is not None
    assert getattr(parse([shot(tmp_path, text), option]), attribute) == before


@pytest.mark.parametrize(
    "words",
    [["look.png", "--frame", "7"], ["--frame", "7", "look.png"], ["-q", "look.png", "--frame=7"]],
)
def test_result_after_a_shot_file_wins(tmp_path, words):
    args = parse([shot(tmp_path, WHOLE), *words])
    assert (args.output, args.range, args.size) == ("look.png", (7, 8), 0.3)
    assert parse(["farm", shot(tmp_path, WHOLE), "-"]).output == "-"


def test_shot_file_without_a_result_takes_the_one_after_it(tmp_path):
    path = shot(tmp_path, WHOLE.partition("[output]")[0])
    assert parse([path, "o.mp4"]).output == "o.mp4"
    with pytest.raises(UsageError, match="names no output"):
        parse([path])


def test_second_result_after_a_shot_file_is_refused(tmp_path):
    with pytest.raises(UsageError, match=r"unrecognized arguments: b\.png"):
        parse([shot(tmp_path, WHOLE), "a.png", "b.png"])


def test_fit_and_farm_take_from_a_shot_file_what_they_have_options_for(tmp_path):
    text = WHOLE + '[quality]\npreset = "draft"\n'
    fitted = parse(["fit", shot(tmp_path, text), "fit.json", "--fallback", "constant"])
    assert (fitted.save_fit, fitted.fallback) == (Path("fit.json"), "constant")
    assert parse(["farm", shot(tmp_path, text), "--workers", "1"]).preset == "draft"


def test_numbered_files_that_are_read_are_named_from_the_shots_folder(tmp_path, monkeypatch):
    for name in ("p_0001.png", "m_0001.png", "z_0001.exr", "anim.glb"):
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    (tmp_path / "shots").mkdir()
    words = ["p_%04d.png", "anim.glb", "o_%04d.png", "--holdout", "m_%04d.png"]
    content = saved(words, tmp_path / "shots" / "a.toml")
    assert content["plate"]["file"] == "../p_%04d.png"
    assert content["effects"]["holdout"] == "../m_%04d.png"
    hashes = ["p_####.png", "anim.glb", "o.png", "--layers", "z_####.exr"]
    content = saved(hashes, tmp_path / "shots" / "b.toml")
    assert content["plate"]["file"].startswith("../p_")
    assert content["object"]["layers"].startswith("../z_")
    absent = ["q_%04d.png", "anim.glb", "o.png"]
    assert saved(absent, tmp_path / "shots" / "c.toml")["plate"]["file"] == "q_%04d.png"


def test_saved_shot_file_means_the_same(tmp_path, monkeypatch):
    (tmp_path / "plates").mkdir()
    for name in ("plates/in.mp4", "anim.glb", "fit.json", "sky.hdr"):
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path / "plates")
    words = [
        "in.mp4", "../anim.glb", "../out/o.mp4", "--at=-0.5,0.25", "--size", "0.30", "--loop",
        "--env", "../sky.hdr", "--fit", "../fit.json", "--frame", "12", "--reflect", "--crf", "18",
        "--lens", "50mm f/2.8", "--input-rate", "30000/1001", "--animation", "1.50",
    ]  # fmt: skip
    (tmp_path / "shots").mkdir()
    path = tmp_path / "shots" / "a.toml"
    content = saved(words, path)
    assert content["plate"] == {"file": "../plates/in.mp4", "frame": 12, "input-rate": "30000/1001"}
    assert content["object"] == {"file": "../anim.glb", "animation": "1.50", "loop": True}
    assert content["place"] == {"at": [-0.5, 0.25], "size": "0.30"}
    again = parse([str(path)])
    expected = parse(words)
    expected.shot_file = path
    for attribute, value in vars(expected).items():
        read = getattr(again, attribute)
        if attribute in {"input", "glb", "output", "env", "fit"}:
            value, read = Path(value).resolve(), Path(read).resolve()
        assert read == value, attribute


numbers = st.one_of(st.integers(-999, 999), st.floats(-1e3, 1e3)).map(str)
words = st.one_of(
    numbers, st.lists(numbers, min_size=2, max_size=4).map(",".join), st.text(min_size=1)
)


@settings(max_examples=50)
@given(name=words.filter(lambda text: text.strip() and text.isprintable()))
def test_any_text_is_read_back_as_it_was(tmp_path_factory, name):
    path = tmp_path_factory.mktemp("shot") / "a.toml"
    saved(["in.mp4", "a.glb", "o.mp4", f"--animation={name}"], path)
    assert parse([str(path)]).animation == name


def test_number_that_toml_does_not_have_is_saved_as_a_text(tmp_path):
    long = "9" * 5000
    assert saved(["in.mp4", "a.glb", "o.mp4", f"--at={long},1"], tmp_path / "a.toml")["place"] == {
        "at": f"{long},1"
    }


def test_streams_devices_and_environments_by_name_are_no_paths(tmp_path):
    text = """\
version = 1
[plate]
file = "testsrc=size=64x64"
input-format = "lavfi"
[object]
file = "a.glb"
[light]
env-map = "plate"
[quality]
preset = "draft"
[output]
file = "-"
"""
    args = parse([shot(tmp_path, text)])
    assert args.input == "testsrc=size=64x64"
    assert (args.output, args.preset, args.env) == ("-", "draft", parse_env("plate"))


def parse_env(word):
    return parse(["in.mp4", "a.glb", "o.mp4", "--env", word]).env


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("version 1", "cannot be read as a shot file"),
        ("[plate]\n", "says no version; a shot file begins with version = 1, or with"),
        ("version = 3\n", "has version 3; a shot file begins with version = 1, or with"),
        ("version = true\n", "has version True"),
        ("version = 1\n[plat]\n", "there is no table [plat]; did you mean plate?"),
        ("version = 1\n[xyz]\n", "there is no table [xyz]; there are plate, object"),
        ("version = 1\nplate = 3\n", "plate is no table; begin it with the line [plate]"),
        ("version = 1\n[place]\nsise = 3\n", "there is no sise in [place]; did you mean size?"),
        ("version = 1\n[place]\nfile = 'a'\n", "there is no file in [place]; there are at"),
        ("version = 1\n[place]\nfov = 30\n", "[place] fov: belongs into [camera]"),
        ("version = 1\n[place]\nsize = {}\n", "[place] size: expected a text, a number"),
        ("version = 1\n[place]\nat = []\n", "[place] at: expected a text, a number"),
        ("version = 1\n[place]\nat = [true, 1]\n", "[place] at: expected a text, a number"),
        ("version = 1\n[object]\nanimation = ''\n", "animation: expected a text"),
        ("version = 1\n[plate]\nrange = '0:2'\nframe = 3\n", "frame and range exclude each other"),
        ("version = 1\n[plate]\nfile = 'a'\n", 'names no object; give file = "…" under [object]'),
        (WHOLE.replace("0.3", "'big'"), "argument --size: 'big' is not a number"),
        (WHOLE.replace("90", "true"), "--shutter"),
        (WHOLE.replace("plates/in", r"a\u0000b"), "[plate] file: has a NUL character"),
        (WHOLE.replace("out.mp4", r"a\u0000b"), "[output] file: has a NUL character"),
        (WHOLE + '[camera]\ncamera-from = "a\\u0000b"\n', "camera-from: has a NUL"),
        (WHOLE + '[lens]\nfit = "a\\u0000b"\n', "[lens] fit: has a NUL character"),
        (f"a = {'[' * 20_000}", "nested too deeply"),
        (f"version = 0x{'f' * 20_000}", "a whole number has more than 64 bits"),
    ],
)
def test_mistakes_are_told_with_the_name_of_the_file(tmp_path, text, said):
    path = shot(tmp_path, text)
    with pytest.raises(UsageError) as caught:
        parse([path])
    assert said in str(caught.value)
    assert str(caught.value).startswith(path)


def test_missing_shot_file_is_told():
    with pytest.raises(UsageError, match="none.toml: cannot be read as a shot file"):
        parse(["none.toml"])


def test_aperture_by_its_blades_is_no_file(tmp_path):
    path = shot(tmp_path, WHOLE + '[lens]\naperture = "6:15:0.2"\n')
    assert parse([path]).aperture == "6:15:0.2"


def test_switched_off_options_are_not_given(tmp_path):
    assert parse([shot(tmp_path, WHOLE.replace("loop = true", "loop = false"))]).loop is False

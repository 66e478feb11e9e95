"""Shot files of several objects and of keys: what they mean, how they are kept, what is refused."""

import tomllib
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlens_video.core.errors import UsageError
from nlens_video.core.objects import FurtherObject, PlaceKey, PlaceKeys, Playback
from nlens_video.core.placement import GroundPlacing
from nlens_video.options.parser import parse
from nlens_video.options.shot_file import read_tables, words_by
from nlens_video.options.shot_writer import save, save_tables
from nlens_video.options.to_settings import settings as settings_of
from nlens_video.options.toml_words import inline, table_of

HEAD = 'version = 2\n[plate]\nfile = "in.mp4"\n[output]\nfile = "out.mp4"\n'
SEVERAL = (
    HEAD
    + """\
[[object]]
file = "fox.glb"
animation = "Run"
loop = true
size = 0.3
footprint = "fox"
[[object.key]]
frame = 48
at = [0.7, 0.9]
yaw = 90
[[object.key]]
frame = 0
at = [0.2, 0.8]
[[object]]
file = "props/ball.glb"
at = [0.6, 0.8]
yaw = -30
interpolation = "linear"
[[object.key]]
time = 0.5
size = 0.2
[[object]]
file = "props/hen.glb"
animation-speed = 2
ground-y = -0.1
"""
)


def shot(folder, text):
    path = folder / "shot.toml"
    path.write_text(text)
    return path


def meaning(words):
    return settings_of(parse([str(word) for word in words]))


def test_objects_and_keys_mean_what_they_say(tmp_path):
    found = meaning([shot(tmp_path, SEVERAL)]).scene
    assert (found.glb, found.footprint) == (tmp_path / "fox.glb", "fox")
    assert found.playback == Playback(animation="Run", loop=True)
    first, second = (PlaceKey(frame=0, at=(0.2, 0.8)),
                     PlaceKey(frame=48, at=(0.7, 0.9), yaw_deg=90.0))  # fmt: skip
    assert found.keys == PlaceKeys(keys=(first, second), interpolation="smooth")
    assert found.on_ground == GroundPlacing(at=(0.2, 0.8), size=0.3, yaw_deg=90.0)
    ball, hen = found.others
    assert ball == FurtherObject(
        glb=tmp_path / "props" / "ball.glb",
        placing=GroundPlacing(at=(0.6, 0.8), yaw_deg=-30.0),
        keys=PlaceKeys(keys=(PlaceKey(time_s=0.5, size=0.2),), interpolation="linear"),
    )
    assert (hen.placing, hen.ground_y, hen.playback.speed) == (None, -0.1, 2.0)


def test_one_listed_object_makes_the_same_words_as_the_tables_of_one(tmp_path):
    classic = HEAD.replace("2", "1") + (
        '[object]\nfile = "fox.glb"\nloop = true\n[place]\nat = [0.4, 0.8]\nsize = 0.3\n'
    )
    listed = HEAD + '[[object]]\nfile = "fox.glb"\nat = [0.4, 0.8]\nloop = true\nsize = 0.3\n'
    one, other = (
        set(words_by(read_tables(path), path))
        for path in (shot(tmp_path, text) for text in (classic, listed))
    )
    assert one == other


def test_saved_objects_are_named_from_the_shots_folder_and_mean_the_same(tmp_path, monkeypatch):
    for name in ("in.mp4", "fox.glb", "ball.glb"):
        (tmp_path / name).touch()
    monkeypatch.chdir(tmp_path)
    words = [
        "in.mp4", "fox.glb", "out.mp4", "--size", "0.3",
        "--key", "{time = 0, at = [0.2, 0.8]}", "--key", "{time = 2, at = [0.7, 0.9]}",
        "--interpolation", "linear",
        "--object", '{file = "ball.glb", at = [0.5, 0.9], size = 0.1, key = [{time = 1, yaw = 9}]}',
    ]  # fmt: skip
    (tmp_path / "shots").mkdir()
    kept = tmp_path / "shots" / "a.toml"
    args = parse([*words, "--save-shot", str(kept)])
    save(kept, args.given)
    content = tomllib.loads(kept.read_text())
    assert content["version"] == 2 and "place" not in content
    assert content["object"][0] == {
        "file": "../fox.glb", "size": 0.3, "interpolation": "linear",
        "key": [{"time": 0, "at": [0.2, 0.8]}, {"time": 2, "at": [0.7, 0.9]}],
    }  # fmt: skip
    assert content["object"][1]["file"] == "../ball.glb"
    assert "[[object.key]]" in kept.read_text()
    expected, read = meaning(words).scene, meaning([kept]).scene
    assert (read.keys, read.on_ground) == (expected.keys, expected.on_ground)
    assert [one.glb.resolve() for one in read.others] == [tmp_path / "ball.glb"]
    assert read.others[0].keys == expected.others[0].keys


def test_saving_a_shot_of_several_objects_again_changes_nothing_in_it(tmp_path):
    path = shot(tmp_path, SEVERAL)
    args = parse([str(path), "--save-shot", str(tmp_path / "again.toml")])
    save(tmp_path / "again.toml", args.given)
    assert meaning([tmp_path / "again.toml"]).scene == meaning([path]).scene


def test_edited_tables_keep_comments_of_objects_that_are_the_same(tmp_path):
    text = SEVERAL.replace('file = "fox.glb"', 'file = "fox.glb"  # from the zoo')
    path = shot(tmp_path, text)
    tables = read_tables(path)
    tables["effects"] = {"shutter-angle": 90}
    save_tables(path, tables)
    assert "# from the zoo" in path.read_text()
    tables["object"] = tables["object"][:1]
    save_tables(path, tables)
    kept = read_tables(path)
    assert kept == tables
    assert kept["object"][0]["key"][0] == {"frame": 48, "at": [0.7, 0.9], "yaw": 90}
    tables["object"] = {"file": "fox.glb"}
    save_tables(path, tables)
    assert path.read_text().startswith("version = 1") and read_tables(path) == tables


def test_options_after_a_shot_file_replace_its_keys_and_other_objects(tmp_path):
    path = shot(tmp_path, SEVERAL)
    found = meaning([path, "--key", "{time = 0, at = [0.5, 0.8]}"]).scene
    assert len(found.keys.keys) == 1 and len(found.others) == 2
    found = meaning([path, "--object", '{file = "b.glb", at = [0.1, 0.9], size = 0.1}']).scene
    assert [one.glb for one in found.others] == [Path("b.glb")] and len(found.keys.keys) == 2


OBJECTS = '[[object]]\nfile = "a.glb"\nat = [0.5, 0.8]\nsize = 0.2\n'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (HEAD.replace("2", "1") + OBJECTS, "begins with version = 2"),
        (HEAD.replace("2", "3") + OBJECTS, r"version 3; .* or with version = 2 if it has \[\[obj"),
        (HEAD + OBJECTS + "[place]\nyaw = 3\n", r"\[place\] is of a single"),
        ('object = ["a.glb"]\n' + HEAD, r"begin each with \[\[object\]\]"),
        (HEAD + OBJECTS + "siez = 1\n", r"\[\[object\]\] 1: there is no siez; did you mean size"),
        (HEAD + OBJECTS + "env-rotation = 1\n", "env-rotation belongs into .light"),
        (HEAD + OBJECTS + OBJECTS + "yaaw = 1\n", r"\[\[object\]\] 2: .*did you mean yaw"),
        (HEAD + OBJECTS + OBJECTS + 'camera = "c"\n', "camera is of the shot; give"),
        (HEAD + OBJECTS + "[[object]]\nsize = 0.2\n", "2: an object needs its file"),
        (HEAD + OBJECTS + '[[object]]\nfile = "b.glb"\nsize = 0.2\n', r"give at = \[X, Y\] too"),
        (HEAD + OBJECTS + '[[object]]\nfile = "b.glb"\nat = [0.2, 0.8]\n', "give size or height"),
        (HEAD + OBJECTS + "key = 3\n", "key is no list of tables"),
        (HEAD + OBJECTS + "interpolation = 3\n", "interpolation: "),
        (HEAD + OBJECTS + "[[object.key]]\ntime = 1\nyav = 3\n", "no yav here; did you mean yaw"),
        (HEAD + OBJECTS + "[[object.key]]\ntime = 1\nat = [0.2, 0.8]\n", "at is given for all of"),
        (HEAD + OBJECTS + "[[object.key]]\ntime = 1\nheight = 3\n", "size is given for all of"),
        (HEAD + OBJECTS + "[[object.key]]\ntime = 1\n", "the key at 1 s gives nothing"),
        (HEAD + OBJECTS + "[[object.key]]\nyaw = 1\n", "needs its moment"),
        (HEAD + OBJECTS + 2 * "[[object.key]]\ntime = 1\nyaw = 1\n", "two keys give yaw at 1 s"),
        (HEAD + OBJECTS + "[[object.key]]\ntime = 1\nyaw = 1\n[[object.key]]\nframe = 2\nyaw = 1\n",
         "times or frames, not both"),
        (HEAD + OBJECTS + "[[object.key]]\ntime = 1979-05-27\nyaw = 1\n", "time: expected"),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused_in_one_line(tmp_path, text, words):
    path = shot(tmp_path, text)
    with pytest.raises(UsageError, match=words) as told:
        meaning([path])
    assert str(path) in str(told.value) and "\n" not in str(told.value)


plain = st.recursive(
    st.one_of(
        st.booleans(), st.integers(-(2**63), 2**63 - 1), st.floats(allow_nan=False),
        st.text(st.characters(blacklist_categories=["Cs"])),
    ),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text("ab-_1 é\"\n"), inner,
                                                                max_size=3),
    max_leaves=8,
)  # fmt: skip


@settings(max_examples=200)
@given(st.dictionaries(st.text("abc-.é\x7f"), plain, max_size=3))
def test_inline_tables_read_back_as_they_were(table):
    assert table_of(inline(table)) == table

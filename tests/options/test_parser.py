"""Parsing of the command line: suggestions, former names, abbreviations."""

import pytest
from support.command import nlens, one_line

from nlens_video.options import parser


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["rendr", "in.mp4", "a.glb", "o.mp4"], "'rendr' is neither a command nor a file; did you"),
        (["help"], "commands are render, fit"),
        (["in.mp4", "a.glb", "o.mp4", "--efects", "none"], "did you mean --effects?"),
        (["--efects=none", "in.mp4", "a.glb", "o.mp4"], "did you mean --effects?"),
        (["in.mp4", "a.glb", "o.mp4", "--zzz"], "not an option; see nlens-video render --help"),
        (["check", "o.mp4", "--agianst", "in.mp4"], "did you mean --against? See nlens-video ch"),
        (["study", "make", "--dmo", "o.html"], "did you mean --demo? See nlens-video study make"),
        (["in.mp4", "a.glb", "o.mp4", "--re"], "--re could match --reflect"),
        (["", "a.glb", "o.mp4"], "argument IN: is empty"),
        (["in.mp4", "a.glb", "o.mp4", "--camera", ""], "argument --camera: is empty"),
        (["in.mp4", "a.glb", "o.mp4", "--save-fit", ""], "argument --save-fit: is empty"),
        (["in.mp4", "a.glb", "o.mp4", "--ground-y", "nan"], "'nan' is not a number"),
    ],
)
def test_typing_errors_get_a_suggestion(words, said):
    assert said in one_line(nlens(*words), 2)


@pytest.mark.parametrize(
    ("former", "now", "attribute"),
    [
        ("--hold-budget", "--adaptive-quality", "hold_budget"),
        ("--late drop", "--on-late drop", "late"),
        ("--env a.hdr", "--env-map a.hdr", "env"),
        ("--shutter 90", "--shutter-angle 90", "shutter"),
        ("--footprint near", "--footprint-node near", "footprint"),
        ("--reflect 0.2", "--ground-reflectance 0.2", "reflect"),
        ("--as-chunk", "--chunk-out", "as_chunk"),
        ("farm --chunk 5", "farm --chunk-seconds 5", "chunk"),
        ("farm --chunks kept", "farm --chunk-store kept", "chunks"),
        ("check --against p.mp4", "check --plate p.mp4", "input"),
        ("check --plate p.mp4 --objects 2", "check --plate p.mp4 --max-objects 2", "objects"),
        ("merge --from p.mp4", "merge --plate p.mp4", "input"),
        ("study make --things cups", "study make --subject cups", "things"),
    ],
)
def test_former_option_names_are_accepted(former, now, attribute):
    more = {"check": ["o.mp4"], "merge": ["o.mp4", "c.nut"], "study": ["o.html"]}
    parsed = [
        vars(parser.parse([*words, *more.get(words[0], ["i.mp4", "a.glb", "o.mp4"])]))
        for words in (former.split(), now.split())
    ]
    plain = parser.parser_of("render").get_default(attribute)
    assert parsed[0] == parsed[1] and parsed[0][attribute] not in (None, False, plain)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ("--json check o.mkv --plate p.mkv", "check o.mkv --plate p.mkv --json"),
        ("-q --json doctor", "doctor -q --json"),
        ("--json study analyse x.json", "study analyse x.json --json"),
        ("-y fit p.mkv a.glb fit.json", "fit p.mkv a.glb fit.json -y"),
        ("-q p.mkv a.glb o.mkv", "p.mkv a.glb o.mkv -q"),
    ],
)
def test_general_options_may_stand_before_a_command(before, after):
    assert vars(parser.parse(before.split())) == vars(parser.parse(after.split()))


def test_option_with_two_names_can_be_abbreviated():
    assert parser.parse(["i.mp4", "a.glb", "o.mp4", "--foot", "near"]).footprint == "near"


def test_control_characters_in_a_file_name_are_escaped_in_messages():
    line = one_line(nlens("no\x1b[2Jsuch.mp4", "a.glb", "o.mp4"), 3)
    assert "no\\x1b[2Jsuch.mp4" in line


def test_value_beginning_with_a_minus_needs_no_equals_sign():
    words = parser.parse(
        ["in.mp4", "a.glb", "-", "--distortion", "-0.1,0.02", "--at", "-0.1,0.5", "--yaw", "-30",
         "--effects", "-grain,+shadow", "-q"]
    )  # fmt: skip
    assert words.distortion == (-0.1, 0.02) and words.at == (-0.1, 0.5) and words.yaw == -30
    assert words.effects == "-grain,+shadow" and words.quiet and words.output == "-"

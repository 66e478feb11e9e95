"""The words of the command line: what was meant by those that are not known."""

import pytest
from support.command import nlens, one_line

from nlens_video.options import options


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["rendr", "in.mp4", "a.glb", "o.mp4"], "'rendr' is neither a command nor a file; did you"),
        (["help"], "commands are render, fit"),
        (["in.mp4", "a.glb", "o.mp4", "--efects", "none"], "did you mean --effects?"),
        (["--efects=none", "in.mp4", "a.glb", "o.mp4"], "did you mean --effects?"),
        (["in.mp4", "a.glb", "o.mp4", "--zzz"], "--zzz is not an option; see nlens-video --help"),
        (["check", "o.mp4", "--agianst", "in.mp4"], "did you mean --against? See nlens-video ch"),
        (["study", "make", "--dmo", "o.html"], "did you mean --demo? See nlens-video study make"),
        (["in.mp4", "a.glb", "o.mp4", "--re"], "--re could match --reflect"),
        (["", "a.glb", "o.mp4"], "argument IN: is empty"),
        (["in.mp4", "a.glb", "o.mp4", "--camera", ""], "argument --camera: is empty"),
        (["in.mp4", "a.glb", "o.mp4", "--save-fit", ""], "argument --save-fit: is empty"),
        (["in.mp4", "a.glb", "o.mp4", "--ground-y", "nan"], "'nan' is not a number"),
    ],
)
def test_slips_of_the_hand_are_told_with_what_was_meant(words, said):
    assert said in one_line(nlens(*words), 2)


def test_value_that_begins_with_a_minus_needs_no_equals_sign():
    words = options.parse(
        ["in.mp4", "a.glb", "-", "--distortion", "-0.1,0.02", "--at", "-0.1,0.5", "--yaw", "-30",
         "--effects", "-grain,+shadow", "-q"]
    )  # fmt: skip
    assert words.distortion == (-0.1, 0.02) and words.at == (-0.1, 0.5) and words.yaw == -30
    assert words.effects == "-grain,+shadow" and words.quiet and words.output == "-"

"""The grammar of `--effects`, and how it changes the automatic choice of effects."""

import pytest

from nlens_video.core.errors import UsageError
from nlens_video.effects.planner import (
    EFFECTS,
    EffectRequest,
    ShotFacts,
    decide,
    restrict_to_pipeline,
)


def decisions(requested, **scene):
    return {one.effect: one for one in decide(requested, ShotFacts(**scene))}


@pytest.mark.parametrize("text", ["auto,shadow", "auto,+shadow", "+shadow", "shadow,auto"])
def test_effect_is_added_to_those_that_the_shot_needs(text):
    decided = decisions(text, moves=False, pre_rendered=True)
    assert decided["shadow"].wanted and decided["defocus"].wanted
    assert "asked for by --effects; auto leaves it out: the light" in decided["shadow"].reason
    assert not decided["motion-blur"].wanted


def test_adding_an_effect_that_the_shot_needs_keeps_its_reason():
    assert "by 2 lights" in decisions("auto,+shadow", lamps=2)["shadow"].reason


@pytest.mark.parametrize("text", ["auto,-shadow", "-shadow", "all,-shadow"])
def test_effect_is_removed_from_those_that_the_shot_needs(text):
    decided = decisions(text, lamps=1)
    assert not decided["shadow"].wanted and decided["defocus"].wanted
    assert decided["shadow"].reason == "left out by --effects"
    assert "shadow" not in EffectRequest.parse(text).possible


def test_names_without_a_sign_replace_the_automatic_choice():
    assert EffectRequest.parse("defocus, shadow").possible == ("defocus", "shadow")
    assert EffectRequest.parse("none,shadow").possible == ("shadow",)
    assert EffectRequest.parse("none").possible == ()


def test_all_requests_every_effect_that_the_pipeline_has():
    assert all(one.wanted for one in decisions("all").values())
    kept = restrict_to_pipeline(decide("all"), frozenset({"defocus"}), "draft", "all")
    assert [one.effect for one in kept if one.wanted] == ["defocus"]
    assert EffectRequest.parse("all").possible == EFFECTS


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("auto,none", "begin with one of auto and none"),
        ("auto,+shadow,-shadow", "shadow is both added and left out"),
        ("shadow,-grain", "write auto,shadow,-grain"),
        ("shadw", "did you mean shadow? There are: auto, all, none"),
        ("auto,+", "'+' is not an effect"),
        ("", "'' is not an effect"),
        ("auto,,shadow", "'' is not an effect"),
        ("+auto", "'+auto' is not an effect"),
    ],
)
def test_invalid_effect_request_states_the_expected_form(text, words):
    with pytest.raises(UsageError) as failed:
        EffectRequest.parse(text)
    assert words in str(failed.value)


def test_adding_an_effect_that_the_pipeline_lacks_is_an_error():
    with pytest.raises(UsageError, match="no node for shadow; use --preset standard"):
        restrict_to_pipeline(
            decide("auto,+shadow"), frozenset({"defocus"}), "draft", "auto,+shadow"
        )


def test_stated_shadow_strength_requests_a_shadow_of_layers():
    assert decisions("auto", pre_rendered=True, strength_given=True)["shadow"].wanted
    assert not decisions("auto", pre_rendered=True)["shadow"].wanted


def test_contradictory_shadow_options_are_refused():
    with pytest.raises(UsageError, match="drop one"):
        decisions("auto,-shadow", strength=2.0, strength_given=True)
    with pytest.raises(UsageError, match="drop one"):
        decisions("auto,+shadow", strength=0.0, strength_given=True)

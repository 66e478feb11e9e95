"""Planned effects for which a pipeline has no node."""

import pytest

from nlens_video.core.errors import UsageError
from nlens_video.effects.finding import Finding
from nlens_video.effects.planner import ShotFacts, decide, restrict_to_pipeline

SUNLIT = ShotFacts(lamps=1)


def test_plan_of_a_pipeline_without_shadow_states_that_it_is_left_out():
    decided = restrict_to_pipeline(
        decide("auto", SUNLIT), frozenset({"defocus"}), "realtime", "auto"
    )
    by_name = {decision.effect: decision for decision in decided}
    assert by_name["defocus"].wanted and not by_name["shadow"].wanted
    assert "realtime" in by_name["shadow"].reason
    for not_measured in ("grain", "occlusion"):
        assert by_name[not_measured].reason == "the pipeline realtime leaves it out"


def test_requesting_an_effect_that_the_pipeline_lacks_is_an_error():
    asked = "defocus,shadow"
    with pytest.raises(UsageError, match="shadow; use --preset standard"):
        restrict_to_pipeline(decide(asked, SUNLIT), frozenset({"defocus"}), "realtime", asked)


def test_pipeline_with_every_node_keeps_all_planned_effects():
    decisions = decide("auto", SUNLIT)
    every = frozenset(decision.effect for decision in decisions)
    assert restrict_to_pipeline(decisions, every, "standard", "auto") == decisions


@pytest.mark.parametrize(
    ("scene", "effect", "wanted", "reason"),
    [
        (ShotFacts(), "self-shadow", False, "no light source"),
        (ShotFacts(on_object=1), "self-shadow", True, "under a light"),
        (ShotFacts(on_object=2), "self-shadow", True, "the strongest of 2 lights"),
        (ShotFacts(sun_from_plate=True), "self-shadow", True, "tells a sun"),
        (ShotFacts(lamps=1, pre_rendered=True), "self-shadow", False, "lit already"),
        (ShotFacts(), "reflection", False, "give --ground-reflectance"),
        (ShotFacts(reflectance=0.2), "reflection", True, "0.2 at normal incidence"),
        (ShotFacts(reflectance=0.2, pre_rendered=True), "reflection", False, "from below"),
        (ShotFacts(), "occlusion", False, "give --holdout PATH or --occlusion auto"),
        (ShotFacts(occlusion=Finding("m.png", wanted=True)), "occlusion", True, "m.png"),
        (ShotFacts(occlusion=Finding("the camera moves")), "occlusion", False, "camera moves"),
    ],
)
def test_reflection_and_occlusion_are_planned_only_if_their_inputs_are_given(
    scene, effect, wanted, reason
):
    decision = next(one for one in decide("auto", scene) if one.effect == effect)
    assert decision.wanted == wanted and reason in decision.reason

"""Effects that a scene calls for and that a pipeline has no node for."""

import pytest

from nlens_video.effects.planner import Circumstances, decide, within
from nlens_video.errors import UsageError

SUNLIT = Circumstances(lamps=1)


def test_pipeline_without_a_shadow_leaves_it_out_and_says_so():
    decisions = within(decide("auto", SUNLIT), frozenset({"defocus"}), "realtime", "auto")
    defocus, shadow = decisions[:2]
    assert defocus.wanted and not shadow.wanted
    assert "realtime" in shadow.reason


def test_effect_asked_for_by_name_that_a_pipeline_lacks_is_an_error():
    asked = "defocus,shadow"
    with pytest.raises(UsageError, match="shadow; use --preset standard"):
        within(decide(asked, SUNLIT), frozenset({"defocus"}), "realtime", asked)


def test_pipeline_with_every_node_changes_no_decision():
    decisions = decide("auto", SUNLIT)
    assert within(decisions, frozenset({"defocus", "shadow"}), "standard", "auto") == decisions

"""Lens effects detected on shots that are known to have them, and not on clean ones."""

import pytest
from support.effects.shot_table import CLEAN, MIXED, SINGLE, judge

EVERY = {row.name: row for row in [*CLEAN, *SINGLE, *MIXED]}
LOOKED_AT = (
    *("street", "room", "lamps", "plain wall", "defocused lamps and window", "panning camera"),
    *("weak aberration, uncompressed", "vignetting, wall", "barrel, room", "weak bloom, lamps"),
    *("white balance", "weak barrel, street"),
)
"""Rows that tell most in a few seconds; docs/make_effects.py judges them all."""


@pytest.mark.slow
@pytest.mark.parametrize("name", LOOKED_AT)
def test_lens_effects_are_detected_and_measured_within_15_percent(name):
    for verdict in judge(EVERY[name]):
        assert verdict.right, f"{verdict.effect}: {verdict.found} called for: {verdict.wanted}"
        assert verdict.error is None or abs(verdict.error) < 0.15, verdict


def test_test_shots_cover_each_effect_alone_and_combined():
    for effect in ("aberration", "vignetting", "distortion", "bloom", "exposure"):
        assert sum(set(row.truth) == {effect} for row in SINGLE) >= 3
        assert any(effect in row.truth for row in MIXED)
    assert len(EVERY) == len(CLEAN) + len(SINGLE) + len(MIXED) >= 25
    assert len(CLEAN) >= 12

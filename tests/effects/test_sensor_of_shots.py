"""Grain, softness and shutter angle measured on shots that are known to have them."""

import pytest
from support.effects.sensor_rows import SENSOR_ROWS
from support.effects.shot_table import judge

LOOKED_AT = [row for row in SENSOR_ROWS if "one frame" in row.name or "cards" in row.name]


@pytest.mark.slow
@pytest.mark.parametrize("row", LOOKED_AT, ids=lambda row: row.name)
def test_sensor_effects_are_detected_and_measured_within_15_percent(row):
    for verdict in judge(row):
        assert verdict.right, f"{verdict.effect}: {verdict.found} called for: {verdict.wanted}"
        assert verdict.error is None or abs(verdict.error) < 0.15, verdict

"""The option table: every row reaches a setting, and every path it names exists in the settings."""

import dataclasses

import pytest

from nlens_video.core.objects import Playback
from nlens_video.core.optics import LensOverrides
from nlens_video.core.placement import GroundPlacing, Placement
from nlens_video.core.scale import ScaleSettings
from nlens_video.core.settings import (
    LightSettings,
    ObjectSettings,
    OutputSettings,
    RealSettings,
    Settings,
    SourceSettings,
)
from nlens_video.options.commands import COMMANDS, JOBS
from nlens_video.options.parser import parser_of
from nlens_video.options.table import ROWS

OWNERS = {
    "run": Settings, "source": SourceSettings, "output": OutputSettings, "scene": ObjectSettings,
    "playback": Playback, "placing": Placement, "light": LightSettings, "real": RealSettings,
    "optics": LensOverrides, "scale": ScaleSettings, "ground": GroundPlacing,
}  # fmt: skip


def test_every_option_sets_an_existing_settings_field():
    for option in ROWS:
        owner, _, field = option.feeds.partition(".")
        if owner:
            assert field in {one.name for one in dataclasses.fields(OWNERS[owner])}, option.names


@pytest.mark.parametrize("command", [*COMMANDS, JOBS])
def test_every_default_is_accepted_by_its_option(command):
    for action in parser_of(command)._actions:
        if action.choices and action.option_strings and action.default is not None:
            assert action.default in action.choices, action.dest


def test_option_names_are_unique_within_a_command():
    for command in (*COMMANDS, JOBS):
        names = [name for row in ROWS if command in row.commands for name in row.flags]
        assert len(names) == len(set(names)), command

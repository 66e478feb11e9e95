"""The option table: every row reaches a setting, and every path it names exists in the settings."""

import re

import pytest
from support.documents import PAGES
from support.folders import ROOT

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
            assert field in OWNERS[owner].__struct_fields__, option.names


@pytest.mark.parametrize("command", [*COMMANDS, JOBS])
def test_every_default_is_accepted_by_its_option(command):
    for action in parser_of(command)._actions:
        if action.choices and action.option_strings and action.default is not None:
            assert action.default in action.choices, action.dest


def test_option_names_are_unique_within_a_command():
    for command in (*COMMANDS, JOBS):
        names = [name for row in ROWS if command in row.commands for name in row.flags]
        assert len(names) == len(set(names)), command


def test_every_option_is_on_a_page_for_users():
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    named = set(re.findall(r"(?<![\w-])--?[a-z](?:[a-z-]*[a-z])?", text))
    unnamed = [row.flags for row in ROWS if row.flags and not named & set(row.flags)]
    assert unnamed == []


def test_the_change_log_lists_the_names_of_the_help_first():
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    listed = re.findall(r"^\| (`(?:[a-z ]*)--.*?) \| (`--.*?) \|$", text, re.M)
    assert listed
    first = {row.flags[0] for row in ROWS if row.flags}
    for today, others in listed:
        names, former = re.findall(r"--[a-z-]+", today), re.findall(r"--[a-z-]+", others)
        assert set(names) <= first
        for other in former:
            assert any(other in row.flags and row.flags[0] in names for row in ROWS), other

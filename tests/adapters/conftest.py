"""Plates for the adapters, and what the command line makes of them: once a process."""

import functools

import pytest
from support.conformance import by_command_line, write_plate


@pytest.fixture(scope="session")
def plates(tmp_path_factory):
    """The plate of a case, by its name."""
    return functools.cache(lambda case: write_plate(tmp_path_factory.mktemp("plate"), case))


@pytest.fixture(scope="session")
def expected(plates):
    """What the command line makes of it."""
    return functools.cache(lambda case: by_command_line(plates(case)))

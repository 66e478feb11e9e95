"""A browser, and the page of a shot in it."""

import pytest
from support.browser import driven
from support.studio import opened, write_shot


@pytest.fixture(scope="module")
def browser():
    with driven() as started:
        yield started


@pytest.fixture
def shot(tmp_path):
    return write_shot(tmp_path)


@pytest.fixture
def page(browser, shot):
    """The page of a shot whose first picture is drawn; it must tell of no error."""
    with opened(browser, shot) as (page, _):
        yield page

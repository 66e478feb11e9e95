"""A browser, and the page of a shot in it."""

import pytest
from support.browser import driven
from support.studio import Studio, running, shown, write_shot


@pytest.fixture(scope="module")
def browser():
    with driven() as started:
        yield started


@pytest.fixture(scope="module")
def studio(tmp_path_factory):
    """A server for all tests of a module: it keeps nothing of a page but what that saves."""
    shot = write_shot(tmp_path_factory.mktemp("studio"))
    with running(shot) as server:
        yield Studio(server, shot)


@pytest.fixture
def shot(studio):
    return studio.reset()


@pytest.fixture
def page(browser, studio, shot):
    """The page of the shot, its first picture drawn; it must tell of no error."""
    with shown(browser, studio.server) as page:
        yield page

"""The garbage collector rests while modules are loaded, and only then."""

import gc

import pytest

from nlens_video.cli.loading import loading


def test_collector_rests_while_modules_are_loaded():
    with loading():
        assert not gc.isenabled()
        with loading():
            pass
        assert not gc.isenabled()
    assert gc.isenabled()


def test_collector_goes_on_after_a_fault():
    with pytest.raises(ImportError), loading():
        raise ImportError
    assert gc.isenabled()


def test_collector_that_is_off_stays_off():
    gc.disable()
    try:
        with loading():
            pass
        assert not gc.isenabled()
    finally:
        gc.enable()

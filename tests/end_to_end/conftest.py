"""What tests with other programs share."""

import socket

import pytest


@pytest.fixture
def free_ports():
    """Two TCP ports of this machine that nobody listens on, as text."""
    with socket.socket() as first, socket.socket() as second:
        first.bind(("127.0.0.1", 0))
        second.bind(("127.0.0.1", 0))
        return tuple(str(probe.getsockname()[1]) for probe in (first, second))

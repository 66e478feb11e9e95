"""A connection between a browser and a server that can be cut, and comes back."""

from __future__ import annotations

import contextlib
import socket
import threading

_READ_BYTES = 1 << 16


class Relay:
    """Hands on what arrives at an address to another one, until it is cut.

    Args:
        host: the address of this machine that it listens on.
        server: that of the server, on the same port.
        port: of both.
    """

    def __init__(self, host: str, server: str, port: int) -> None:
        self._here, self._there = (host, port), (server, port)
        self._open: set[socket.socket] = set()
        self.mend()

    def mend(self) -> None:
        """Listen, again."""
        self._listening = socket.create_server(self._here)
        threading.Thread(target=self._accept, args=(self._listening,), daemon=True).start()

    def cut(self) -> None:
        """Break all connections, and refuse new ones."""
        for one in (self._listening, *self._open):
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()
        self._open.clear()

    def _accept(self, listening: socket.socket) -> None:
        while True:
            try:
                one, _ = listening.accept()
            except OSError:
                return
            other = socket.create_connection(self._there)
            self._open |= {one, other}
            for ends in ((one, other), (other, one)):
                threading.Thread(target=self._hand_on, args=ends, daemon=True).start()

    def _hand_on(self, source: socket.socket, target: socket.socket) -> None:
        with contextlib.suppress(OSError):
            while data := source.recv(_READ_BYTES):
                target.sendall(data)
            target.shutdown(socket.SHUT_WR)

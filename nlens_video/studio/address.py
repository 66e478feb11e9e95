"""Where the studio listens: on this machine alone, unless another address is asked for by name."""

from __future__ import annotations

import socket
from ipaddress import IPv4Address

from msgspec import Struct

from nlens_video.core.errors import UsageError

_LOCAL = ("127.0.0.1", "localhost")


class Address(Struct, frozen=True):
    """An address of this machine, and a port.

    Attributes:
        host: as it was given, which the page's address repeats.
        number: the same as a number.
        port: 0 for a free one.
    """

    host: str
    number: IPv4Address
    port: int

    @classmethod
    def of(cls, host: str, port: int, *, unencrypted: bool) -> Address:
        """The address of a name or number.

        Args:
            host: name or IPv4 number.
            port: 0 for a free one.
            unencrypted: whether it may be one that other machines reach.

        Raises:
            UsageError: no such address, not a single one, or one that other machines reach.
        """
        try:
            number = IPv4Address(socket.gethostbyname(host))
        except (OSError, UnicodeError) as error:
            raise UsageError(
                f"--host {host}: not known here; give an IPv4 address of this machine"
            ) from error
        if number.is_unspecified:
            raise UsageError(f"--host {host}: expected a single address of this machine")
        if not (number.is_loopback or unencrypted):
            raise UsageError(
                f"--host {host}: whoever reads that network's traffic sees the token and the "
                "plate; add --i-know-it-is-unencrypted, or leave --host out"
            )
        return cls(host, number, port)

    @property
    def names(self) -> tuple[str, ...]:
        """By which a browser may ask for the page."""
        local = _LOCAL if str(self.number) in _LOCAL else ()
        return (self.host.lower(), str(self.number), *local)

    def listen(self) -> socket.socket:
        """A socket that listens there.

        Raises:
            UsageError: the address is not of this machine, or the port is taken.
        """
        listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((str(self.number), self.port))
            listening.listen()
        except OSError as error:
            listening.close()
            raise UsageError(
                f"--host {self.host} --port {self.port}: cannot be used ({error.strerror}); "
                "give others, or leave them out"
            ) from error
        return listening

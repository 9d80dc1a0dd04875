# SPDX-License-Identifier: Apache-2.0
"""Names that one process of a host holds: known at once, where discovery may take seconds."""

from __future__ import annotations

import errno
import hashlib
import socket
import struct
from collections.abc import Iterable
from contextlib import ExitStack, suppress

import rclpy

ANSWER_S = 0.02


class HostClaims:
    """Names held on this host: abstract Unix sockets, which the kernel gives to one process at a time.

    Parameters
    ----------
    names : iterable of str
        What is claimed; all or none.

    Attributes
    ----------
    holder : str
        What is held by whom, if another process holds one of them; else empty.
    """

    def __init__(self, names: Iterable[str]) -> None:
        self.holder = ""
        self._held = ExitStack()
        domain = rclpy.get_default_context().get_domain_id()
        for name in sorted(names):  # all in one order, so that one of several gets them all
            address = b"\0mech_twin/" + hashlib.sha256(f"{domain} {name}".encode()).digest()
            try:
                held = self._held.enter_context(socket.socket(socket.AF_UNIX))
                held.bind(address)
                held.listen()
            except OSError as error:
                self.close()
                if error.errno != errno.EADDRINUSE:
                    raise
                self.holder = f"{name} is claimed by an earlier start{_holder(address)}"
                return

    def close(self) -> None:
        """Let go of the names."""
        self._held.close()


def _holder(address: bytes) -> str:
    """Return the process that listens at an address, in words."""
    with suppress(OSError), socket.socket(socket.AF_UNIX) as asked:
        asked.settimeout(ANSWER_S)
        asked.connect(address)
        process, _, _ = struct.unpack("3i", asked.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12))
        return f", process {process}"
    return ""

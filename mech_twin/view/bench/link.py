# SPDX-License-Identifier: Apache-2.0
"""Connection from a run to its bench: messages over a Unix socket in a folder accessible to this user only.

Each message is its length (4 bytes, big-endian), a byte for its kind (picture or message), and JSON::

    0 0 1 44 | p | {"time_s": 1.25, ...}
"""

import json
import math
import socket
import struct
import threading
import time
from collections.abc import Mapping
from typing import Any

from mech_twin.process.closing import Closing
from mech_twin.view.bench.picture import packed_curves, packed_shapes

HEAD = struct.Struct("!Ic")
PICTURE, MESSAGE = b"p", b"m"
LARGEST_BYTES = 16 << 20
BUFFER_BYTES = 1 << 20
PREFIX = "bench:"
BEGUN_BY = "MECH_TWIN_BENCH"  # environment variable of a command started by a bench: its address
FEED = "feed"  # file name of the socket


def encoded(content: Any, *, finite: bool) -> bytes:
    """Return JSON; if finite, with null for numbers that are not: the page would refuse a whole picture for one."""
    try:
        return json.dumps(content, separators=(",", ":"), allow_nan=not finite).encode()
    except ValueError:
        return json.dumps(_with_null(content), separators=(",", ":")).encode()


def _with_null(content: Any) -> Any:
    if isinstance(content, Mapping):
        return {key: _with_null(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [_with_null(value) for value in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


class BenchLink(Closing):
    """A connection to a bench; messages it cannot accept are dropped without waiting, unless a wait is given.

    Parameters
    ----------
    place : str
        ``bench:PATH`` of the socket.
    wait_s : float
        How long a picture may wait for the bench to take in the ones before it (s).
    """

    is_live = True  # pictures are sent by the wall clock
    shapes, curves = staticmethod(packed_shapes), staticmethod(packed_curves)  # as a picture holds them

    def __init__(self, place: str, wait_s: float = 0.0) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, BUFFER_BYTES)
        self._wait_s = wait_s
        self._left = b""
        self._lock = threading.Lock()
        self.is_alive = True
        try:
            self._socket.connect(place.removeprefix(PREFIX))
        except OSError:  # the bench is gone; the run continues
            self.is_alive = False
        self._socket.setblocking(False)

    def tell(self, kind: str, content: Mapping[str, Any]) -> bool:
        """Send a message: a state, a list of parameters; return whether it was accepted."""
        return self._send(MESSAGE, {"kind": kind, **content}, 1.0)

    def show(self, picture: Mapping[str, Any]) -> bool:
        """Send a picture; return whether it was accepted."""
        return self._send(PICTURE, picture, self._wait_s)

    def close(self) -> None:
        """Finish the current message, and close the connection."""
        with self._lock:
            self._flush(1.0)
            self._socket.close()
            self.is_alive = False

    def _send(self, kind: bytes, content: Mapping[str, Any], limit_s: float) -> bool:
        with self._lock:
            if not self.is_alive or not self._flush(limit_s):
                return False
            body = encoded(content, finite=kind == PICTURE)
            self._left = HEAD.pack(len(body), kind) + body
            self._flush(limit_s)
            return self.is_alive

    def _flush(self, limit_s: float) -> bool:
        """Send the rest of the previous message; return whether it is sent completely."""
        end = time.monotonic() + limit_s
        while self._left and self.is_alive:
            try:
                self._left = self._left[self._socket.send(self._left) :]
            except BlockingIOError:
                if time.monotonic() >= end:
                    return False
                time.sleep(0.002)
            except OSError:
                self.is_alive = False
        return not self._left


class OverlayLink(BenchLink):
    """A connection for the second of two runs in one view: its pictures are overlaid on those of the first."""

    def tell(self, kind: str, content: Mapping[str, Any]) -> bool:
        """Drop a message, which the first run sends; return True."""
        return True

    def show(self, picture: Mapping[str, Any]) -> bool:
        """Send a picture of the second run; return whether it was accepted."""
        return super().show({**picture, "side": 1})

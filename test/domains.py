# SPDX-License-Identifier: Apache-2.0
"""ROS domains for tests that run beside each other, in whatever checkouts of this machine."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import count

FIRST_DOMAIN = 60  # below are those people use by hand
DOMAINS = 41  # 60-100: ports of domains from 101 on overlap the range Linux hands out to clients
_handed_out = count()


@contextmanager
def own_domain() -> Iterator[int]:
    """Hold a domain number that no other process of this machine's tests holds.

    A name in the kernel's own table is what is held: it goes with its holder, however that one ends.
    """
    with socket.socket(socket.AF_UNIX) as held:
        while True:
            domain = FIRST_DOMAIN + (os.getpid() * 7 + next(_handed_out)) % DOMAINS
            with suppress(OSError):  # somebody holds it
                held.bind(f"\0mech_twin test domain {domain}")
                break
        yield domain

# SPDX-License-Identifier: Apache-2.0
"""A node's process that ends when its launch does, even by SIGKILL (Linux)."""

from __future__ import annotations

import os

from mech_twin.parent_death import end_with_parent

PARENT = "MECH_TWIN_PARENT"


def end_with_launch() -> None:
    """End with the process that the variable ``MECH_TWIN_PARENT`` names, where it is this one's parent.

    A launch that is ended by SIGTERM or SIGKILL does not end what it has launched.
    """
    named = os.environ.get(PARENT, "")
    if not named.isdecimal():
        return
    if os.getppid() == int(named) or not _is_alive(int(named)):  # or something stands between, such as a debugger
        end_with_parent(int(named))


def _is_alive(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except PermissionError:  # somebody else's
        return True
    return True

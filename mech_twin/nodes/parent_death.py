"""A node's process that ends when the one that started it does, even by SIGKILL (Linux)."""

from __future__ import annotations

import ctypes
import os
import signal

PR_SET_PDEATHSIG = 1
PARENT = "MECH_TWIN_PARENT"


def end_with_parent(parent: int) -> None:
    """Ask the kernel for a SIGTERM when this process's parent ends; end here if it has ended already.

    Parameters
    ----------
    parent : int
        Process id of the parent.

    Raises
    ------
    OSError
        If the kernel refuses.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, signal.SIGTERM) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
    if os.getppid() != parent:
        raise SystemExit(128 + signal.SIGTERM)


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

# SPDX-License-Identifier: Apache-2.0
"""A process that ends when the one that started it does, even by SIGKILL (Linux)."""

from __future__ import annotations

import ctypes
import os
import signal

from mech_twin.process.interruption import EXIT_CODE_BASE, end_at_once

PR_SET_PDEATHSIG = 1


def end_with_parent(parent: int, number: int = signal.SIGTERM) -> None:
    """Let the kernel send a signal when the parent process ends; exit at once if it has ended already.

    Parameters
    ----------
    parent : int
        Process id of the parent.
    number : int
        The signal.

    Raises
    ------
    OSError
        If the kernel refuses.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, number) != 0:
        raise OSError(ctypes.get_errno(), "prctl(PR_SET_PDEATHSIG)")
    if os.getppid() != parent:
        end_at_once(EXIT_CODE_BASE + number)

# SPDX-License-Identifier: Apache-2.0
"""Fixtures of every room: a place in ROS of a test's own."""

from __future__ import annotations

import gc
import signal
from collections.abc import Iterator

import pytest
from domains import own_domain
from hypothesis import Phase, settings

# the first example of a test may compile kernels: a limit on the time of one example would fail with an empty cache;
# the same examples each time, so that a change is judged by what it changes
settings.register_profile("compiled", deadline=None, derandomize=True)
# new examples each time: `--hypothesis-profile=explore`, every night and by hand
settings.register_profile("explore", deadline=None, print_blob=True)
# mutation testing asks whether a test fails, not for the simplest input
settings.register_profile("mutation", deadline=None, database=None, phases=(Phase.explicit, Phase.generate))
settings.load_profile("compiled")


def pytest_collection_finish() -> None:
    """Let no collection of garbage look through the tests themselves again: that took a seventh of their time."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def signals_are_answered() -> None:
    """Let programs that tests start answer signals that a shell ignores for ``nohup`` or in the background."""
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        signal.signal(signal.SIGHUP, lambda *_: None)
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """Give a test a ROS domain of its own, for this process and those it starts: loopback only, fields checked."""
    with own_domain() as domain:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
        monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        monkeypatch.setenv("ROS_PYTHON_CHECK_FIELDS", "1")
        yield domain


@pytest.fixture
def ros(ros_domain: int) -> Iterator[None]:
    """Give a test the middleware in its own process, in a domain of its own."""
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
    yield
    rclpy.try_shutdown()

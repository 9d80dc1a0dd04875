# SPDX-License-Identifier: Apache-2.0
"""``mech-twin replay``: publishes a recording on its topics."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from mech_twin.cli.console import say
from mech_twin.cli.failure import CommandError
from mech_twin.cli.pages import check_is_no_page
from mech_twin.cli.verbs import ReplayVerb
from mech_twin.nodes.run.domain import settle_domain

if TYPE_CHECKING:
    from mech_twin.nodes.replay.replay_node import ReplayNode
    from mech_twin.nodes.replay.session import ReplayOutcome
    from mech_twin.nodes.replay.source import ReplaySource


def replay(asked: ReplayVerb) -> None:
    """Publish a recording, or recompute it, or a measured run by its map."""
    check_is_no_page(asked.bag)
    if asked.given_map is not None:
        if not asked.analyse:
            raise CommandError(
                f"--map {asked.given_map}: a measured run has no topics of the twin; expected --analyse beside it"
            )
        from mech_twin.cli.measured_run import analyse_measured

        analyse_measured(asked, asked.given_map)
    elif asked.analyse or asked.resimulate:
        from mech_twin.cli.recompute import recompute_bag

        recompute_bag(asked)
    else:
        replay_bag(asked)


def replay_bag(request: ReplayVerb) -> None:
    """Publish a recording on its topics until its end, or until stopped."""
    _check(request)
    settle_domain()
    from mech_twin.nodes.replay.replay_node import ReplayOptions
    from mech_twin.nodes.replay.session import replayed
    from mech_twin.nodes.replay.source import ReplaySource
    from mech_twin.recording.bag_reader import open_bag

    with open_bag(request.bag) as reader:
        source = ReplaySource(reader, request.topics, request.start_s, request.duration_s)
        for name, why in source.unknown.items():
            say(f"{name}: not replayed: {why}")
        if not source.topics:
            raise CommandError(f"{request.bag}: no topic can be replayed: {'; '.join(source.unknown.values())}")
        options = ReplayOptions(request.rate, request.loop, request.clock, request.listeners)
        with _progress(source) as notice:
            outcome = replayed(source, options, notice, request.namespace)
    _report(outcome)


def _check(request: ReplayVerb) -> None:
    from mech_twin.nodes.replay import FASTEST, SLOWEST

    if not SLOWEST <= request.rate <= FASTEST:  # false for NaN, too
        raise CommandError(f"--rate {request.rate:g}: expected {SLOWEST:g} to {FASTEST:g}")


@contextmanager
def _progress(source: ReplaySource) -> Iterator[Callable[[ReplayNode], None]]:
    """Provide the callback that shows the position, if standard error is a terminal."""
    if not sys.stderr.isatty():
        yield lambda node: None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    parts = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed:.2f} of {task.total:.2f} s"))
    first, last = source.seconds(source.first_ns), source.seconds(source.last_ns)
    with Progress(*parts, console=Console(stderr=True), transient=True, refresh_per_second=10) as bar:
        task = bar.add_task("replaying", total=last - first)

        def notice(node: ReplayNode) -> None:
            word = "paused" if node.paused else f"replaying at {node.rate:.3g}"
            bar.update(task, completed=node.position_s - first, description=word)

        yield notice


def _report(outcome: ReplayOutcome) -> None:
    say(f"published {sum(outcome.published.values())} messages on {len(outcome.published)} topics")
    for name, number in outcome.malformed.items():
        say(f"{name}: {number} messages skipped: not decodable as the topic's type")
    for name, number in outcome.refused.items():
        say(f"{name}: {number} messages not published")

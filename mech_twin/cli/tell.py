# SPDX-License-Identifier: Apache-2.0
"""``mech-twin tell``: an order or new values for the nodes of a running machine."""

from __future__ import annotations

from mech_twin.cli.console import say_result
from mech_twin.cli.failure import CommandError
from mech_twin.cli.verbs import TellVerb
from mech_twin.nodes.run.domain import UnansweredError, settle_domain
from mech_twin.parameters.load import assignments


def tell_nodes(asked: TellVerb) -> None:
    """Tell the nodes and print what they answer."""
    target, what, fault = asked.target, asked.what, asked.fault
    settle_domain()
    from mech_twin.nodes.run.telling import ORDERS, tell

    order = None if "=" in what[0] else what[0]
    if order is not None and (order not in ORDERS or len(what) > 1):
        raise CommandError(f"tell {' '.join(what)}: expected KEY=VALUE ..., or one of {', '.join(ORDERS)}")
    if fault is not None and (order is None or not ORDERS[order].of_a_fault):
        raise CommandError("--fault goes with acknowledge and shelve")
    try:
        say_result(tell(target, order, assignments(what) if order is None else {}, fault, asked.wait_s))
    except UnansweredError as error:
        raise CommandError(f"tell {target} {error}") from error

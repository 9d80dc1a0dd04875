# SPDX-License-Identifier: Apache-2.0
"""``mech-twin recover``: salvage a damaged recording."""

from __future__ import annotations

from mech_twin.cli.console import print_json, say_result
from mech_twin.cli.verbs import RecoverVerb


def recover_bag(asked: RecoverVerb) -> None:
    """Write the new recording and report what was salvaged."""
    from mech_twin.recording.recovery import recover

    report = recover(asked.bag, asked.out, force=asked.force)
    if not asked.as_json:
        say_result("\n".join(report.lines()))
        return
    print_json(
        {
            "bag": str(report.bag),
            "out": str(report.out),
            "messages": dict(sorted(report.messages.items())),
            "messages_of_lost_topics": report.unassigned,
            "bytes_read": report.bytes_read,
            "bytes_skipped": report.bytes_skipped,
            "damages": report.damages,
        }
    )

# SPDX-License-Identifier: Apache-2.0
"""``mech-twin recover``: salvage a damaged recording."""

from __future__ import annotations

from pathlib import Path

from mech_twin.cli.console import print_json


def recover_bag(bag: Path, out: Path, *, force: bool, as_json: bool) -> None:
    """Write the new recording and report what was salvaged."""
    from mech_twin.recording.recovery import recover

    report = recover(bag, out, force=force)
    if not as_json:
        print("\n".join(report.lines()))  # noqa: T201 - this is the output
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

"""``mech-twin info``: contents and losses of a recording."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml

from mech_twin.cli.console import print_json, print_numbers, print_table, say

if TYPE_CHECKING:
    from mech_twin.recording.bag_contents import BagInfo

COUNTERS = ("received", "written", "dropped", "missed", "late")


def show_info(bag: Path, *, as_json: bool) -> None:
    """Print messages per topic, loss counters, files and problems."""
    from mech_twin.recording.bag_reader import bag_info

    info = bag_info(bag)
    document = info_record(info)
    if as_json:
        print_json(document)
        return
    names = ("machine", "version", "finished", "duration_s", "message_count")
    print_numbers(str(bag), {name: document[name] for name in names})
    rows = [
        (name, topic["type"], topic["messages"], *(topic["counters"].get(key, "-") for key in COUNTERS))
        for name, topic in document["topics"].items()
    ]
    print_table("topics", ("topic", "type", "messages", *COUNTERS), rows)
    splits = [tuple("-" if value is None else value for value in split.values()) for split in document["splits"]]
    print_table("files", ("file", "bytes", "start, s", "end, s", "messages"), splits)
    for problem in document["problems"]:
        say(problem)


def info_record(info: BagInfo) -> dict[str, Any]:
    """Return the summary of a bag as a JSON object."""
    head = _configuration_head(info.configuration)
    return {
        "bag": str(info.path),
        "machine": head.get("machine"),
        "version": head.get("version"),
        "finished": info.finished,
        "duration_s": info.duration_s,
        "message_count": info.message_count,
        "topics": {
            name: {
                "type": topic.type_name,
                "messages": topic.message_count,
                "counters": info.counters.get(name, {}),
            }
            for name, topic in info.topics.items()
        },
        "splits": [
            {
                "file": split.file.name,
                "size_bytes": split.size_bytes,
                "start_s": None if split.start_ns is None else split.start_ns * 1e-9,
                "end_s": None if split.end_ns is None else split.end_ns * 1e-9,
                "messages": split.message_count,
            }
            for split in info.splits
        ],
        "configuration": info.configuration,
        "problems": list(info.problems),
    }


def _configuration_head(text: str | None) -> dict[str, str]:
    """Return machine and version of a configuration, if they can be read."""
    try:
        tree = yaml.safe_load(text) if text else None
    except (yaml.YAMLError, ValueError, RecursionError):
        return {}
    return {key: str(tree[key]) for key in ("machine", "version") if key in tree} if isinstance(tree, dict) else {}

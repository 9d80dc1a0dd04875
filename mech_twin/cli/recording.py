# SPDX-License-Identifier: Apache-2.0
"""``mech-twin info``, ``recover``, ``replay``: a recording described, salvaged, published, or computed again."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any

import yaml
from rich.filesize import decimal

from mech_twin import __version__
from mech_twin.cli.console import (
    FOUND,
    CommandError,
    bar,
    print_csv,
    print_json,
    print_table,
    progress,
    say,
    say_result,
)
from mech_twin.cli.verbs import InfoVerb, RecoverVerb, ReplayVerb
from mech_twin.declarations.configuration_tree import ConfigurationError
from mech_twin.files.input_file import bounded_yaml
from mech_twin.measurements.blocks import EPOCH_S
from mech_twin.measurements.tables import is_table
from mech_twin.nodes.run.domain import settle_domain
from mech_twin.parameters.description import description_text
from mech_twin.parameters.load import MACHINE_KEY, file_tree, is_page, machine_parameters
from mech_twin.roles import own_name
from mech_twin.studies.resimulation import ConfigurationHistory, Verdict, analysed, resimulated

if TYPE_CHECKING:
    from mech_twin.nodes.replay.replay_node import ReplayNode
    from mech_twin.recording.bag_contents import BagInfo, RecordingReader
    from mech_twin.recording.bag_samples import BagSamples

COUNTERS = ("received", "written", "dropped", "cut", "missed", "late", "publishers")
LOSSES = ("dropped", "cut", "missed", "late")
STEPS = "step/linkage"  # a topic that every machine has in its namespace


def show_info(request: InfoVerb) -> None:
    """Print messages per topic, loss counters, files and problems; with a map, the quality of channels.

    Exit with 1 if every chunk is to be verified and anything is damaged.
    """
    bag = request.bag
    if request.given_map is not None:
        from mech_twin.cli.measured import examine_by_file

        examine_by_file(request, request.given_map)
        return
    if is_page(str(bag)):
        raise CommandError(
            f"{bag}: expected a recording, not a page or configuration; `mech-twin check` describes a page"
        )
    if is_table(bag):
        raise CommandError(f"{bag}: a table says what its columns are with --map FILE; `mech-twin map` proposes one")
    settle_domain()
    from mech_twin.recording.bag_directory import is_sqlite_bag
    from mech_twin.recording.bag_reader import about_bag

    if request.verify and is_sqlite_bag(bag):
        raise CommandError(f"--verify: {bag} is in sqlite3 storage, which has no checksums")
    info, (described, machines) = about_bag(bag, _described, verify=request.verify)
    document = info_record(info)
    if described is not None:
        document |= {"machine": described.name, "version": ", ".join(described.versions)}
    if request.as_json:
        print_json(document)
    elif request.as_csv:
        print_csv(("topic", "type", "messages", *COUNTERS), [_counted(*item) for item in document["topics"].items()])
    else:
        known = document["machine"] or ", ".join(machines)
        name = known if described is None else own_name(described.name, described.parameters)
        _print_head(document, name)
        _print_topics(document["topics"], request.wide)
        _print_files(document["splits"])
        say(*document["problems"], *shared_topics(info.counters))
    if request.verify and info.problems:
        raise SystemExit(FOUND)


def _print_files(splits: list[dict[str, Any]]) -> None:
    """Write a row of each file, its times since the first where they count from an epoch."""
    first_s = min((split["start_s"] for split in splits if split["start_s"] is not None), default=0.0)
    zero_s = first_s if first_s > EPOCH_S else 0.0
    since = f", times since {datetime.fromtimestamp(zero_s, UTC):%Y-%m-%d %H:%M:%S} UTC" if zero_s else ""
    rows = []
    for file, size, start_s, end_s, messages in (split.values() for split in splits):
        times = ("-" if at is None else at - zero_s for at in (start_s, end_s))
        rows.append((file, "-" if size is None else size, *times, "-" if messages is None else messages))
    print_table(f"files{since}", ("file", "bytes", "start, s", "end, s", "messages"), rows)


def shared_topics(counters: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Return a line for each topic, by name with its loss counters, that several published at once."""
    shared = {name: number for name, row in counters.items() if (number := row.get("publishers", 0)) > 1}
    copied = "what one sent with the source of another is below copied_source, where the middleware told them apart"
    return [f"{name}: {number} publishers at once; {copied}" for name, number in shared.items()]


def _described(reader: RecordingReader) -> tuple[ConfigurationHistory | None, list[str]]:
    """Return the machine of a bag as `replay --resimulate` knows it, if it does, and the names of all in the bag."""
    from mech_twin.recording.bag_samples import BagSamples, recorded_machines
    from mech_twin.recording.errors import BagError

    machines = recorded_machines(reader)
    try:
        return ConfigurationHistory(BagSamples(reader).descriptions(), str(reader.path)), machines
    except (BagError, ConfigurationError):
        return None, machines


def _print_head(document: dict[str, Any], name: str) -> None:
    """Write what is recorded, how long, and whether it is whole; then by what, how much, and what is missing."""
    duration, topics = document["duration_s"], document["topics"]
    losses = {key: sum(topic["counters"].get(key, 0) for topic in topics.values()) for key in LOSSES}
    length = "length unknown" if duration is None else f"{duration:.6g} s"
    why = "a part is missing" if any(" part " in each for each in document["problems"]) else "it was not closed"
    whole = "complete" if document["finished"] else f"not complete: {why}"
    if document["finished"] and (document["problems"] or losses["dropped"] or losses["cut"]):
        whole = "closed, but not complete"
    counted = any(topic["counters"] for topic in topics.values())
    sound = counted and document["finished"] and not document["problems"]
    lost = ", ".join(f"{count} {name}" for name, count in losses.items() if count) or ("nothing lost" if sound else "")
    say_result("; ".join(filter(None, [f"{name or 'unknown machine'}, {length}", whole, lost])))
    size = sum(split["size_bytes"] or 0 for split in document["splits"])
    files = f"{len(document['splits'])} file{'' if len(document['splits']) == 1 else 's'}"
    say_result(f"{document['message_count']} messages of {len(topics)} topics, {decimal(size)} in {files}")
    version = f" {document['version']}" if document["version"] else ""  # the sensors of a machine record none
    say_result(f"recorded by mech_twin{version}" if version or counted else "recorded by other software")


def _print_topics(topics: dict[str, Any], wide: bool) -> None:
    """Write a row of each topic; those of a machine below its namespace, which stands in the title."""
    if wide:
        rows = [_counted(name, topic) for name, topic in topics.items()]
        print_table("topics", ("topic", "type", "messages", *COUNTERS), rows, wide=True)
        return
    counted = any(topic["counters"] for topic in topics.values())
    losses = LOSSES if counted else ()
    space = next((name.removesuffix(STEPS) for name in topics if name.endswith(f"/{STEPS}")), "")
    rows = [
        (name.removeprefix(space), topic["messages"], *(topic["counters"].get(key, "-") for key in losses))
        for name, topic in topics.items()
    ]
    print_table(f"topics below {space}" if space else "topics", ("topic", "messages", *losses), rows)


def _counted(name: str, topic: dict[str, Any]) -> tuple[Any, ...]:
    return (name, topic["type"], topic["messages"], *(topic["counters"].get(key, "-") for key in COUNTERS))


def info_record(info: BagInfo) -> dict[str, Any]:
    """Return the summary of a bag as a JSON object."""
    try:
        tree = bounded_yaml(info.configuration) if info.configuration else None
    except (yaml.YAMLError, ValueError, RecursionError):
        tree = None
    known = tree if isinstance(tree, dict) else {}
    head = {key: str(known[key]) if key in known else None for key in ("machine", "version")}
    topics = {
        name: {"type": topic.type_name, "messages": topic.message_count, "counters": info.counters.get(name, {})}
        for name, topic in info.topics.items()
    }
    splits = []
    for split in info.splits:
        start_s, end_s = (None if at_ns is None else at_ns * 1e-9 for at_ns in (split.start_ns, split.end_ns))
        place = {"file": split.file.name, "size_bytes": split.size_bytes, "start_s": start_s, "end_s": end_s}
        splits.append({**place, "messages": split.message_count})
    whole = {"finished": info.finished, "duration_s": info.duration_s, "message_count": info.message_count}
    rest = {"configuration": info.configuration, "problems": info.problems}
    return {"bag": info.path, **head, **whole, "topics": topics, "splits": splits, **rest}


def recover_bag(request: RecoverVerb) -> None:
    """Write the new recording and report what was salvaged."""
    from mech_twin.recording.recovery import recover

    report = recover(request.bag, request.out, force=request.force)
    if request.as_json:
        print_json(report)
    else:
        say_result("\n".join(report.lines()))
    if not report.messages:
        raise SystemExit(FOUND)


def replay(request: ReplayVerb) -> None:
    """Publish a recording, or recompute it, or a measured run by its map."""
    if is_page(str(request.bag)) and request.bag.is_file():
        raise CommandError(
            f"{request.bag}: expected a recording, not a page or configuration; `mech-twin check` draws a page, "
            "`mech-twin simulate PAGE --bag NAME` records one"
        )
    if request.given_map is not None:
        from mech_twin.cli.measured import analyse_measured

        analyse_measured(request, request.given_map)
    elif request.analyse or request.resimulate:
        recompute_bag(request)
    else:
        replay_bag(request)


def replay_bag(request: ReplayVerb) -> None:
    """Publish a recording on its topics until its end, or until stopped."""
    from mech_twin.nodes.replay import FASTEST, SLOWEST

    if not SLOWEST <= request.rate <= FASTEST:  # false for NaN, too
        raise CommandError(f"--rate {request.rate:g}: expected {SLOWEST:g} to {FASTEST:g}")
    settle_domain()
    from mech_twin.nodes.replay.replay_node import ReplayOptions, replayed
    from mech_twin.nodes.replay.source import ReplaySource
    from mech_twin.recording.bag_reader import open_bag

    with open_bag(request.bag) as reader:
        source = ReplaySource(reader, request.topics, request.start_s, request.duration_s)
        say(*(f"{name}: not replayed: {why}" for name, why in source.unknown.items()))
        if not source.topics:
            raise CommandError(f"{request.bag}: no topic can be replayed: {'; '.join(source.unknown.values())}")
        options = ReplayOptions(request.rate, request.loop, request.clock, request.listeners)
        first_s, last_s = source.seconds(source.first_ns), source.seconds(source.last_ns)
        place = "{task.completed:.2f} of {task.total:.2f} s"
        with bar("replaying", "{task.description}", "BarColumn", place, total=last_s - first_s) as update:

            def notice(node: ReplayNode) -> None:
                if update is not None:
                    word = "paused" if node.paused else f"replaying at {node.rate:.3g}"
                    update(completed=node.position_s - first_s, description=word)

            outcome = replayed(source, options, notice, request.namespace)
    say(f"published {sum(outcome.published.values())} messages on {len(outcome.published)} topics")
    malformed, refused = outcome.malformed.items(), outcome.refused.items()
    say(*(f"{name}: {number} messages skipped: not decodable as the topic's type" for name, number in malformed))
    say(*(f"{name}: {number} messages not published" for name, number in refused))


LATEST_SECOND = 64  # steps after a difference within which a second sample of its step comes
NEEDED = {"analyse": ("linkage", "forces"), "resimulate": ("linkage", "motor")}
TITLES = {"analyse": "forces recomputed from the recorded motion", "resimulate": "run recomputed from its start"}


def recompute_bag(request: ReplayVerb) -> None:
    """Print the result of the comparison; exit code 1 if anything differs or nothing could be compared.

    A difference at or after a step that was published twice, and not alike, proves nothing: that is not certain.
    """
    bag, mode = request.bag, "analyse" if request.analyse else "resimulate"
    settle_domain()
    from mech_twin.recording.bag_reader import open_bag
    from mech_twin.recording.bag_samples import BagSamples

    with open_bag(bag) as reader:
        samples = BagSamples(reader)
        history = _history(samples, bag, request.config)
        samples = BagSamples(reader, history.machine_at(0).coupling_step_s)
        if set(history.versions) != {__version__}:
            say(f"recorded with version {', '.join(history.versions)}; this is {__version__}: results may differ")
        for role, made in history.own_roles:
            say(f"recorded with {made} in the place of the {role}; here the package's own is computed")
        with progress(samples.steps(), samples.count, f"{mode[:-1]}ing") as steps:
            if mode == "analyse":
                verdict = analysed(steps, history.machine_at, request.tolerance or 0.0)
            else:
                verdict = resimulated(steps, history.machine_at)
            for _ in islice(steps, LATEST_SECOND):
                pass
        shared = shared_topics(reader.info.counters)
    _write(request, mode, samples, history, verdict)
    say(*(f"{topic}: answered by a node of your own; here the package's is computed" for topic in samples.users_nodes))
    say(*shared)
    if not verdict.identical:
        raise SystemExit(FOUND)


def _history(samples: BagSamples, bag: Path, config: Path | None) -> ConfigurationHistory:
    """Return the configurations of a recording, or the given one where it holds none."""
    texts = samples.descriptions()
    if config is None:
        if not texts:
            raise CommandError(f"{bag}: holds no configuration of the machine; expected --config FILE beside it")
        return ConfigurationHistory(texts, str(bag))
    if texts:
        raise CommandError(f"--config {config}: {bag} holds its own configuration, which says what ran")
    name = str(file_tree(config).get(MACHINE_KEY, samples.machine))
    return ConfigurationHistory([description_text(name, machine_parameters(name, config))], str(config))


def _write(
    request: ReplayVerb, mode: str, samples: BagSamples, history: ConfigurationHistory, verdict: Verdict
) -> None:
    first, doubted = None, samples.contradicted_from
    if verdict.first is not None:
        row = verdict.first._asdict()
        first = {"topic": samples.topics[row.pop("role")], **row}
    uncertain = first is not None and doubted is not None and first["step"] >= doubted
    numbers = {
        "machine": history.name,
        "identical": None if uncertain or not verdict.samples else verdict.identical,
        "steps_compared": verdict.steps,
        "samples_compared": verdict.samples,
        "incomplete_steps": verdict.missing_steps,
        "parameter_changes": history.changes,
    }
    if mode == "resimulate":
        numbers["resets"] = verdict.resets
    if request.as_json:
        more: dict[str, Any] = {"resumed_at_steps": verdict.taken_up, "unused_samples": samples.unused}
        more |= {"contradicted_from_step": doubted, "first_difference": first}
        print_json({"bag": request.bag, "recorded_with": history.versions, "version": __version__, **numbers, **more})
        return
    if numbers["identical"] is None:
        numbers["identical"] = "not certain" if uncertain else "nothing compared"
    numbers["machine"] = own_name(history.name, history.parameters)
    rows = [(name.replace("_", " "), value) for name, value in numbers.items()]
    print_table(f"{request.bag}: {TITLES[mode]}", ("quantity", "value"), rows)
    say(*(f"step {step}: resumed from the recorded state" for step in verdict.taken_up[:10]))
    say(*(f"{number} recorded samples not used: {reason}" for reason, number in samples.unused.items()))
    if uncertain:
        say(
            f"not certain from step {doubted} on: samples of it differ, so that a second publisher spoke; "
            "which of them the run used, no message tells"
        )
    if first is not None:
        say(
            f"first difference at {first['time_s']:.9g} s (step {first['step']}), topic {first['topic']}, "
            f"field {first['field']}: recorded {first['recorded']!r}, computed {first['computed']!r}"
        )
    elif not verdict.samples:
        absent = " and ".join(role for role in NEEDED[mode] if role not in samples.topics)
        say("nothing could be compared" + (f": the recording has no steps of the {absent}" if absent else ""))

# SPDX-License-Identifier: Apache-2.0
"""``mech-twin shadow``: follows a running machine by its topics and publishes what the model says of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from pydantic import ValidationError

from mech_twin.cli.console import CommandError, print_json, report_losses, say
from mech_twin.cli.live_view import (
    ADVISOR_ORDERS,
    IDENTIFIER_ORDERS,
    MONITOR_ORDERS,
    check_view,
    machine_message,
    opened_view,
)
from mech_twin.cli.measurement_verbs import ShadowVerb
from mech_twin.cli.monitor_baseline import read_setup
from mech_twin.cli.option_values import assigned
from mech_twin.declarations.configuration_tree import ConfigurationError, configuration_tree, value_in
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.output_file import check_output_directory
from mech_twin.nodes.run.domain import run_namespace, settle_domain
from mech_twin.parameters.errors import did_you_mean, key_units, refusal
from mech_twin.parameters.load import catalogue_entry, document_tree, kind_of
from mech_twin.recording.bag_metadata import check_recording_directory, kept_until_replaced
from mech_twin.results.opened_runs import given_map
from mech_twin.roles import own_name
from mech_twin.studies.advice import AdviceWish
from mech_twin.studies.advice_search import advice_model

if TYPE_CHECKING:
    from mech_twin.measurements.measurement_map import MeasurementMap
    from mech_twin.nodes.shadow.monitor_node import AlertOutlet


def shadow_machine(request: ShadowVerb) -> None:
    """Follow a machine until stopped and, at the end, tell what came of it."""
    parameters = request.parameters
    if request.black_box is not None:
        check_output_directory(request.black_box, force=True)
    deviations = key_deviations(parameters, request.uncertain) if request.uncertain else None
    given = None if request.given_map is None else given_map(request.given_map, request.built)
    reference = None
    if request.monitor is not None:
        reference = read_setup(request.monitor, request.machine, parameters, _sensors(request, given))
    wish = None if request.advise is None else _wish(request.advise, request, _sensors(request, given))
    check_view(request.view, request.view_port, force=request.force)
    settle_domain()
    machine, own = kind_of(request.machine), own_name(request.machine, parameters)
    if request.namespace is not None:
        own = run_namespace(machine, request.namespace).removeprefix("/")
    from mech_twin.nodes.shadow.session import Company, FreeKeys, follow, followed_namespace
    from mech_twin.nodes.shadow.shadow_node import ShadowSetup

    free = FreeKeys(*_free_keys(request, parameters)) if request.identify else None
    setup = ShadowSetup(followed_namespace(own, request.followed), given, deviations=deviations)
    if given is not None:
        _check_followed(given, request, setup.namespace)
    if request.record is not None:
        check_recording_directory(request.record, force=request.force)
        say(f"recording to {request.record}")
    say("starting (the first time compiles the numerical kernels, which takes up to a minute)")

    def say_following(node: object) -> None:
        say(f"following {setup.namespace}; estimates below /{own}/twin")

    with ExitStack() as stack:
        say(*stack.enter_context(kept_until_replaced(request.record)))
        view = opened_view(request.view, request.view_port, stack)
        if view.link is not None:
            offered = ((reference, MONITOR_ORDERS), (wish, ADVISOR_ORDERS), (free, IDENTIFIER_ORDERS))
            orders = [order for thing, each in offered if thing is not None for order in each]
            view.tell("machine", machine_message(own, f"/{own}", orders, None))
            view.tell("status", {"text": f"listening for {setup.namespace}"})
        outlets = _outlets(request, own)
        company = Company(request.record, reference, request.black_box, wish, view.destination, outlets, free)
        outcome = follow(machine, setup, parameters, company, request.duration_s, say_following, own)
        kept = "" if request.record is None else f"; recorded in {request.record}"
        view.tell("end", {"text": f"the shadow is over{kept}"})
    if request.as_json:
        found = {"machine": request.machine, "values": outcome.values, "messages_sent": outcome.sent}
        print_json({**found, "black_boxes": outcome.black_boxes})
    else:
        say(*(f"black box: {bag}" for bag in outcome.black_boxes))
        say(*(f"{name}: {value}" for name, value in outcome.values.items()))
    if outcome.silent:
        say(f"no sample came on {', '.join(outcome.silent)}; does the machine run?")
    report_losses(request.record, *outcome.black_boxes, known=outcome.failed_boxes)


def _check_followed(given: MeasurementMap, request: ShadowVerb, namespace: str) -> None:
    """Refuse a map by which no machine can be followed."""
    from mech_twin.nodes.shadow.inputs import followed_topics, sensed_channels

    try:
        sensed_channels(given)
        followed_topics(given, namespace)
    except ConfigurationError as error:
        raise CommandError(f"{request.given_map}: {error}") from error


def _free_keys(request: ShadowVerb, parameters: Parameters) -> tuple[tuple[str, ...], dict[str, tuple[float, float]]]:
    """Return the keys that may be identified, and their bounds."""
    from mech_twin.cli.identify import bounded_keys
    from mech_twin.studies.identification.keyed_configuration import AUTO, KeyedConfiguration, machine_keys

    try:
        keys, bounds = bounded_keys(request.identify)
        if AUTO in keys:
            keys = machine_keys(request.machine, parameters)
        keyed = KeyedConfiguration(request.machine, parameters, keys, bounds)
        keyed.check()
        keyed.search_range()
    except (CommandError, ConfigurationError) as error:
        raise CommandError(str(error).replace("--free", "--identify")) from error
    return keys, bounds


def _outlets(request: ShadowVerb, own: str) -> list[AlertOutlet]:
    """Return the outlets of alerts beside the diagnostics."""
    from mech_twin.nodes.shadow.monitor_node import MqttOutlet, PrometheusOutlet

    pages = [] if request.prometheus is None else [PrometheusOutlet(request.prometheus)]
    say(*(f"metrics for Prometheus on port {page.port}" for page in pages))
    return [*pages, *([] if request.mqtt is None else [MqttOutlet(request.mqtt, own)])]


def _wish(path: Path, request: ShadowVerb, sensors: MeasurementMap) -> AdviceWish:
    """Return an advisor's wish from a YAML file, checked against machine and channels."""
    columns, tree = [channel.quantity for channel in sensors.channels], document_tree(path)
    try:
        wish = AdviceWish.model_validate(tree)
        advice_model(catalogue_entry(kind_of(request.machine)), request.parameters, wish, columns)
    except ValidationError as error:
        raise refusal(str(path), error) from error
    except ConfigurationError as error:
        raise ConfigurationError(f"{path}: {error}") from error
    return wish


def key_deviations(parameters: Parameters, words: Sequence[str]) -> dict[str, float]:
    """Return the standard deviation of each key, in its unit, of ``KEY=2%`` of its value or ``KEY=0.1`` in its unit."""

    def sized(size: str) -> tuple[float, bool]:
        return float(size.removesuffix("%")), size.endswith("%")

    expected = "KEY=2% or KEY=NUMBER, not negative"
    demand = (expected, lambda found: math.isfinite(found[0]) and found[0] >= 0.0)
    values = {word.partition("=")[0].strip(): _number_of(parameters, word) for word in words}
    sizes = assigned("--uncertain", words, expected, sized, demand)
    return {key: size / 100.0 * abs(values[key]) if part else size for key, (size, part) in sizes.items()}


def _number_of(parameters: Parameters, word: str) -> float:
    key = word.partition("=")[0].strip()
    found = value_in(configuration_tree(parameters), key)
    if found is None:
        hint = did_you_mean(key, key_units(type(parameters)))
        raise CommandError(f"--uncertain {word}: the machine has no key '{key}'{hint}")
    if isinstance(found, bool) or not isinstance(found, int | float):
        raise CommandError(f"--uncertain {word}: expected a key that is a number, '{key}' is {found!r}")
    return float(found)


def _sensors(request: ShadowVerb, given: MeasurementMap | None) -> MeasurementMap:
    """Return the map that was given, else that of the twin's own topics."""
    from mech_twin.nodes.shadow.inputs import own_map

    return given or own_map(request.built)

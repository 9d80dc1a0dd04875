# SPDX-License-Identifier: Apache-2.0
"""One key of a configuration at an extreme value, through the command: what becomes of it.

An answer is whole and finite, or a refusal of one line that names the key or says what cannot be computed.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import math
import sys
import time
from collections.abc import Iterator, Mapping
from dataclasses import is_dataclass
from typing import Any, NamedTuple, get_args, get_origin
from unittest import mock

from configuration_draws import Leaf, is_group, leaves, value_at

from mech_twin.cli import console
from mech_twin.cli.main import main
from mech_twin.declarations.configuration_tree import configuration_tree
from mech_twin.declarations.quantity import Parameters
from mech_twin.files.plain_values import plain
from mech_twin.machines.catalog import CATALOGUE
from mech_twin.parameters.load import machine_parameters

MAGNITUDES = (5e-324, 1e-300, 1e-30, 1e-9, 1e9, 1e21, 1e30, 1e300)
FACTORS = (1e-6, 1e-3, 1e3, 1e6)
RUN_S = 0.05
RUN_STEPS = 50  # where the coupling step itself is changed
STEP = "step_s"
VERBS = ("analyse", "simulate")
FINE, REFUSED, BALANCE = "answered", "refused in one line", "a balance over its limit, said in one line"


class Case(NamedTuple):
    """A machine, a key and its value."""

    machine: str
    key: str
    value: float

    @property
    def words(self) -> dict[str, list[str]]:
        """The commands: an analysis and a short simulation."""
        steps_run = 0.0 < self.value < 1.0 and self.key.rpartition(".")[2] == STEP
        run_s = RUN_STEPS * self.value if steps_run else RUN_S
        setting = [self.machine, "--json", "--set", f"{self.key}={self.value!r}"]
        return {
            "analyse": ["analyse", *setting, "--crank-deg", "40"],
            "simulate": ["simulate", *setting, "--duration", repr(run_s)],
        }


class Outcome(NamedTuple):
    """What became of a case: of each verb one of the three good ends, or what is wrong; and the time it took."""

    ends: dict[str, str]
    seconds: float


def values_of(leaf: Leaf, now: Any) -> Iterator[float]:
    """Yield the extremes of a key: magnitudes of either sign, zero, decades off, its bounds and just beyond them."""
    low, high = leaf.bounds
    yield from (0.0, low, high, math.nextafter(low, -math.inf), math.nextafter(high, math.inf))
    for size in MAGNITUDES:
        yield from (size, -size)
    if isinstance(now, float | int) and now and math.isfinite(now):
        yield from (-now, *(factor * now for factor in FACTORS))


def cases(name: str) -> list[Case]:
    """Return the cases of a machine, each once: every key that is a number, at every extreme."""
    tree, found = configuration_tree(machine_parameters(name)), []
    for leaf in present_leaves(CATALOGUE[name].parameters, tree):
        if is_group(leaf.kinds) or get_origin(leaf.kinds[0]) is not None or float not in _numeric(leaf):
            continue
        values = dict.fromkeys(values_of(leaf, value_at(tree, leaf.path)))
        found += [Case(name, ".".join(leaf.path), value) for value in values]
    return found


def present_leaves(model: type[Parameters], tree: dict[str, Any], path: tuple[str, ...] = ()) -> Iterator[Leaf]:
    """Yield every key of a model, those of an optional group too where the configuration has that group."""
    for leaf in leaves(model, path):
        if leaf.optional and is_group(leaf.kinds) and value_at(tree, leaf.path) is not None:
            yield from present_leaves(leaf.kinds[0], tree, leaf.path)
        else:
            yield leaf


def _numeric(leaf: Leaf) -> tuple[Any, ...]:
    return tuple(itertools.chain(leaf.kinds, *(get_args(kind) for kind in leaf.kinds)))


def outcome_of(case: Case) -> Outcome:
    """Return what became of a case."""
    begun = time.perf_counter()
    ends = {verb: end_of(words) for verb, words in case.words.items()}
    return Outcome(ends, time.perf_counter() - begun)


def end_of(words: list[str]) -> str:
    """Run one command in this process; return its good end, or what is wrong with it."""
    said, errors, infinite = io.StringIO(), io.StringIO(), list[str]()
    noticing = mock.patch.object(console, "plain", lambda document: plain(_noticed(document, infinite)))
    with noticing, mock.patch.object(sys, "argv", ["mech-twin", *words]):
        try:
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(errors):
                main()
        except SystemExit as end:
            return _judged(end.code, said.getvalue(), errors.getvalue(), infinite)
        except Exception as error:  # noqa: BLE001 - what must never happen
            return f"{type(error).__name__}: {error}"
    return "the command did not end"


def _noticed(document: Any, infinite: list[str], name: str = "") -> Any:
    inside = document
    if is_dataclass(document):
        inside = vars(document)
    elif hasattr(document, "_asdict"):
        inside = document._asdict()
    elif hasattr(document, "tolist"):
        inside = document.tolist()
    if isinstance(inside, Mapping):
        for key, value in inside.items():
            if key != "config":  # infinity is a word of some keys
                _noticed(value, infinite, f"{name}.{key}")
    elif isinstance(inside, list | tuple):
        for value in inside:
            _noticed(value, infinite, name)
    elif isinstance(inside, float) and math.isinf(inside):
        infinite.append(f"{name} = {inside}")
    return document


def _judged(code: Any, said: str, errors: str, infinite: list[str]) -> str:
    if code == 0:
        json.loads(said)
        return f"not finite: {infinite[0]}" if infinite else FINE
    if code == 1 and errors.count("\n") >= 1 and "Traceback" not in errors:
        return BALANCE
    if code == 2 and errors.count("\n") == 1 and errors.startswith("mech-twin: ") and not said:
        return REFUSED
    return f"exit code {code}: {errors[-300:]}"

# SPDX-License-Identifier: Apache-2.0
"""``modelDescription.xml`` of a unit, in FMI 2.0 and 3.0."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import NamedTuple
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from mech_twin import __version__
from mech_twin.fmi.unit_variables import MachineUnit, Variable

BASE = {"kg": "kg", "m": "m", "s": "s", "rad": "rad", "A": "A"}
# what a unit is in base units: kg, m, s, rad; and how many of those
_NAMED = {
    "N": ("kg m s-2", 1.0), "W": ("kg m2 s-3", 1.0), "J": ("kg m2 s-2", 1.0), "Pa": ("kg m-1 s-2", 1.0),
    "Hz": ("s-1", 1.0), "deg": ("rad", 0.017453292519943295), "rpm": ("rad s-1", 0.10471975511965977),
    "min": ("s", 60.0),
}  # fmt: skip
TOOL = f"mech_twin {__version__}"


class BaseUnit(NamedTuple):
    """A unit as powers of base units and a factor."""

    powers: dict[str, int]
    factor: float


def base_unit(unit: str) -> BaseUnit | None:
    """Return a unit such as ``N.m/rad`` or ``kg m2`` in base units, None for one that has none."""
    powers: dict[str, int] = {}
    factor, sign = 1.0, 1
    for token in re.findall(r"/|[A-Za-z]+-?\d*|\d+", unit):
        if token == "/":
            sign = -1
        elif not token.isdigit():
            name, power = re.fullmatch(r"([A-Za-z]+)(-?\d*)", token).groups()  # type: ignore[union-attr]
            whole = sign * int(power or 1)
            if name in BASE:
                powers[name] = powers.get(name, 0) + whole
            elif name in _NAMED:
                inner, scale = _NAMED[name]
                factor *= scale**whole
                for base, exponent in re.findall(r"([a-z]+)(-?\d*)", inner):
                    powers[base] = powers.get(base, 0) + whole * int(exponent or 1)
            else:
                return None
    return BaseUnit({name: power for name, power in powers.items() if power}, factor)


def described(unit: MachineUnit, version: int, identifier: str, token: str) -> bytes:
    """Return the description of a unit.

    Parameters
    ----------
    unit : MachineUnit
        The machine.
    version : int
        2 or 3, of the standard.
    identifier, token : str
        Name of the library without its ending; what ties the library to this description.
    """
    name, step_s = unit.name, repr(float(unit.machine.coupling_step_s))
    able = {
        "modelIdentifier": identifier,
        "canHandleVariableCommunicationStepSize": "true",
        "canBeInstantiatedOnlyOncePerProcess": "false",
    }
    about = {"modelName": name, "generationTool": TOOL, "variableNamingConvention": "structured"}
    if version == 2:
        root = Element("fmiModelDescription", {"fmiVersion": "2.0", "guid": token, **about})
        SubElement(root, "CoSimulation", {**able, "canGetAndSetFMUstate": "true", "canSerializeFMUstate": "true"})
    else:
        root = Element("fmiModelDescription", {"fmiVersion": "3.0", "instantiationToken": token, **about})
        SubElement(
            root, "CoSimulation",
            {
                **able, "canGetAndSetFMUState": "true", "canSerializeFMUState": "true", "hasEventMode": "true",
                "fixedInternalStepSize": step_s,
            },
        )  # fmt: skip
    variables = unit.variables if version == 3 else tuple(v for v in unit.variables if v.causality != "independent")
    _units(root, variables)
    SubElement(SubElement(root, "LogCategories"), "Category", {"name": "logStatusError"})
    SubElement(root, "DefaultExperiment", {"startTime": "0", "stopTime": "1", "stepSize": step_s})
    if version == 2:
        _variables_2(root, variables)
    else:
        _variables_3(root, variables)
    indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root)


def _units(root: Element, variables: Iterable[Variable]) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(v.unit for v in variables if v.unit):
        entry = SubElement(definitions, "Unit", {"name": name})
        base = base_unit(name)
        if base is not None:
            powers = {key: str(power) for key, power in base.powers.items()}
            SubElement(entry, "BaseUnit", powers | ({} if base.factor == 1.0 else {"factor": repr(base.factor)}))


def _numbers(variable: Variable) -> dict[str, str]:
    """Return unit, bounds and start value of a number, as attributes in the order of the standard."""
    found = {"unit": variable.unit} if variable.unit else {}
    found |= {} if variable.least is None else {"min": repr(variable.least)}
    return found | ({} if variable.greatest is None else {"max": repr(variable.greatest)})


def _start(variable: Variable) -> dict[str, str]:
    if variable.start is None:
        return {}
    return {"start": ("true" if variable.start else "false") if variable.kind == "truth" else repr(variable.start)}


def _variables_2(root: Element, variables: tuple[Variable, ...]) -> None:
    element = {"real": "Real", "count": "Integer", "truth": "Boolean"}
    listed = SubElement(root, "ModelVariables")
    for v in variables:
        about = {"name": v.name, "valueReference": str(v.reference)}
        about |= {"description": v.meaning} if v.meaning else {}
        about |= {"causality": v.causality, "variability": v.variability}
        about |= {"initial": "exact"} if v.causality == "parameter" else {}
        SubElement(SubElement(listed, "ScalarVariable", about), element[v.kind], _numbers(v) | _start(v))
    structure = SubElement(root, "ModelStructure")
    for group in ("Outputs", "InitialUnknowns"):
        unknowns = SubElement(structure, group)
        for place, v in enumerate(variables, 1):
            if v.causality == "output":
                SubElement(unknowns, "Unknown", {"index": str(place)} | _no_dependence(group))


def _no_dependence(group: str) -> dict[str, str]:
    """Return that outputs follow inputs only a coupling step later."""
    return {"dependencies": ""} if group == "Outputs" else {}


def _variables_3(root: Element, variables: tuple[Variable, ...]) -> None:
    element = {"real": "Float64", "count": "Int32", "truth": "Boolean"}
    listed = SubElement(root, "ModelVariables")
    for v in variables:
        about = {"name": v.name, "valueReference": str(v.reference)}
        about |= {"description": v.meaning} if v.meaning else {}
        about |= {"causality": v.causality, "variability": v.variability}
        about |= {"initial": "exact"} if v.causality == "parameter" else {}
        SubElement(listed, element[v.kind], about | _numbers(v) | _start(v))
    structure = SubElement(root, "ModelStructure")
    for group in ("Output", "InitialUnknown"):
        for v in variables:
            if v.causality == "output":
                dependence = {"dependencies": ""} if group == "Output" else {}
                SubElement(structure, group, {"valueReference": str(v.reference)} | dependence)

# SPDX-License-Identifier: Apache-2.0
"""Writes a machine as a functional mock-up unit (``.fmu``)."""

import hashlib
import math
import re
import subprocess
import tempfile
import zipfile
from collections.abc import Iterable, Sequence
from importlib.resources import files
from pathlib import Path
from typing import NamedTuple
from uuid import UUID
from xml.etree.ElementTree import Element, SubElement, indent, tostring

from mech_twin import __version__
from mech_twin.engine.compiled_machine import compiled_machine
from mech_twin.errors import StudyError
from mech_twin.files.output_file import check_output_file, written_file
from mech_twin.fmi.step_object import ObjectFile, StepCode, of_interpreter
from mech_twin.fmi.unit_variables import FIRST_COMMAND, MachineUnit, Variable, unit_of
from mech_twin.parameters.description import description_text
from mech_twin.process.dependencies import require_extra
from mech_twin.roles import Machine

SUFFIX = ".fmu"
VERSIONS = (2, 3)
ZIP_TIME = (1980, 1, 1, 0, 0, 0)  # fixed, so that the same machine gives the same bytes
EVERY_SOURCE = ("unit.c", "runtime.c")


class Platform(NamedTuple):
    """A target platform: compiler triple, linker options, folders in FMI 2.0 and 3.0, suffix of the library."""

    triple: str
    linking: tuple[str, ...]
    folders: tuple[str, str]
    suffix: str


LINUX = Platform(
    "x86_64-unknown-linux-gnu",
    ("-target", "x86_64-linux-gnu.2.17", "-fPIC", "-Wl,-z,defs"),  # no undefined symbols
    ("linux64", "x86_64-linux"),
    ".so",
)
WINDOWS = Platform("x86_64-pc-windows-gnu", ("-target", "x86_64-windows-gnu"), ("win64", "x86_64-windows"), ".dll")


class Exported(NamedTuple):
    """An exported unit: its file, variables, and the configuration keys that an importer may set."""

    file: Path
    variables: tuple[Variable, ...]
    parameters: tuple[str, ...]


def export_fmu(
    machine: Machine,
    out: Path | str,
    version: int = 2,
    platforms: Sequence[Platform] = (LINUX,),
    *,
    force: bool = False,
) -> Exported:
    """Export a machine as a co-simulation unit that needs no Python.

    Parameters
    ----------
    out : path
        File to write, ``NAME.fmu``.
    version : int
        Version of the FMI standard, 2 or 3.
    platforms : sequence of Platform
        Target platforms.
    force : bool
        Whether an existing file may be overwritten.

    Raises
    ------
    ExportError
        The version is unknown, a role of the machine has no compiled kernel, or the linker fails.
    OutputError
        The file cannot be written.
    """
    if not isinstance(machine, Machine):
        raise ExportError(f"{machine!r:.80}: expected a machine, as `mech_twin.parameters.load.machine` returns it")
    if version not in VERSIONS:
        raise ExportError(f"version {version!r} of FMI: expected 2 or 3")
    if not platforms or not all(isinstance(platform, Platform) for platform in platforms):
        raise ExportError(f"platforms {platforms!r:.80}: expected at least one of LINUX and WINDOWS")
    out = Path(out)
    check_output_file(out, force=force, suffixes=(SUFFIX,))
    require_extra("fmu")
    compiled = compiled_machine(machine)
    if compiled is None:
        raise ExportError(f"{machine.name}: a role of it is no compiled kernel; expected kernels for all roles")
    unit = unit_of(machine, compiled)
    code = StepCode(compiled, unit.packed)
    token = _token(unit, version)
    libraries = {
        f"binaries/{platform.folders[version - 2]}/{unit.name}{platform.suffix}": _linked(
            unit, code, platform, version, token
        )
        for platform in platforms
    }
    content = {
        "modelDescription.xml": described(unit, version, token),
        "resources/configuration.yaml": description_text(machine.name, machine.parameters).encode(),
        **libraries,
    }
    with written_file(out, force=force) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, data in content.items():
            archive.writestr(zipfile.ZipInfo(name, ZIP_TIME), data, zipfile.ZIP_DEFLATED)
    return Exported(out, unit.variables, tuple(each.key.name for each in unit.adjustable))


def _token(unit: MachineUnit, version: int) -> str:
    """Return the GUID that links a library to its description; it depends on machine, FMI and program version."""
    key = repr((version, __version__, unit.packed, unit.first_row.tolist(), unit.variables))
    return f"{{{UUID(bytes=hashlib.sha256(key.encode()).digest()[:16])}}}"


def _linked(unit: MachineUnit, code: StepCode, platform: Platform, version: int, token: str) -> bytes:
    """Return the shared library for a platform."""
    import ziglang  # type: ignore[import-untyped]

    sources = files("mech_twin.fmi").joinpath("sources")
    compiled = code.object_file(platform.triple)
    with tempfile.TemporaryDirectory() as directory:
        place = Path(directory)
        names = [*EVERY_SOURCE, f"fmi{version}.c"]
        for name in (*names, "unit.h"):
            place.joinpath(name).write_bytes(sources.joinpath(name).read_bytes())
        place.joinpath("machine.h").write_text(_sizes(unit, token), encoding="utf-8")
        place.joinpath("machine_data.h").write_text(_constants(unit), encoding="utf-8")
        place.joinpath("interpreter.c").write_text(_interpreter(compiled), encoding="utf-8")
        place.joinpath("step.o").write_bytes(compiled.content)
        made = place / f"unit{platform.suffix}"
        words = [
            str(Path(ziglang.__file__).with_name("zig")), "cc", *platform.linking, "-shared", "-O2", "-s",
            "-fvisibility=hidden", "-fno-sanitize=all", "-o", str(made), *names, "interpreter.c", "step.o", "-lm",
        ]  # fmt: skip
        done = subprocess.run(words, cwd=place, capture_output=True, text=True, check=False)
        if done.returncode != 0 or not made.is_file():
            reason = next((line for line in done.stderr.splitlines() if "error" in line), done.stderr[-200:])
            raise ExportError(f"{unit.name}: the linker for {platform.triple} failed: {reason.strip()}")
        return made.read_bytes()


def _sizes(unit: MachineUnit, token: str) -> str:
    failures = getattr(unit.machine.linkage, "failures", ())
    counts = {
        "REAL_COUNT": len(unit.packed.reals), "WHOLE_COUNT": len(unit.packed.wholes),
        "FLAG_COUNT": len(unit.packed.flags), "ROW_COUNT": len(unit.first_row), "EFFORT_COUNT": len(unit.efforts),
        "SUPPLY_OFF": int(unit.supply_off), "MOTOR_COMMAND_PLACE": unit.compiled.layout.places.motor,
        "PARAMETER_COUNT": len(unit.adjustable), "KIND_COUNT": len(unit.kinds), "FAILURE_COUNT": len(failures),
    }  # fmt: skip
    lines = [f"#define {name} {count}" for name, count in counts.items()]
    lines += [f'#define TOKEN "{token}"', f'#define MACHINE_NAME "{unit.name}"']
    lines += [f"#define STEP_S {float(unit.machine.coupling_step_s)!r}", f"#define FIRST_COMMAND {FIRST_COMMAND!r}"]
    return "\n".join(lines) + "\n"


def _constants(unit: MachineUnit) -> str:
    adjustable = unit.adjustable
    begins = [0]
    for each in adjustable:
        begins.append(begins[-1] + len(each.places))
    failures = getattr(unit.machine.linkage, "failures", ())
    ranges = (f'"{each.least!r} to {each.greatest!r}"' for each in adjustable)
    return "\n".join(
        (
            _array("double", "REALS", map(_hexadecimal, unit.packed.reals)),
            _array("int64_t", "WHOLES", map(str, unit.packed.wholes)),
            _array("uint8_t", "FLAGS", (str(int(flag)) for flag in unit.packed.flags)),
            _array("double", "FIRST_ROW", map(_hexadecimal, unit.first_row.tolist())),
            _array("int", "EFFORT_PLACES", map(str, unit.efforts)),
            _array("int", "PARAMETER_BEGINS", map(str, begins)),
            _array("int", "PARAMETER_PLACES", (str(place) for each in adjustable for place in each.places)),
            _array("double", "PARAMETER_LEAST", (_hexadecimal(each.least) for each in adjustable)),
            _array("double", "PARAMETER_GREATEST", (_hexadecimal(each.greatest) for each in adjustable)),
            _array("int", "PARAMETER_LIVE", (str(int(each.key.live)) for each in adjustable)),
            _array("char *const", "PARAMETER_NAMES", (f'"{each.key.name}"' for each in adjustable)),
            _array("char *const", "PARAMETER_RANGES", ranges),
            _array("char *const", "FAILURES", (f'"{each.removeprefix(f"{unit.name}: ")}"' for each in failures)),
        )
    )


def _array(kind: str, name: str, values: object) -> str:
    """Return the C definition of an array; an empty one gets an unused zero, since C has no empty arrays."""
    listed = list(values) or ["0"]  # type: ignore[call-overload]
    return f"static const {kind} {name}[] = {{{', '.join(listed)}}};"


def _hexadecimal(value: float) -> str:
    """Return a number as an exact C literal."""
    if math.isnan(value):
        return "NAN"
    return value.hex() if math.isfinite(value) else f"{value:+f}"[0] + "INFINITY"


def _interpreter(code: ObjectFile) -> str:
    """Return C stubs of interpreter symbols, which exception tables refer to and no code uses."""
    functions = [f"void *{name}(void) {{ return 0; }}" for name in of_interpreter(code.functions)]
    return "\n".join([*functions, *(f"void *{name};" for name in of_interpreter(code.variables))]) + "\n"


class ExportError(StudyError):
    """An export failed; the message is one line with the machine or the tool, and what was expected."""


BASE = {"kg": "kg", "m": "m", "s": "s", "rad": "rad", "A": "A"}
# derived units as powers of the base units kg, m, s, rad, and factor
_NAMED = {
    "N": ("kg m s-2", 1.0), "W": ("kg m2 s-3", 1.0), "J": ("kg m2 s-2", 1.0), "Pa": ("kg m-1 s-2", 1.0),
    "Hz": ("s-1", 1.0), "deg": ("rad", 0.017453292519943295), "rpm": ("rad s-1", 0.10471975511965977),
    "min": ("s", 60.0),
}  # fmt: skip
TOOL = f"mech_twin {__version__}"


def base_unit(unit: str) -> tuple[dict[str, int], float] | None:
    """Return the powers of base units and the factor of ``N.m/rad`` or ``kg.m2``; None if a part is unknown."""
    powers: dict[str, int] = {}
    factor, sign = 1.0, 1
    for token in re.findall(r"/|[A-Za-z]+-?\d*|\d+|[^. ]", unit):
        if token == "/":
            sign = -1
        elif not token.isdigit():
            parts = re.fullmatch(r"([A-Za-z]+)(-?\d*)", token)
            if parts is None:
                return None
            name, power = parts.groups()
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
    return {name: power for name, power in powers.items() if power}, factor


def described(unit: MachineUnit, version: int, token: str) -> bytes:
    """Return the model description (XML) of a unit; ``token`` links its library to it."""
    name, step_s = unit.name, repr(float(unit.machine.coupling_step_s))
    able = {
        "modelIdentifier": unit.name,
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
    _variables(root, variables, version)
    indent(root)
    return b'<?xml version="1.0" encoding="UTF-8"?>\n' + tostring(root)


def _units(root: Element, variables: Iterable[Variable]) -> None:
    definitions = SubElement(root, "UnitDefinitions")
    for name in dict.fromkeys(v.unit for v in variables if v.unit):
        entry = SubElement(definitions, "Unit", {"name": name})
        base = base_unit(name)
        if base is not None:
            powers, factor = base
            scale = {} if factor == 1.0 else {"factor": repr(factor)}
            SubElement(entry, "BaseUnit", {key: str(power) for key, power in powers.items()} | scale)


def _numbers(variable: Variable) -> dict[str, str]:
    """Return unit and bounds of a variable as XML attributes, in the order of the standard."""
    found = {"unit": variable.unit} if variable.unit else {}
    found |= {} if variable.least is None else {"min": repr(variable.least)}
    return found | ({} if variable.greatest is None else {"max": repr(variable.greatest)})


def _start(variable: Variable) -> dict[str, str]:
    if variable.start is None:
        return {}
    return {"start": ("true" if variable.start else "false") if variable.kind == "truth" else repr(variable.start)}


def _about(variable: Variable) -> dict[str, str]:
    about = {"name": variable.name, "valueReference": str(variable.reference)}
    about |= {"description": variable.meaning} if variable.meaning else {}
    about |= {"causality": variable.causality, "variability": variable.variability}
    return about | ({"initial": "exact"} if variable.causality == "parameter" else {})


ELEMENTS = {
    2: {"real": "Real", "count": "Integer", "truth": "Boolean"},
    3: {"real": "Float64", "count": "Int32", "truth": "Boolean"},
}


def _variables(root: Element, variables: tuple[Variable, ...], version: int) -> None:
    """Add the variables, and which are outputs: these respond to inputs only a coupling step later."""
    listed = SubElement(root, "ModelVariables")
    for v in variables:
        kind, numbers = ELEMENTS[version][v.kind], _numbers(v) | _start(v)
        if version == 2:
            SubElement(SubElement(listed, "ScalarVariable", _about(v)), kind, numbers)
        else:
            SubElement(listed, kind, _about(v) | numbers)
    structure = SubElement(root, "ModelStructure")
    for group, dependence in (("Output", {"dependencies": ""}), ("InitialUnknown", {})):
        unknowns = SubElement(structure, f"{group}s") if version == 2 else structure
        for place, v in enumerate(variables, 1):
            if v.causality == "output" and version == 2:
                SubElement(unknowns, "Unknown", {"index": str(place)} | dependence)
            elif v.causality == "output":
                SubElement(unknowns, group, {"valueReference": str(v.reference)} | dependence)

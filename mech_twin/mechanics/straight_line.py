# SPDX-License-Identifier: Apache-2.0
"""Recorded expressions as straight-line source, kept in a file of its own content, compiled, and called by address.

A generated function fills ``out`` from numbers that stay (dimensions, masses), controls (drives, regimes), the time,
and the state.  Its name is a digest of its text, so that the store of compiled kernels finds it in another process.
"""

from __future__ import annotations

import hashlib
import importlib.util
import sys
import tempfile
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

from llvmlite import ir  # type: ignore[import-untyped]
from numba import njit, types
from numba.extending import intrinsic

from mech_twin.kernels.cache import directories
from mech_twin.kernels.kernel import straight_line_kernel
from mech_twin.mechanics.recording import Expression, Node, Number

PACKAGE = "mech_twin_generated"  # of the generated modules: no package on disk
ARGUMENTS = ("numbers", "controls", "t", "state", "out")
HEAD = "# Generated from the structure of a machine; the name of this file is the digest of its content.\n"
_types: Any = types
NUMBERS = _types.float64[::1]
POINTER = _types.CPointer(_types.float64)
SIGNATURE = (POINTER, POINTER, _types.float64, POINTER, POINTER)
_SIGNS = {"add": "+", "sub": "-", "mul": "*", "div": "/", "pow": "**"}


class Code(NamedTuple):
    """A compiled function: its symbol, and the text of LLVM that defines it."""

    symbol: str
    text: str


class Generated(NamedTuple):
    """A generated function: in Python, compiled, and how many numbers it fills."""

    function: Callable[..., None]
    compiled: Any
    size: int

    def address(self) -> int:
        """Return where the compiled code stands in this process."""
        self.compiled.compile(SIGNATURE)
        found = self.compiled.overloads[SIGNATURE]
        place = int(found.library.get_pointer_to_function(found.fndesc.llvm_func_name))
        _addressed[place] = self
        return place

    def code(self) -> Code:
        """Return the code as text of LLVM; compiled anew, since code from the store of kernels has none."""
        options = {name: value for name, value in self.compiled.targetoptions.items() if name != "nopython"}
        fresh = njit(**options)(self.function)
        fresh.compile(SIGNATURE)
        found = fresh.overloads[SIGNATURE]
        return Code(found.fndesc.llvm_func_name, found.library.get_llvm_str())


def generated_at(address: int) -> Generated | None:
    """Return the generated function at an address of this process, None where there is none."""
    return _addressed.get(address)


_addressed: dict[int, Generated] = {}


def straight_line_source(name: str, outputs: Sequence[Number]) -> str:
    """Return the source of a function that fills ``out`` with the outputs, one line for each operation it needs."""
    recording = next((x.recording for x in outputs if isinstance(x, Expression)), None)
    lines = [f"def {name}({', '.join(ARGUMENTS)}):"]
    if recording is not None:
        needed = _needed(recording.nodes, [x.index for x in outputs if isinstance(x, Expression)])
        lines += [f"    t{i} = {_text(recording.nodes[i])}" for i in needed]
    lines += [
        f"    out[{i}] = {f't{x.index}' if isinstance(x, Expression) else repr(float(x))}"
        for i, x in enumerate(outputs)
    ]
    return "\n".join([*lines, "    return"]) + "\n"


def _needed(nodes: Sequence[Node], wanted: Sequence[int]) -> list[int]:
    found: set[int] = set()
    waiting = list(wanted)
    while waiting:
        index = waiting.pop()
        if index not in found:
            found.add(index)
            waiting += [x for x in nodes[index][1:] if isinstance(x, int)]
    return sorted(found)


def _text(node: Node) -> str:
    left, right = (f"t{x}" if isinstance(x, int) else str(x) for x in node[1:])
    if node.operation == "leaf":
        return left
    if node.operation == "neg":
        return f"-{left}"
    if node.operation in _SIGNS:
        return f"{left} {_SIGNS[node.operation]} {right}"
    return f"{node.operation}({left})" if node.right is None else f"{node.operation}({left}, {right})"


def generated(functions: dict[str, Sequence[Number]]) -> dict[str, Generated]:
    """Return functions of these names that fill ``out`` with these expressions, from one file."""
    body = "\n\n".join(straight_line_source(name, outputs) for name, outputs in functions.items())
    module = _module(f"{HEAD}from math import cos, floor, inf, nan, sin, sqrt  # noqa: F401\n\n\n{body}")
    found = {}
    for name, outputs in functions.items():
        function = getattr(module, name)
        compiled = _compiled.setdefault(f"{module.__name__}.{name}", straight_line_kernel(function))
        found[name] = Generated(function, compiled, len(outputs))
    return found


_compiled: dict[str, Any] = {}


def _module(text: str) -> ModuleType:
    """Return the module of a text, which is written to the store if it is not there."""
    digest = hashlib.sha256(text.encode()).hexdigest()[:32]
    name = f"{PACKAGE}.structure_{digest}"
    if name in sys.modules:
        return sys.modules[name]
    file = _written(f"structure_{digest}.py", text)
    spec = importlib.util.spec_from_file_location(name, file)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    exec(compile(text, str(file), "exec"), module.__dict__)  # our own text, whatever stands in the file
    return module


def _written(name: str, text: str) -> Path:
    """Return the file of a text in the first directory that holds it or takes it."""
    for directory in (*directories(), Path(tempfile.mkdtemp(prefix="mech_twin-"))):
        file = directory / "generated" / name
        try:
            if file.is_file() and file.read_text(encoding="utf-8") == text:
                return file
            file.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.NamedTemporaryFile("w", dir=file.parent, delete=False, encoding="utf-8") as stream:
                stream.write(text)
            Path(stream.name).replace(file)
        except OSError:  # read-only or full: the next one
            continue
        return file
    raise OSError("no directory takes the generated source of the machine")


def _call(typing_context: Any, address: Any, numbers: Any, controls: Any, t: Any, state: Any, out: Any) -> Any:
    """Call a generated function at its address; the arrays are contiguous and of float64."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        kind = context.call_conv.get_function_type(_types.none, SIGNATURE).as_pointer()
        function = builder.inttoptr(arguments[0], kind)
        given = []
        for value, of_type in zip(arguments[1:], signature.args[1:], strict=True):
            is_array = isinstance(of_type, _types.Array)
            data = context.make_array(of_type)(context, builder, value).data if is_array else value
            given.append(builder.bitcast(data, ir.DoubleType().as_pointer()) if is_array else data)
        context.call_conv.call_function(builder, function, _types.none, SIGNATURE, given)
        return context.get_dummy_value()

    wanted = (_types.int64, NUMBERS, NUMBERS, _types.float64, NUMBERS, NUMBERS)
    return _types.none(*wanted), generate


call_straight_line: Any = intrinsic(_call)

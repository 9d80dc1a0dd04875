# SPDX-License-Identifier: Apache-2.0
"""Arithmetic that is recorded instead of done: constants folded, zeros dropped, equal expressions kept once.

A formulation written once on numbers runs on plain floats and gives values, or on the leaves of a `Recording` and
gives expressions.  These become straight-line source, kept in a file of its own content, compiled, and called by
address.  A generated function fills ``out`` from numbers that stay (dimensions, masses), controls (drives, regimes),
the time, and the state.  Its name is a digest of its text, so that the store of compiled kernels finds it in another
process.
"""

from __future__ import annotations

import hashlib
import importlib.util
import math
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


class Node(NamedTuple):
    """One operation: its name, and as operands indices of earlier nodes, or text: of a leaf, or of a constant."""

    operation: str
    left: int | str
    right: int | str | None = None


class Recording:
    """Operations in the order in which they were asked for."""

    def __init__(self) -> None:
        self.nodes: list[Node] = []
        self._known: dict[Node, int] = {}

    def leaf(self, text: str) -> Expression:
        """Return the expression that the generated source spells as ``text``, such as ``s[2]``."""
        return self.expression(Node("leaf", text))

    def expression(self, node: Node) -> Expression:
        """Return the expression of a node, the earlier one where it is known."""
        index = self._known.get(node)
        if index is None:
            index = self._known[node] = len(self.nodes)
            self.nodes.append(node)
        return Expression(self, index)


class Expression:
    """A number known when the generated source runs."""

    __slots__ = ("index", "recording")

    def __init__(self, recording: Recording, index: int) -> None:
        self.recording = recording
        self.index = index

    def __add__(self, other: Number) -> Number:
        return _sum(self, other)

    def __radd__(self, other: Number) -> Number:
        return _sum(self, other)

    def __sub__(self, other: Number) -> Number:
        return _difference(self, other)

    def __rsub__(self, other: Number) -> Number:
        return _difference(other, self)

    def __mul__(self, other: Number) -> Number:
        return _product(self, other)

    def __rmul__(self, other: Number) -> Number:
        return _product(self, other)

    def __truediv__(self, other: Number) -> Number:
        return _quotient(self, other)

    def __rtruediv__(self, other: Number) -> Number:
        return _quotient(other, self)

    def __neg__(self) -> Number:
        node = self.recording.nodes[self.index]
        if node.operation == "neg":
            return Expression(self.recording, int(node.left))
        return self.recording.expression(Node("neg", self.index))


Number = float | Expression


def _operand(x: Number) -> int | str:
    """Return an index for an expression, text for a constant: 1 and 1.0 would be the same node."""
    return x.index if isinstance(x, Expression) else repr(float(x))


def _home(a: Number, b: Number) -> Recording:
    chosen = a if isinstance(a, Expression) else b
    assert isinstance(chosen, Expression)
    return chosen.recording


def _unsigned(x: Number) -> tuple[bool, Number]:
    """Return whether a number is recorded as a negation, and the number without its sign."""
    if isinstance(x, Expression):
        node = x.recording.nodes[x.index]
        if node.operation == "neg":
            return True, Expression(x.recording, int(node.left))
    return False, x


def _ordered(operation: str, a: Number, b: Number) -> Number:
    """Record an operation whose operands may be exchanged."""
    left, right = sorted((_operand(a), _operand(b)), key=lambda x: (isinstance(x, int), x))
    return _home(a, b).expression(Node(operation, left, right))


def _sum(a: Number, b: Number) -> Number:
    if _is(a, 0.0):
        return b
    if _is(b, 0.0):
        return a
    (minus_a, x), (minus_b, y) = _unsigned(a), _unsigned(b)
    if minus_a and minus_b:
        return -_sum(x, y)
    if minus_b:
        return _difference(a, y)
    if minus_a:
        return _difference(b, x)
    return _ordered("add", a, b)


def _difference(a: Number, b: Number) -> Number:  # noqa: PLR0911 # one line a rule
    if _is(b, 0.0):
        return a
    if _is(a, 0.0):
        return -b
    (minus_a, x), (minus_b, y) = _unsigned(a), _unsigned(b)
    if minus_b:
        return _sum(a, y)
    if minus_a:
        return -_sum(x, b)
    left, right = _operand(a), _operand(b)
    if isinstance(left, int) and left == right and isinstance(right, int):
        return 0.0
    if isinstance(left, int) and isinstance(right, int) and left > right:  # b - a is kept, not both
        return -_home(a, b).expression(Node("sub", right, left))
    return _home(a, b).expression(Node("sub", left, right))


def _product(a: Number, b: Number) -> Number:
    for x, y in ((a, b), (b, a)):
        if _is(x, 0.0):
            return 0.0
        if _is(x, 1.0):
            return y
        if _is(x, -1.0):
            return -y
    (minus_a, x), (minus_b, y) = _unsigned(a), _unsigned(b)
    if minus_a or minus_b:
        return -_product(x, y) if minus_a != minus_b else _product(x, y)
    return _ordered("mul", a, b)


def _quotient(a: Number, b: Number) -> Number:
    if _is(a, 0.0):
        return 0.0
    if _is(b, 1.0):
        return a
    (minus_a, x), (minus_b, y) = _unsigned(a), _unsigned(b)
    if minus_a or minus_b:
        return -_quotient(x, y) if minus_a != minus_b else _quotient(x, y)
    return _home(a, b).expression(Node("div", _operand(a), _operand(b)))


def _is(x: Number, value: float) -> bool:
    return isinstance(x, float | int) and x == value


def is_zero(x: Number) -> bool:
    """Return whether a number is zero for all arguments."""
    return _is(x, 0.0)


def cosine(x: Number) -> Number:
    """Return cos x."""
    return x.recording.expression(Node("cos", x.index)) if isinstance(x, Expression) else math.cos(x)


def sine(x: Number) -> Number:
    """Return sin x."""
    return x.recording.expression(Node("sin", x.index)) if isinstance(x, Expression) else math.sin(x)


def square_root(x: Number) -> Number:
    """Return the square root."""
    return x.recording.expression(Node("sqrt", x.index)) if isinstance(x, Expression) else math.sqrt(x)


def magnitude(x: Number) -> Number:
    """Return |x|."""
    return x.recording.expression(Node("abs", x.index)) if isinstance(x, Expression) else abs(x)


def floor_of(x: Number) -> Number:
    """Return the largest whole number that is not above x."""
    return x.recording.expression(Node("floor", x.index)) if isinstance(x, Expression) else float(math.floor(x))


def smaller(a: Number, b: Number) -> Number:
    """Return the smaller of two numbers."""
    if isinstance(a, Expression) or isinstance(b, Expression):
        same = isinstance(a, Expression) and isinstance(b, Expression) and a.index == b.index
        return a if same else _ordered("min", a, b)
    return min(a, b)


def larger(a: Number, b: Number) -> Number:
    """Return the larger of two numbers."""
    if isinstance(a, Expression) or isinstance(b, Expression):
        same = isinstance(a, Expression) and isinstance(b, Expression) and a.index == b.index
        return a if same else _ordered("max", a, b)
    return max(a, b)


def power(base: Number, exponent: Number) -> Number:
    """Return a power."""
    if isinstance(base, Expression) or isinstance(exponent, Expression):
        return _home(base, exponent).expression(Node("pow", _operand(base), _operand(exponent)))
    return float(base**exponent)


def total(terms: Sequence[Number]) -> Number:
    """Return the sum in the order given, 0.0 of nothing."""
    result: Number = 0.0
    for term in terms:
        result = result + term
    return result


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
        """Return the address of the compiled code in this process."""
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

# SPDX-License-Identifier: Apache-2.0
"""The sources a kernel is compiled from: its module and the modules of its package that module imports, at any remove.

A kernel can call functions, freeze constants and take tuples apart from any of these, and compiled code has all of
it in line.  So their contents, not the date of one file, tell whether stored code is still right.
"""

from __future__ import annotations

import ast
import hashlib
import re
import sys
from collections.abc import Callable, Iterator
from functools import cache
from importlib.util import resolve_name
from pathlib import Path

OWN_PACKAGE = __name__.partition(".")[0]

# Contents at the time of import, by file: an edit of a file during a run does not change the code that runs.
_contents: dict[Path, bytes] = {}
_taken: set[str] = set()

_TYPING_ONLY = ("TYPE_CHECKING", "typing.TYPE_CHECKING")

# Imports stand before the first definition; parsing whole files would take a tenth of the start of a command.
_DEFINITION = re.compile(rb"^(?:def|class|async def|@)", re.MULTILINE)
_BLOCK = rb"(?:from|import|try|if|elif|else|with|for|while|match)\b"
_MAY_IMPORT = re.compile(rb"^" + _BLOCK + rb"|^class .*\n(?:(?: {4}.*)?\n)*? {4}" + _BLOCK, re.MULTILINE)


def keep_sources(module: str) -> None:
    """Read, when its first kernel is defined, a module's source and those of all loaded modules of the same package."""
    if module in _taken:
        return
    top = module.partition(".")[0]
    for name in [name for name in sys.modules if name.partition(".")[0] in {top, OWN_PACKAGE} and name not in _taken]:
        _taken.add(name)
        if file := getattr(sys.modules[name], "__file__", None):
            source(Path(file))


def has_known_sources(function: Callable[..., object]) -> bool:
    """Return whether a function is defined in a file of a package; imports of scripts or prompts are not tracked."""
    name = function.__module__
    return is_known_module(name) and Path(sys.modules[name].__file__ or "") == Path(function.__code__.co_filename)


def is_known_module(name: str) -> bool:
    """Return whether a module belongs to a package and has a readable file."""
    file = getattr(sys.modules.get(name), "__file__", None)
    return "." in name and file is not None and Path(file).is_file()


def source(file: Path) -> bytes:
    """Return the content of a source file as it was first read; empty where there is none."""
    if file not in _contents:
        _contents[file] = file.read_bytes() if file.is_file() else b""
    return _contents[file]


@cache
def sources_digest(module: str) -> str:
    """Return the SHA-256 (hexadecimal) over names and contents, not paths, of a module and all it imports."""
    total = hashlib.sha256()
    for name, file in sorted(closure(module).items()):
        content = source(file)
        total.update(f"{name}\0{len(content)}\0".encode())
        total.update(content)
    return total.hexdigest()


def closure(module: str) -> dict[str, Path]:
    """Return the file of each module that can have a part in the kernels of one, itself included, by module name."""
    own = getattr(sys.modules.get(module), "__file__", None)
    found = {module: Path(own)} if own else {}
    waiting = list(found)
    while waiting:
        name = waiting.pop()
        for imported in _imports(name, found[name]):
            file = None if imported in found else _file(imported, module.partition(".")[0])
            if file is not None:
                found[imported] = file
                waiting.append(imported)
    return found


@cache
def _imports(module: str, file: Path) -> tuple[str, ...]:
    """Return the names a module may import when it is loaded; some are no modules but names within one."""
    package = module if file.name == "__init__.py" else module.rpartition(".")[0]
    names: list[str] = []
    for statement in _loaded_statements(_statements(source(file))):
        if isinstance(statement, ast.Import):
            names += [name.name for name in statement.names]
        elif isinstance(statement, ast.ImportFrom):
            origin = resolve_name("." * statement.level + (statement.module or ""), package)
            names += [origin, *(f"{origin}.{name.name}" for name in statement.names)]
    return tuple(names)


def _statements(content: bytes) -> list[ast.stmt]:
    """Return the statements of a source, without its definitions where nothing after the first may import."""
    first = _DEFINITION.search(content)
    if first and not _MAY_IMPORT.search(content, first.start()):
        try:
            return ast.parse(content[: first.start()]).body
        except SyntaxError:  # a line of a text
            pass
    return ast.parse(content).body


def _loaded_statements(body: list[ast.stmt]) -> Iterator[ast.stmt]:
    """Yield the statements run at import; what a function imports when called is out of a kernel's reach."""
    for statement in body:
        yield statement
        if isinstance(statement, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        typing_only = isinstance(statement, ast.If) and ast.unparse(statement.test) in _TYPING_ONLY
        for inner in ("orelse",) if typing_only else ("body", "orelse", "finalbody"):
            yield from _loaded_statements(getattr(statement, inner, []))
        for handler in getattr(statement, "handlers", []):
            yield from _loaded_statements(handler.body)


@cache
def _file(name: str, package: str) -> Path | None:
    """Return the source file of a module of this package or of the kernel's, None for anything else."""
    top, *rest = name.split(".")
    root = getattr(sys.modules.get(top), "__file__", None)
    if root is None or top not in {OWN_PACKAGE, package}:
        return None
    if not rest:
        return Path(root)
    path = Path(root).parent.joinpath(*rest)
    return next((file for file in (path / "__init__.py", path.with_suffix(".py")) if file.is_file()), None)

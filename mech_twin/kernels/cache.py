# SPDX-License-Identifier: Apache-2.0
"""Cache of compiled kernels for numba, keyed by source content, so that no edit is missed.

numba's own cache checks only the file of the kernel itself, so code with an outdated inlined callee would stay in use.

Several directories are tried in turn.  Each file holds the code of one kernel for one signature, under a name made of
its key, and is put in place whole. There is no index, so processes that store at the same time have nothing to tear or
to overwrite.

A kernel is compiled from its module and the modules of its package that this one imports, at any remove.  It can call
functions, freeze constants and take tuples apart from any of these, and compiled code has all of it in line.  So
their contents, not the date of one file, tell whether stored code is still right.
"""

from __future__ import annotations

import ast
import contextlib
import fcntl
import hashlib
import logging
import os
import pickle
import platform
import re
import shutil
import stat
import sys
import tempfile
import time
import uuid
from collections.abc import Callable, Iterator
from functools import cache, lru_cache
from importlib.util import resolve_name
from pathlib import Path
from typing import Any

import llvmlite  # type: ignore[import-untyped]
import numba
import numpy as np
from numba.core import config, serialize, types

from mech_twin.kernels.dispatcher import has_machine_code, restored

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


DIRECTORY_VARIABLE = "MECH_TWIN_CACHE_DIR"
DAY_S = 86400.0
UNUSED_DAYS = 30
COMPILING = "compiling kernels for this machine, once; takes a minute or two"

Observer = Callable[[str, int], None]

# numba has type hints for its front only; what is used of the rest is its interface between dispatcher and cache
_types: Any = types
_settings: Any = config
_dumps: Any = serialize.dumps

_log = logging.getLogger("mech_twin.kernels")
_observers: list[Observer] = []
_compiled: list[str] = []


@lru_cache(maxsize=1)
def directories() -> tuple[Path, ...]:
    """Return the directories compiled kernels are looked for in, the preferred one first."""
    chosen = _user_directory()
    shared = _temporary_directory()
    return tuple(path for path in (chosen, shared) if path is not None)


def load(folder: str, name: str) -> bytes | None:
    """Return the content stored under a name; None if absent or incomplete."""
    for root in directories():
        try:
            content = (root / folder / name).read_bytes()
        except OSError:  # not there, or not ours to read: the next directory, or the compiler
            continue
        digest, payload = content[:32], content[32:]
        if hashlib.sha256(payload).digest() == digest:
            _mark_used(root / folder)
            return payload
        _log.warning("%s: damaged, compiled anew", root / folder / name)
    return None


def save(folder: str, name: str, payload: bytes) -> None:
    """Store a payload in the first directory that takes it; log once if none does."""
    content = hashlib.sha256(payload).digest() + payload
    for root in directories():
        try:
            _put(root / folder, name, content)
        except OSError:  # read-only, full, or not a directory: the next one
            continue
        _prune_daily(root)
        return
    _warn_unstored()


@lru_cache(maxsize=1)
def _warn_unstored() -> None:
    """Log, once a process, that kernels are compiled in memory only."""
    tried = ", ".join(map(str, directories())) or "no directory for them"
    _log.warning("compiled kernels cannot be kept (%s); set %s to a directory to write in", tried, DIRECTORY_VARIABLE)


def _user_directory() -> Path | None:
    """Return the directory the user named, or the one the XDG convention has; None without a home."""
    if named := os.environ.get(DIRECTORY_VARIABLE):
        return Path(named).absolute()
    cache, home = os.environ.get("XDG_CACHE_HOME", ""), os.environ.get("HOME", "")
    if Path(cache).is_absolute():
        return Path(cache) / "mech_twin" / "kernels"
    return Path(home) / ".cache" / "mech_twin" / "kernels" if Path(home).is_absolute() else None


def _temporary_directory() -> Path | None:
    """Return this user's directory under the one for temporary files, None if another could have written there."""
    try:
        path = Path(tempfile.gettempdir()) / f"mech_twin-kernels-{os.geteuid()}"
    except FileNotFoundError:  # no directory for temporary files either
        return None
    with contextlib.suppress(OSError):
        path.mkdir(mode=0o700)
    try:
        status = path.lstat()
    except OSError:
        return None
    private = stat.S_ISDIR(status.st_mode) and status.st_uid == os.geteuid() and not status.st_mode & 0o077
    return path if private else None


def _put(directory: Path, name: str, content: bytes) -> None:
    """Write a file under another name and move it into its place, so that readers see all of it or nothing."""
    directory.mkdir(parents=True, exist_ok=True)
    unfinished = directory / f".{name}.{uuid.uuid4().hex}"
    try:
        unfinished.write_bytes(content)
        unfinished.replace(directory / name)
    except OSError:
        with contextlib.suppress(OSError):
            unfinished.unlink()
        raise


def _mark_used(directory: Path) -> None:
    """Date a directory of kernels today, at most once a day; one that cannot be written is not pruned."""
    with contextlib.suppress(OSError):
        if time.time() - directory.stat().st_mtime > DAY_S:
            os.utime(directory)


def _prune_daily(root: Path) -> None:
    """Delete directories of kernels unused for 30 days, at most once a day and in one process at a time.

    A directory is moved out of sight before it is emptied: another process finds its files, or none and compiles.
    """
    with contextlib.suppress(OSError), (root / ".pruned").open("a+") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        lock.seek(0)
        now = time.time()
        if now - _seconds(lock.read()) < DAY_S:
            return
        lock.truncate(0)
        lock.write(str(now))
        for directory in [path for path in root.iterdir() if path.is_dir() and not path.is_symlink()]:
            if now - directory.stat().st_mtime > UNUSED_DAYS * DAY_S:
                hidden = root / f".removed-{uuid.uuid4().hex}"
                directory.rename(hidden)
                shutil.rmtree(hidden, ignore_errors=True)


def _seconds(text: str) -> float:
    """Return the time in a marker, zero if it holds none."""
    try:
        return float(text)
    except ValueError:
        return 0.0


def on_compile(observer: Observer) -> Callable[[], None]:
    """Call `observer(kernel, count)` before each compilation of this process, count from 1; return what ends that."""
    _observers.append(observer)
    return lambda: _observers.remove(observer)


def compiled_count() -> int:
    """Return how many kernels (one a signature) this process compiled, not counting those loaded."""
    return len(_compiled)


class KernelCache:
    """Cache of one kernel with the interface of numba's dispatcher (`numba.core.caching._Cache`)."""

    def __init__(self, function: Callable[..., object], options: str) -> None:
        keep_sources(function.__module__)
        self._function = function
        self._options = options
        self._known = self._enabled = has_known_sources(function)
        self.for_kernel = False

    @property
    def kernel_name(self) -> str:
        """Module and name of the kernel."""
        return f"{self._function.__module__}.{self._function.__qualname__}"

    @property
    def cache_path(self) -> str | None:
        """The preferred directory of compiled kernels, None if there is none."""
        return next(map(str, directories()), None)

    def enable(self) -> None:
        """Load and store again, if it is known what the kernel is compiled from."""
        self._enabled = self._known

    def disable(self) -> None:
        """Neither load nor store."""
        self._enabled = False

    def flush(self) -> None:
        """Do nothing: what is stored stays right, and other processes may be using it."""

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        """Return the stored code for a signature, None if it is to be compiled.

        Intermediate code is enough for a kernel that is being compiled (`for_kernel`).
        """
        target_context.refresh()
        stored = self._stored(signature, target_context) if self._enabled else None
        if stored is None:
            _tell_compiling(self.kernel_name)
        return stored

    def save_overload(self, signature: Any, result: Any) -> None:
        """Store compiled code, unless it holds addresses of this process."""
        if not self._enabled or not _storable(signature) or result.library.has_dynamic_globals or result.lifted:
            return
        save(self._folder(), self._name(signature, result.codegen), _dumps(result._reduce()))

    def _stored(self, signature: Any, target_context: Any) -> Any:
        name = self._name(signature, target_context.codegen())
        payload = load(self._folder(), name) if _storable(signature) else None
        if payload is None:
            return None
        try:
            reduced = pickle.loads(payload)
            return restored(target_context, reduced) if self.for_kernel or has_machine_code(reduced) else None
        except Exception as error:  # noqa: BLE001 # unpickling can raise anything; the compiler does not need it
            _log.warning("%s: stored code not usable (%s), compiled anew", name, error)
            return None

    def _folder(self) -> str:
        """Return the directory of the kernel's module: its name and what all its kernels are compiled from and with."""
        return f"{self._function.__module__}-{module_key(self._function.__module__)}"

    def _name(self, signature: Any, codegen: Any) -> str:
        """Return the file of one signature on one kind of processor."""
        code = self._function.__code__
        closed_over = _dumps(tuple(cell.cell_contents for cell in self._function.__closure__ or ()))
        key = (
            self._function.__qualname__, code.co_firstlineno, hashlib.sha256(code.co_code).hexdigest(),
            hashlib.sha256(closed_over).hexdigest(), self._options, signature_text(signature), codegen.magic_tuple(),
            *map(sources_digest, sorted(modules_of(signature))),
        )  # fmt: skip
        return f"{self._function.__name__}-{hashlib.sha256(repr(key).encode()).hexdigest()[:32]}"


@cache
def module_key(module: str) -> str:
    """Return a digest of the sources and of the versions and settings that decide what the compiler makes of them."""
    key = (
        sources_digest(module), numba.__version__, llvmlite.__version__, np.__version__,
        sources_digest(restored.__module__),  # how code is stored
        platform.python_implementation(), sys.version_info[:3], platform.machine(),
        _settings.OPT, _settings.BOUNDSCHECK, _settings.USING_SVML, _settings.DEBUGINFO_DEFAULT,
    )  # fmt: skip
    return hashlib.sha256(repr(key).encode()).hexdigest()[:32]


def signature_text(signature: Any) -> str:
    """Return the argument types as text, tuples with the names and order of their fields."""
    arguments = getattr(signature, "args", signature)
    return ", ".join(map(_type_text, arguments))


def _type_text(kind: Any) -> str:
    if isinstance(kind, _types.BaseNamedTuple):
        owner = kind.instance_class
        fields = (f"{name}: {_type_text(inner)}" for name, inner in zip(kind.fields, kind.types, strict=True))
        return f"{owner.__module__}.{owner.__qualname__}({', '.join(fields)})"
    if isinstance(kind, _types.BaseTuple):
        return f"({', '.join(map(_type_text, kind.types))},)"
    if isinstance(kind, _types.CPointer):
        return f"{_type_text(kind.dtype)}*"
    if isinstance(kind, _types.StructRef):
        fields = (f"{name}: {_type_text(inner)}" for name, inner in kind.field_dict.items())
        return f"{type(kind).__module__}.{type(kind).__qualname__}({', '.join(fields)})"
    return str(kind)


def modules_of(signature: Any) -> set[str]:
    """Return the modules of all named tuples in the argument types: a kernel may be made for what stands there.

    A kernel that calls `mech_twin.engine.integration.rates` has the equation of motion of the tuple's module in line.
    """
    found: set[str] = set()
    waiting = list(getattr(signature, "args", signature))
    while waiting:
        kind = waiting.pop()
        if isinstance(kind, _types.BaseNamedTuple):
            found.add(kind.instance_class.__module__)
        waiting += getattr(kind, "types", ()) if isinstance(kind, _types.BaseTuple) else ()
        waiting += [kind.dtype] if isinstance(kind, _types.CPointer) else []
        waiting += kind.field_dict.values() if isinstance(kind, _types.StructRef) else ()
    return found


def _storable(signature: Any) -> bool:
    """Return whether a signature has the same meaning in every process.

    One with a function as argument has not, nor one with a named tuple of a script or a prompt.
    """
    callables = any(isinstance(kind, _types.Callable) for kind in getattr(signature, "args", signature))
    known = all(map(is_known_module, modules_of(signature)))
    return known and not callables and " at 0x" not in signature_text(signature)


def _tell_compiling(kernel: str) -> None:
    """Count a compilation, say the first one, and call the observers."""
    if not _compiled:
        _log.info(COMPILING)
        if sys.stderr is not None and sys.stderr.isatty() and not _observers:
            sys.stderr.write(f"{COMPILING}\n")
    _compiled.append(kernel)
    for observer in tuple(_observers):
        observer(kernel, len(_compiled))

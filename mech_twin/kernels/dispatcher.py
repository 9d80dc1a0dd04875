# SPDX-License-Identifier: Apache-2.0
"""Dispatcher of kernels that makes machine code only of those that Python calls.

numba optimises a kernel and makes machine code of it before it compiles the one that calls it, so what is at the end
of ten calls is optimised eleven times.  Here a kernel called by another stays intermediate code: it is optimised with
its caller, and made machine code when Python calls it or asks for its address.
"""

import gc
import hashlib
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from functools import wraps
from typing import Any, TypeVar, cast

import llvmlite.binding as llvm  # type: ignore[import-untyped]
from numba.core import codegen, compiler, compiler_lock, registry, sigutils, target_extension, types
from numba.core import dispatcher as dispatchers
from numba.core.typing import templates

# numba has type hints for its front only
_Compiler: Any = compiler.Compiler
_Dispatcher: Any = registry.CPUDispatcher
_dispatchers: Any = dispatchers
_FunctionCompiler: Any = _dispatchers._FunctionCompiler
_Library: Any = codegen.JITCodeLibrary
_compiler: Any = compiler
_compile_result: Any = compiler.compile_result
_cpu: Any = registry.cpu_target
_lock: Any = compiler_lock.global_compiler_lock
_normalize: Any = sigutils.normalize_signature
_target: Any = target_extension
_templates: Any = templates
_types: Any = types

Function = TypeVar("Function", bound=Callable[..., Any])

INTERMEDIATE = "intermediate"
COLLECTED_AFTER = (50_000, 20, 50)  # as `gc.set_threshold` takes it, while a kernel is compiled


class Uncalled:
    """Stands for the entry point of a kernel without machine code."""


class IntermediateLibrary(_Library):  # type: ignore[misc]
    """Code of a kernel that is linked into its callers and has no address.

    Attributes
    ----------
    parts : dict
        The code of each kernel that it is made of, by digest: callees before their callers, its own last.
    """

    parts: dict[bytes, bytes]
    _shared_module: Any

    def serialize_using_object_code(self) -> Any:
        """Return the code in the form that is stored; see `restored`."""
        return self.name, INTERMEDIATE, (tuple(self.parts.values()),)

    def restore(self, codes: tuple[bytes, ...]) -> None:
        """Take stored code."""
        self.parts = {_digest(code): code for code in codes}
        self._finalized = True

    def finalize(self) -> None:
        """Keep its own code and that of what it calls apart: they are linked and optimised once, in the callers."""
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == llvm.Linkage.external:
                function.linkage = "linkonce_odr"  # several callers bring it along
        self._finalize_dynamic_globals()
        for library in self._linking_libraries:
            self._dynamic_globals += library._dynamic_globals
            self._reload_init.update(library._reload_init)
        own = self._final_module.as_bitcode()
        self.parts = {**_parts_of(self._linking_libraries), _digest(own): own}
        self._finalized = True

    def _get_module_for_linking(self) -> Any:
        """Return all its code as one module, for libraries of numba's own."""
        self._ensure_finalized()
        if self._shared_module is None:
            own, *callees = map(llvm.parse_bitcode, reversed(self.parts.values()))
            for module in callees:
                own.link_in(module)
            self._shared_module = own
        return self._shared_module


class LinkingLibrary(_Library):  # type: ignore[misc]
    """Code of a kernel with that of all kernels that it calls, optimised as a whole."""

    _linking_libraries: list[Any]

    def finalize(self) -> None:
        """Link what the kernel calls, each once, callers first: the linker takes what is called already."""
        for library in self._linking_libraries:
            self._reload_init.update(library._reload_init)
        for code in reversed(_parts_of(self._linking_libraries).values()):
            self._final_module.link_in(llvm.parse_bitcode(code))
        self._linking_libraries = []
        super().finalize()


def _digest(code: bytes) -> bytes:
    return hashlib.sha256(code).digest()


def _parts_of(libraries: Iterable[Any]) -> dict[bytes, bytes]:
    """Return the code of all kernels in libraries, callees first."""
    parts: dict[bytes, bytes] = {}
    for library in libraries:
        if isinstance(library, IntermediateLibrary):
            parts.update(library.parts)
        else:
            code = library._get_module_for_linking().as_bitcode()
            parts[_digest(code)] = code
    return parts


class AheadLibrary(LinkingLibrary):
    """Code optimised for an object file; this process makes no machine code of it."""

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True


def compiled_ahead(function: Callable[..., object], returned: Any, arguments: tuple[Any, ...]) -> tuple[str, str]:
    """Return the name of a function in intermediate code, and the code, with all kernels that it calls."""
    flags, target = _compiler.Flags(), _cpu
    target.options.parse_as_flags(flags, {"nopython": True, "no_cpython_wrapper": True, "no_cfunc_wrapper": True})
    flags.no_compile = True
    with _lock:
        library = AheadLibrary(target.target_context.codegen(), function.__qualname__)
        found = _compiler.compile_extra(
            target.typing_context, target.target_context, function, arguments, returned, flags, {}, library
        )
        library.finalize()
    return found.fndesc.llvm_func_name, library.get_llvm_str()


class MachineLibrary(LinkingLibrary):
    """Machine code of a kernel, and its intermediate code for kernels that call it, parsed when the first does."""

    _bitcode = b""
    _shared_module: Any

    def serialize_using_object_code(self) -> Any:
        """Return the code in the form that is stored; see `restored`."""
        name, kind, code = super().serialize_using_object_code()
        defined = (*self._shared_module.functions, *self._shared_module.global_variables)
        return name, kind, (*code, sorted(value.name for value in defined if not value.is_declaration))

    def restore(self, machine_code: bytes, bitcode: bytes, symbols: list[str]) -> None:
        """Take stored code."""
        self.enable_object_caching()
        self._set_compiled_object(machine_code)
        self._bitcode = bitcode
        self._finalize_final_module()
        self._codegen._engine._defined_symbols.update(symbols)

    def _get_module_for_linking(self) -> Any:
        if self._shared_module is None and self._bitcode:
            self._shared_module = llvm.parse_bitcode(self._bitcode)
        return super()._get_module_for_linking()


def has_machine_code(reduced: tuple[Any, ...]) -> bool:
    """Return whether a stored compile result can be called by Python."""
    return bool(reduced[0][1] != INTERMEDIATE)


def restored(target_context: Any, reduced: tuple[Any, ...]) -> Any:
    """Return the compile result of `CompileResult._reduce`, with the code in the form in which it was stored."""
    (name, _, code), fndesc, environment, signature, objectmode, lifted, annotation, reloads, environments = reduced
    for reload in reloads:
        reload()
    called = has_machine_code(reduced)
    library = (MachineLibrary if called else IntermediateLibrary)(target_context.codegen(), name)
    library.restore(*code)
    entry_point = target_context.get_executable(library, fndesc, environment) if called else Uncalled()
    for referenced in environments if called else ():
        library.codegen.set_env(referenced.env_name, referenced)
    return _compile_result(
        target_context=target_context, typing_context=target_context.typing_context, library=library,
        environment=environment, entry_point=entry_point, fndesc=fndesc, type_annotation=annotation,
        signature=signature, objectmode=objectmode, lifted=lifted, reload_init=reloads, referenced_envs=environments,
    )  # fmt: skip


class _KernelCompiler(_Compiler):  # type: ignore[misc]
    """numba's pipeline; a kernel without an entry point stays intermediate code."""

    def compile_extra(self, function: Callable[..., object]) -> Any:
        library = IntermediateLibrary if self.state.flags.no_compile else MachineLibrary
        self.state.library = library(self.state.targetctx.codegen(), function.__qualname__)
        self.state.library.enable_object_caching()  # or it cannot be stored
        return super().compile_extra(function)


class _KernelFlags(_compiler.Flags):  # type: ignore[misc]
    """numba's options, compared by those that are set: numba compared all of them for each call that it typed."""

    def __hash__(self) -> int:
        return 0  # few of them differ

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _KernelFlags) and bool(self._values == other._values)


class _SignatureCompiler(_FunctionCompiler):  # type: ignore[misc]
    """Compiler of one kernel: with an entry point for Python, or without."""

    for_kernel = False

    def _customize_flags(self, flags: Any) -> Any:
        flags.no_compile = flags.no_cpython_wrapper = self.for_kernel
        flags.no_cfunc_wrapper = True
        return _KernelFlags(flags)


class KernelDispatcher(_Dispatcher):  # type: ignore[misc]
    """numba's dispatcher for the processor; kernels called by kernels alone stay intermediate code."""

    def __init__(  # names and order are numba's, which makes one anew with them
        self, py_func: Callable[..., object], locals: Any = None, targetoptions: Any = None,  # noqa: A002
        pipeline_class: Any = _KernelCompiler,
    ) -> None:  # fmt: skip
        super().__init__(py_func, locals, targetoptions, pipeline_class)
        self._compiler = _SignatureCompiler(py_func, self.targetdescr, self.targetoptions, self.locals, pipeline_class)
        self._for_kernel = False

    def get_call_template(self, arguments: Any, keywords: Any) -> Any:
        """Return the template of a call from another kernel: literal types become general ones."""
        with self._called_by_kernel():
            known = {name: _types.unliteral(kind) for name, kind in keywords.items()}
            return super().get_call_template(tuple(map(_types.unliteral, arguments)), known)

    def compile_for_kernel(self, signature: Any) -> Any:
        """Compile for a kernel that is being compiled; return the result."""
        with self._called_by_kernel():
            self.compile(signature)
        return self.overloads[tuple(_normalize(signature)[0])]

    def compile(self, signature: Any) -> Any:
        """Compile or load; return the entry point."""
        with _lock:
            for_kernel, self._for_kernel = self._for_kernel, False
            arguments = tuple(_normalize(signature)[0])
            found = self.overloads.get(arguments)
            if found is not None:
                if for_kernel or not isinstance(found.entry_point, Uncalled):
                    return found.entry_point
                self.targetctx.remove_user_function(found.entry_point)
                del self.overloads[arguments]
            self._compiler.for_kernel = self._cache.for_kernel = for_kernel
            with _collecting_seldom():
                return super().compile(signature)

    def add_overload(self, result: Any) -> None:
        """Know a compiled signature; one without machine code is for kernels alone."""
        if result.entry_point is None:
            result = result._replace(entry_point=Uncalled())
            self.targetctx.insert_user_function(result.entry_point, result.fndesc, [result.library])
        if isinstance(result.entry_point, Uncalled):
            self.overloads[tuple(result.signature.args)] = result
            return
        super().add_overload(result)
        # what the code of its callees refers to, such as texts of errors
        for environment in result._find_referenced_environments():
            result.library.codegen.set_env(environment.env_name, environment)

    @contextmanager
    def _called_by_kernel(self) -> Iterator[None]:
        with _lock:
            self._for_kernel = True
            try:
                yield
            finally:
                self._for_kernel = False


@contextmanager
def _collecting_seldom() -> Iterator[None]:
    """Let Python look for garbage less often: the compiler's many small objects made that a seventh of its time."""
    before = gc.get_threshold()
    gc.set_threshold(*COLLECTED_AFTER)
    try:
        yield
    finally:
        gc.set_threshold(*before)


def on_processor() -> bool:
    """Return whether code is being compiled for the processor, and not for a graphics processor."""
    return _target.current_target() == "cpu"  # type: ignore[no-any-return]


def overload(
    generic: Callable[..., Any], inline: str = "never", forceinline: bool = False
) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Declare what a function is in kernels, for types of arguments, as `numba.extending.overload` does.

    The function that is chosen for the types is compiled like a kernel that kernels call.
    """
    options = {"nopython": True, "forceinline": forceinline}

    def dispatched(**options: Any) -> Callable[[Callable[..., Any]], KernelDispatcher]:
        return lambda function: KernelDispatcher(function, targetoptions=options)

    def declare(choose: Callable[..., Any]) -> Callable[..., Any]:
        template = _templates.make_overload_template(generic, choose, options, True, inline, False)
        for_target = template._get_jit_decorator
        template._get_jit_decorator = lambda self: dispatched if on_processor() else for_target(self)
        _templates.infer(template)
        _templates.infer_global(generic, _types.Function(template))
        return choose

    return declare


_by_type: dict[Callable[..., Any], dict[type, Any]] = {}  # the kernel for all other types under object


def generic(compiler: Callable[[Any], Any] | None = None) -> Callable[[Function], Function]:
    """Make a function generic: it calls the kernel for the type of its first argument, a `NamedTuple`.

    The compiler calls that kernel without a function between, whatever the caller is compiled for.

    Parameters
    ----------
    compiler : callable, optional
        Makes the function itself the kernel for types without one of their own (`set_kernel`).
    """

    def declare(function: Function) -> Function:
        @wraps(function)
        def call(model: Any, *arguments: Any) -> Any:
            return (kernel_of(call, type(model)) or function)(model, *arguments)

        _by_type[call] = {object: compiler(function) if compiler else None}
        template = type(function.__name__, (_KernelByType,), {"key": call, "functions": {}})
        _templates.infer_global(call, _types.Function(template))
        return cast("Function", call)

    return declare


def set_kernel(of: Callable[..., Any], model_type: type, kernel: Any) -> None:
    """Set the kernel of a generic function for a type."""
    _by_type[of][model_type] = kernel


def kernel_of(of: Callable[..., Any], model_type: type) -> Any:
    """Return the kernel of a generic function for a type; None if there is none."""
    kernels = _by_type[of]
    return kernels.get(model_type, kernels[object])


class _KernelByType(_templates.AbstractTemplate):  # type: ignore[misc]
    """How the compiler types a generic function: as the kernel for the type of the first argument."""

    key: Callable[..., Any]
    functions: dict[Any, Any]

    def generic(self, arguments: Any, keywords: Any) -> Any:
        owner = getattr(arguments[0], "instance_class", None)
        kernel = None if owner is None else kernel_of(type(self).key, owner)
        if kernel is None:
            return None
        function = self.context.resolve_value_type(kernel)
        found = function.get_call_type(self.context, arguments, keywords)
        self.functions[self.context, found.args] = function
        return found

    def get_impl_key(self, signature: Any) -> Any:
        return self.functions[self.context, signature.args].get_impl_key(signature)

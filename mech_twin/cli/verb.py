# SPDX-License-Identifier: Apache-2.0
"""A verb, declared once: a model of its options, from which command line, help, completion and reference derive."""

from collections.abc import Callable
from importlib import import_module
from inspect import Parameter, Signature
from pathlib import Path
from types import ModuleType
from typing import Annotated, Any, ClassVar, NamedTuple, Self, get_args, get_origin

import typer
from pydantic import BaseModel, ConfigDict, Field, ValidationError, ValidationInfo, field_validator, model_validator
from pydantic.fields import FieldInfo

from mech_twin.cli import option_values
from mech_twin.cli.console import CommandError, say
from mech_twin.files.output_file import check_output_file
from mech_twin.process.dependencies import require_extra

SIGNS = (("gt", ">"), ("ge", ">="), ("lt", "<"), ("le", "<="))  # bounds of a value
PLACEHOLDERS = {int: "N", float: "NUMBER", Path: "PATH"}


class Excludes(NamedTuple):
    """Two options that exclude each other, and why."""

    first: str
    second: str
    why: str


class Requires(NamedTuple):
    """An option that needs one of others beside it, and why."""

    option: str
    others: tuple[str, ...]
    why: str


Rules = tuple[Excludes | Requires, ...]


class Verb(BaseModel):
    """What a verb was asked for: a field for each option, named with its unit.

    Attributes
    ----------
    answer : str
        Function of this room that carries the verb out, ``MODULE:FUNCTION``; it is imported when the verb is called.
    rules : tuple
        Which options exclude each other, and which need another.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", defer_build=True)
    answer: ClassVar[str] = ""
    rules: ClassVar[Rules] = ()

    def __init_subclass__(cls, answer: str = "", **settings: Any) -> None:
        super().__init_subclass__(**settings)
        cls.answer = answer or cls.answer

    @field_validator("*", mode="before")
    @classmethod
    def _with_unit(cls, value: Any, info: ValidationInfo) -> Any:
        """Return a value as it is, a time that is written with its unit in seconds."""
        is_time = declared(cls.model_fields[str(info.field_name)]).get("unit") == "s"
        return option_values.seconds(value) if is_time and isinstance(value, str) else value

    @model_validator(mode="after")
    def _check_rules(self) -> Self:
        """Raise a CommandError, which names both and the reason, for options of which one would be left out."""

        def flag(name: str) -> str:
            return flags_of(name, type(self).model_fields[name])[0]

        given = self.model_fields_set
        for rule in (Excludes("as_json", "as_csv", "one form of output"), *self.rules):
            if isinstance(rule, Excludes) and {rule.first, rule.second} <= given:
                raise CommandError(f"{flag(rule.first)} and {flag(rule.second)} exclude each other: {rule.why}")
            if isinstance(rule, Requires) and rule.option in given and not given & set(rule.others):
                raise CommandError(f"{flag(rule.option)} goes with {' or '.join(map(flag, rule.others))}: {rule.why}")
        return self

    def carry_out(self) -> None:
        """Carry the verb out, and say which files it wrote; one that it could not write is refused beforehand."""
        self.check_outputs()
        before = {path: _stamp(path) for path in self.outputs()}
        module, _, function = self.answer.partition(":")
        try:
            getattr(import_module(f"mech_twin.cli.{module}"), function)(self)
        finally:
            written = [path for path, stamp in before.items() if _stamp(path) != stamp]
            if written and not getattr(self, "as_json", False):
                say(f"wrote {' and '.join(map(str, written))}")

    def check_outputs(self) -> None:
        """Raise where a file that is asked for could not be written."""
        for path, said in self.outputs().items():
            check_output_file(path, force=getattr(self, "force", False), suffixes=said["writes"])
            require_extra(said["extra"])

    def outputs(self) -> dict[Path, dict[str, Any]]:
        """Return the files that are asked for, and how their options are declared."""
        found: dict[Path, dict[str, Any]] = {}
        for name, field in type(self).model_fields.items():
            said = declared(field)
            path = self.written_to(name) if "writes" in said else None
            if path in found:
                raise CommandError(f"{flags_of(name, field)[0]} {path}: another option writes it; name another file")
            found |= {} if path is None else {path: said}
        return found

    def written_to(self, name: str) -> Path | None:
        """Return the file of an option: as asked, else the usual one of the machine, if there is one."""
        path, usual = getattr(self, name), declared(type(self).model_fields[name]).get("usual")
        return path or (Path(f"{Path(getattr(self, 'machine', '')).stem}-{usual}") if usual else None)


def _stamp(path: Path) -> int:
    """Return the time of a file's last change; 0 if there is no file."""
    return path.stat().st_mtime_ns if path.exists() else 0


def verbs_in(*modules: ModuleType) -> dict[str, type[Verb]]:
    """Return the verbs of modules that have an answer, by their word: that of `ListVerb` is ``list``."""
    kinds = [kind for module in modules for kind in vars(module).values() if isinstance(kind, type)]
    verbs = [kind for kind in kinds if issubclass(kind, Verb) and kind.answer]
    return {verb.__name__.removesuffix("Verb").lower(): verb for verb in verbs}


def option(
    meaning: str,
    default: Any = None,
    *flags: str,
    unit: str = "",
    metavar: str | None = None,
    shown: str | None = None,
    complete: str = "",
    writes: tuple[str, ...] | None = None,
    usual: str = "",
    extra: str = "",
    **bounds: Any,
) -> Any:
    """Return the field of an option.

    Parameters
    ----------
    meaning : str
        What it is for, in the help and in the reference.
    default : object
        Value where it is not given; ``...`` where it has to be.
    *flags : str
        How it is written, where not as the field without its unit: ``--duration`` of ``duration_s``.
    unit : str
        ``"s"`` for a time, which may be written with its unit.
    metavar : str, optional
        What stands for the value in the help.
    shown : str, optional
        The default in words.
    complete : str
        Function of `option_values` that offers values.
    writes : tuple of str, optional
        Of a file that is written: what its name may end in; anything if empty.
    usual : str
        Of such a file: name behind that of the machine, where it is not given.
    extra : str
        Extra that is needed to write it.
    **bounds
        ``ge`` and ``le`` of a number.
    """
    shown = f"MACHINE-{usual}" if usual else shown
    said: dict[str, Any] = {
        "flags": list(flags),
        "unit": unit,
        "metavar": metavar,
        "shown": shown,
        "complete": complete,
    }
    said |= {} if writes is None else {"writes": writes, "usual": usual, "extra": extra}
    return Field(default, description=meaning, json_schema_extra=said, **bounds)


def argument(meaning: str, default: Any = ..., *, metavar: str | None = None, complete: str = "") -> Any:
    """Return the field of a value that stands without an option; see `option`."""
    extra = {"argument": True, "metavar": metavar, "complete": complete}
    return Field(default, description=meaning, json_schema_extra=extra)  # type: ignore[arg-type] # JSON


def declared(field: FieldInfo) -> dict[str, Any]:
    """Return the declaration of a field by `option` or `argument`."""
    extra = field.json_schema_extra
    return extra if isinstance(extra, dict) else {}


def flags_of(name: str, field: FieldInfo) -> tuple[str, ...]:
    """Return an option as written on the command line, or an argument's word in the help."""
    said = declared(field)
    if said.get("argument"):
        return (said.get("metavar") or name.upper(),)
    bare = name.removesuffix(f"_{said['unit']}") if said.get("unit") else name
    return tuple(said.get("flags") or (f"--{bare.replace('_', '-')}",))


def in_order(verb: type[Verb]) -> dict[str, FieldInfo]:
    """Return the fields of a verb as the help has them: its own before those it shares with others."""
    fields = verb.model_fields
    return {name: fields[name] for name in sorted(fields, key=lambda name: name not in verb.__annotations__)}


def command(verb: type[Verb]) -> Callable[..., None]:
    """Return the function of a verb as the command line library wants it, its signature made from the fields."""

    def request(context: typer.Context, **values: Any) -> None:
        sources = {name: context.get_parameter_source(name) for name in values}
        given = {name: values[name] for name, source in sources.items() if source and source.name == "COMMANDLINE"}
        if context.obj is not None:  # of ``study``, whose machine stands before the question
            given["machine"] = context.obj
        try:
            asked = verb(**given)
        except ValidationError as error:
            raise CommandError(_refused(verb, error)) from error
        asked.carry_out()

    shown = {name: field for name, field in in_order(verb).items() if declared(field)}
    parameters = [Parameter("context", Parameter.POSITIONAL_OR_KEYWORD, annotation=typer.Context)]
    parameters += [_parameter(name, field) for name, field in shown.items()]
    request.__signature__ = Signature(parameters)  # type: ignore[attr-defined] # which the library reads
    request.__annotations__ = {each.name: each.annotation for each in parameters}
    request.__doc__ = verb.__doc__
    return request


def _refused(verb: type[Verb], error: ValidationError) -> str:
    """Return the line of the first value that was not taken: option, value, what was expected."""
    first = error.errors()[0]
    name, said = str(first["loc"][0]), first["msg"].removeprefix("Value error, ").partition(", unable to parse")[0]
    is_bound = "than" in first["type"]
    expected = said.replace("Input should be", "expected a number" if is_bound else "expected")
    return f"{flags_of(name, verb.model_fields[name])[0]} {first['input']}: {expected}"


def _kinds(field: FieldInfo) -> tuple[Any, ...]:
    return (field.annotation, *get_args(field.annotation))


def _parameter(name: str, field: FieldInfo) -> Parameter:
    """Return a field as a parameter of the command: a switch, a path, or words that the model reads."""
    kind: Any = next((kind for kind in (bool, Path) if kind in _kinds(field)), str)
    absent = str(field.default) if kind is str and field.default not in (None, []) else field.default or None
    default = Parameter.empty if field.is_required() else absent
    kind = list[kind] if get_origin(field.annotation) is list else kind
    return Parameter(
        name, Parameter.POSITIONAL_OR_KEYWORD, default=default, annotation=Annotated[kind, typer_parameter(name, field)]
    )


def typer_parameter(name: str, field: FieldInfo) -> Any:
    """Return a field as the command line library declares an option or an argument."""
    said = declared(field)
    complete = said.get("complete") or ""
    bounds = [
        f"{sign} {getattr(bound, word):g}" for bound in field.metadata for word, sign in SIGNS if hasattr(bound, word)
    ]
    meaning = f"{field.description} ({', '.join(bounds)})" if bounds else field.description
    options: dict[str, Any] = {"help": meaning, "metavar": said.get("metavar") or name.upper()}
    if complete:
        options["autocompletion"] = getattr(option_values, complete)
    if complete == "machines":
        options["callback"] = option_values.machine_name
    if said.get("argument"):
        return typer.Argument(**options)
    placeholder = next((PLACEHOLDERS[kind] for kind in _kinds(field) if kind in PLACEHOLDERS), "TEXT")
    options["metavar"] = said.get("metavar") or placeholder
    if said.get("unit") == "s":
        options["metavar"] = "TIME"
    return typer.Option(*flags_of(name, field), show_default=said.get("shown") or True, **options)

"""What is wrong with a test plan, in one line a fault: file, line, key, expected, found, remedy."""

from __future__ import annotations

import datetime
import re
from collections.abc import Container, Iterator, Mapping, Sequence
from difflib import get_close_matches
from pathlib import Path
from types import NoneType, UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from pipeline.errors import ExitCode, GyrostandError
from pipeline.plan_faults import FAULT, Fault
from pipeline.testplan.locate import Key, line_of

_LISTED = 16
"""Keys that an error lists."""
_LONGEST = 60
"""Characters of a value that an error quotes."""
_BARE = re.compile(r"[A-Za-z0-9_-]+")

_TYPES = {
    "string_type": "a string",
    "int_type": "a whole number",
    "float_type": "a number",
    "bool_type": "true or false",
    "tuple_type": "an array",
    "dict_type": "a table",
    "model_type": "a table",
    "finite_number": "a finite number",
}
_BOUNDS = {
    "greater_than": "a number above {gt:g}",
    "greater_than_equal": "a number of at least {ge:g}",
    "less_than": "a number below {lt:g}",
    "less_than_equal": "a number of at most {le:g}",
    "string_too_short": "a string that is not empty",
    "too_short": "at least {min_length} of them",
    "too_long": "{max_length} elements",
}


class PlanError(GyrostandError):
    """A test plan is missing or wrong.

    Its message has one line for each fault; the attributes are those of the first.

    Attributes
    ----------
    faults : tuple of PlanError
        One for each fault, this one among them.
    """

    exit_code = ExitCode.USAGE

    def __init__(self, where: str, *, expected: str, found: str, remedy: str) -> None:
        super().__init__(where, expected=expected, found=found, remedy=remedy)
        self.faults: tuple[PlanError, ...] = (self,)

    def __str__(self) -> str:
        return "\n".join(str(fault.args[0]) for fault in self.faults)


def plan_error(path: Path, lines: Mapping[Key, int], faults: Sequence[Fault]) -> PlanError:
    """The error that tells of these faults, in the order of the file.

    Parameters
    ----------
    path : Path
        The test plan.
    lines : mapping
        Line of each key, see `locate.key_lines`.
    faults : sequence of Fault
        At least one; keys from the top of the file.
    """
    ordered = sorted(faults, key=lambda fault: line_of(lines, fault.key))
    errors = tuple(
        PlanError(
            f"{shown_path(path)}:{line_of(lines, fault.key)}"
            + (f": {_dotted(fault.key)}" if fault.key else ""),
            expected=fault.expected,
            found=fault.found,
            remedy=fault.remedy,
        )
        for fault in ordered
    )
    errors[0].faults = errors
    return errors[0]


def shown_path(path: Path) -> str:
    """A path in one printable line."""
    return str(path) if str(path).isprintable() else repr(str(path))


def faults_of(error: ValidationError, data: Mapping[str, Any], model: type[BaseModel]) -> list[Fault]:
    """What pydantic found, in the words of a test plan.

    Parameters
    ----------
    error : ValidationError
    data : mapping
        The plan as it was read.
    model : type
        The model that refused it.
    """
    faults: dict[tuple[Key, object], Fault] = {}
    for number, details in enumerate(error.errors(include_url=False)):
        if details["type"] == "too_short" and len(details["input"]) >= details["ctx"]["min_length"]:
            continue  # only its sound elements are too few: what is wrong with the others is told
        key, rest = _split(details["loc"], data)
        fault = _fault(details, key, rest, model)
        if details["type"] in (FAULT, "missing"):  # each stands for itself
            faults[key, number] = fault
        elif (key, None) in faults:  # another choice for the same value
            first = faults[key, None]
            faults[key, None] = first._replace(expected=f"{first.expected} or {fault.expected}")
        else:
            faults[key, None] = fault
    return list(faults.values())


def unknown(key: Key, kind: str, known: Sequence[str]) -> Fault:
    """The fault of a name that is none of those known."""
    name = str(key[-1])
    near = get_close_matches(name, known, n=1)
    listed = ", ".join(known[:_LISTED]) + (", …" if len(known) > _LISTED else "")
    remedy = f"did you mean {near[0]!r}?" if near else "correct or remove it"
    return Fault(key, f"{kind}: {listed}", shown(name), remedy)


def shown(value: object) -> str:
    """A value of a test plan as an error quotes it."""
    match value:
        case bool():
            return str(value).lower()
        case Mapping():
            return "a table" if value else "an empty table"
        case list() | tuple():
            return f"an array of {len(value)}"
        case datetime.date() | datetime.time():
            return f"the date or time {value}"
    text = repr(value)
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}…"


def _split(loc: Sequence[str | int], data: Any) -> tuple[Key, tuple[str | int, ...]]:
    """The part of pydantic's location that is a key of the plan, and the rest (a missing key, a tag)."""
    for depth, part in enumerate(loc):
        keys: Container[object] = ()
        if isinstance(data, Mapping):
            keys = data
        elif isinstance(data, list | tuple):
            keys = range(len(data))
        if part not in keys:
            return tuple(loc[:depth]), tuple(loc[depth:])
        data = data[part]
    return tuple(loc), ()


def _fault(details: ErrorDetails, key: Key, rest: Sequence[str | int], model: type[BaseModel]) -> Fault:
    """One error of pydantic as a fault."""
    context = details.get("ctx", {})
    value = details["input"]
    match details["type"]:
        case str(kind) if kind == FAULT:
            return Fault(key, context["expected"], context["found"], context["remedy"])
        case "missing":
            return _missing(key, rest[-1], model)
        case "extra_forbidden":
            return unknown(key, "one of the keys", _keys(model, key))
        case "literal_error" if rest[-1:] == ("[key]",):
            return unknown(key, "one of the names", re.findall(r"'([^']*)'", context["expected"]))
        case "literal_error":
            words = re.findall(r"'([^']*)'", context["expected"])
            near = get_close_matches(value, words, n=1) if isinstance(value, str) else []
            remedy = f"did you mean {near[0]!r}?" if near else "choose one"
            return Fault(key, context["expected"], shown(value), remedy)
        case "value_error":
            expected, _, found = str(context["error"]).partition("; found ")
            return Fault(key, expected, found or shown(value), "correct it")
        case kind if kind in _BOUNDS:
            return Fault(
                key,
                _BOUNDS[kind].format(**context),
                shown(value),
                "fill it in" if value == "" else "correct it",
            )
        case kind:
            return Fault(key, _TYPES.get(kind, details["msg"]), shown(value), _advice(kind, value))


def _advice(kind: str, value: object) -> str:
    """What to do about a value of the wrong type."""
    if kind == "string_type":
        return "write it in quotes"
    if value == "":
        return "fill it in"
    if isinstance(value, str) and kind in ("int_type", "float_type", "bool_type"):
        return "write it without quotes"
    if kind == "int_type" and isinstance(value, float) and value.is_integer():
        return f"write {value:.0f}"
    return "correct it"


def _missing(key: Key, name: str | int, model: type[BaseModel]) -> Fault:
    if isinstance(name, int):
        return Fault(key, f"an element {name + 1} in the array", f"{name}", "give all of them")
    field = next((m.model_fields[name] for m in _models(model, key) if name in m.model_fields), None)
    meaning = f" ({field.description})" if field is not None and field.description else ""
    return Fault(key, f"the key {name!r}{meaning}", "none", f"add {name} = …")


def _keys(model: type[BaseModel], key: Key) -> list[str]:
    """The keys that may stand where an unknown one does."""
    return [name for m in _models(model, key[:-1]) for name in m.model_fields]


def _models(annotation: object, key: Key) -> Iterator[type[BaseModel]]:
    """The models that a type has at a key, unions and containers looked through."""
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        yield from _models(arguments[0], key)
    elif origin in (Union, UnionType):
        for option in arguments:
            if option is not NoneType:
                yield from _models(option, key)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        if not key:
            yield annotation
        elif key[0] in annotation.model_fields:
            yield from _models(annotation.model_fields[str(key[0])].annotation, key[1:])
    elif origin in (dict, tuple) and key:
        yield from _models(arguments[1] if origin is dict else arguments[0], key[1:])


def _dotted(key: Key) -> str:
    """A key as TOML writes it, with indices in brackets from 1."""
    text = ""
    for part in key:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            name = part if _BARE.fullmatch(part) else repr(part)
            text += f".{name}" if text else name
    return text

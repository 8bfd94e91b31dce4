"""Command-line options that are derived from the fields of configuration dataclasses.

A field determines its option: the name (with dashes), the type, the default, and the help, which is the docstring below
the field. `Annotated[T, parse]` sets the function that converts the option's text; it rejects a value by raising
`argparse.ArgumentTypeError`.
"""

from __future__ import annotations

import argparse
import ast
import inspect
import textwrap
from collections.abc import Callable
from dataclasses import fields
from itertools import pairwise
from math import nan
from pathlib import Path
from types import NoneType
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin, get_type_hints

Config = TypeVar("Config")


def add_options(parser: argparse._ActionsContainer, config: type, *names: str) -> None:  # pyright: ignore[reportPrivateUsage]
    """Add options for the named fields of a dataclass, which have defaults, to an `argparse` parser or group."""
    annotations = get_type_hints(config, include_extras=True)
    defaults = {field.name: field.default for field in fields(config)}
    docstrings = field_docstrings(config)
    for name in names:
        flag, default = "--" + name.replace("_", "-"), defaults[name]
        help_text = _help_text(docstrings[name]) + (" (default: %(default)s)" if default is not None else "")
        parser.add_argument(flag, default=default, help=help_text, **_conversion(annotations[name]))


def from_options(config: type[Config], args: argparse.Namespace, **values: Any) -> Config:
    """Make a configuration from parsed options and `values`; every other field keeps its default."""
    names = inspect.signature(config).parameters
    given = {name: value for name, value in vars(args).items() if name in names}
    return config(**{**given, **values})


def field_docstrings(config: type) -> dict[str, str]:
    """Read the docstrings below the fields of a class from its source."""
    (definition,) = ast.parse(textwrap.dedent(inspect.getsource(config))).body
    assert isinstance(definition, ast.ClassDef)
    return {
        field.target.id: inspect.cleandoc(text.value.value).replace("\n", " ")
        for field, text in pairwise(definition.body)
        if isinstance(field, ast.AnnAssign)
        and isinstance(field.target, ast.Name)
        and isinstance(text, ast.Expr)
        and isinstance(text.value, ast.Constant)
        and isinstance(text.value.value, str)
    }


def number_parser(rule: str, is_allowed: Callable[[float], bool]) -> Callable[[str], float]:
    """Make a parser of numbers for `Annotated`; `rule` names the allowed ones in the error message."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = nan
        if not is_allowed(value):
            raise argparse.ArgumentTypeError(f"must be {rule}, got {text!r}")
        return value

    return parse


def _help_text(docstring: str) -> str:
    """Turn a docstring into a help text: no capital at the start and no full stop."""
    text = docstring.rstrip(".").replace("%", "%%")
    return text if text[1:2].isupper() else text[:1].lower() + text[1:]


def _conversion(annotation: Any) -> dict[str, Any]:
    """Return `type`, `choices` and `metavar` of `add_argument`."""
    if NoneType in get_args(annotation):
        (annotation,) = (member for member in get_args(annotation) if member is not NoneType)
    parse = None
    if get_origin(annotation) is Annotated:
        annotation, parse = get_args(annotation)
    if get_origin(annotation) is Literal:
        return {"type": parse or str, "choices": get_args(annotation)}
    return {"type": parse or annotation, "metavar": "PATH" if annotation is Path else None}

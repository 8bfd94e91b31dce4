"""Reads JSON of bounded size and depth."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from ..records.errors import LiveHandError
from .regular_file import MIB, read_regular

MOST_JSON_BYTES = 128 * MIB
_DEEPEST = 60
_LONGEST_INTEGER = 18  # digits that a whole number of 64 bits always holds
_TEXT = re.compile(rb'"(?:[^"\\]|\\.)*+"', re.DOTALL)
_OTHERS = bytes(set(range(256)) - set(b"[]{}"))


def read_json(path: Path, most_bytes: int = MOST_JSON_BYTES) -> Any:
    """The document of a JSON file; whole numbers of more than 18 digits are read as floats.

    Raises:
        LiveHandError: the file is missing, damaged, too large or nested too deeply.
    """
    return parse_json(read_regular(path, most_bytes), str(path))


def parse_json(raw: bytes, subject: str) -> Any:
    """The document of a text in JSON.

    Raises:
        LiveHandError: as `read_json`, about the subject.
    """
    if nesting(raw) > _DEEPEST:
        raise LiveHandError(f"{subject} must nest lists and objects at most {_DEEPEST} deep, got {nesting(raw)}")
    try:
        return json.loads(raw.decode("utf-8-sig"), parse_int=_integer)
    except (ValueError, RecursionError, MemoryError) as error:
        raise LiveHandError(
            f"{subject} must be well-formed JSON, got {type(error).__name__}: {str(error)[:200]}"
        ) from error


def nesting(raw: bytes) -> int:
    """How deeply lists and objects nest in a text, brackets within its strings aside."""
    brackets = np.frombuffer(_TEXT.sub(b"", raw).translate(None, _OTHERS), np.uint8)
    opens = (brackets == ord("[")) | (brackets == ord("{"))
    return int(np.cumsum(np.where(opens, 1, -1)).max(initial=0))


def _integer(text: str) -> int | float:
    return int(text) if len(text) <= _LONGEST_INTEGER else float(text)

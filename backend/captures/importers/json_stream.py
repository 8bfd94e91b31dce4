"""Large JSON documents read entry by entry: memory holds one entry and a megabyte of text, never the document.

InterHand2.6M's index of images is over a gigabyte of JSON, which Python's own reader turns into several times that.
"""

from __future__ import annotations

import json
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, TextIO

from ...records.errors import LiveHandError

_CHUNK = 1 << 20  # characters
_BLANKS = " \t\r\n"


def list_entries(path: Path, keys: Collection[str]) -> Iterator[tuple[str, Any]]:
    """(key, entry) of the lists that a document {key: [entry, ...], ...} holds under `keys`, in the file's order.

    Raises:
        LiveHandError: missing, cut short, no JSON, or no such lists.
    """
    missing = set(keys)
    with _opened(path) as file:
        reader = _Reader(file, path)
        for key in reader.keys():
            if key in keys and reader.peek() == "[":
                missing.discard(key)
                for entry in reader.entries():
                    yield key, entry
            else:
                reader.skip()
    if missing:
        raise LiveHandError(f"{path} must hold lists {sorted(keys)}, got none under {sorted(missing)}")


def member(path: Path, key: str) -> Any:
    """What a document {key: value, ...} holds under `key`; other members are passed over.

    Raises:
        LiveHandError: missing, cut short, no JSON, or no such key.
    """
    others = []
    with _opened(path) as file:
        reader = _Reader(file, path)
        for name in reader.keys():
            if name == key:
                return reader.value()
            others.append(name)
            reader.skip()
    raise LiveHandError(f"{path} must hold {key!r}, got {others[:40]}")


def member_names(path: Path) -> Iterator[str]:
    """The keys of a document {key: value, ...} in the file's order; a value is read when the next key is asked for.

    Raises:
        LiveHandError: missing, cut short or no JSON.
    """
    with _opened(path) as file:
        reader = _Reader(file, path)
        for name in reader.keys():
            yield name
            reader.skip()


def _opened(path: Path) -> TextIO:
    try:
        return path.open(encoding="utf-8")
    except OSError as error:
        raise LiveHandError(f"{path} must be a readable JSON file ({error})") from error


class _Reader:
    """A place in a JSON text of which a part is in memory."""

    def __init__(self, file: TextIO, path: Path):
        self._file, self._path = file, path
        self._decoder = json.JSONDecoder()
        self._text, self._at = "", 0

    def keys(self) -> Iterator[str]:
        """The keys of the object that begins here; the caller reads the value of each before the next."""
        self._expect("{")
        while self.peek() != "}":
            key = self.value()
            if not isinstance(key, str):
                raise self._error("keys must be text")
            self._expect(":")
            yield key
            self._expect_separator("}")
        self._expect("}")

    def entries(self) -> Iterator[Any]:
        """The entries of the list that begins here."""
        self._expect("[")
        while self.peek() != "]":
            yield self.value()
            self._expect_separator("]")
        self._expect("]")

    def skip(self) -> None:
        """Pass over a value; of a list, one entry at a time."""
        if self.peek() == "[":
            for _ in self.entries():
                pass
        else:
            self.value()

    def value(self) -> Any:
        """The value that begins here."""
        self.peek()
        while True:
            try:
                value, end = self._decoder.raw_decode(self._text, self._at)
            except json.JSONDecodeError as error:
                if not self._read_on():
                    raise self._error(str(error)) from error
            except RecursionError as error:
                raise self._error("too deeply nested") from error
            else:
                if end < len(self._text) or not self._read_on():  # a number may go on in the next chunk
                    self._at = end
                    return value

    def peek(self) -> str:
        """The next character that is no blank; empty at the end."""
        while True:
            while self._at < len(self._text):
                if self._text[self._at] not in _BLANKS:
                    return self._text[self._at]
                self._at += 1
            if not self._read_on():
                return ""

    def _expect(self, character: str) -> None:
        found = self.peek()
        if found != character:
            raise self._error(f"expected {character!r}, got {found!r}")
        self._at += 1

    def _expect_separator(self, end: str) -> None:
        if self.peek() != end:
            self._expect(",")

    def _read_on(self) -> bool:
        """Read as much again as is in memory, so that a long value costs no more than twice; False at the end."""
        rest = self._text[self._at :]
        try:
            more = self._file.read(max(_CHUNK, len(rest)))
        except (OSError, UnicodeDecodeError) as error:
            raise self._error(str(error)) from error
        self._text, self._at = rest + more, 0
        return bool(more)

    def _error(self, what: str) -> LiveHandError:
        return LiveHandError(f"{self._path} must be whole, well-formed JSON ({what}); download it again")

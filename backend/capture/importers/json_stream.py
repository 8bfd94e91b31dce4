"""Large JSON documents, read entry by entry with ijson, so that memory never holds the whole document.

The image index of InterHand2.6M is over a gigabyte of JSON; Python's own reader needs several times that in memory.
Values are built from ijson's basic events: its `items` spells out the path of every event, which a deeply nested file
turns into gigabytes, and is slower.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...records.errors import LiveHandError
from ...system.files import check_regular

_BUFFER_BYTES = 1 << 16
_END_MAP, _END_ARRAY = ("end_map", None), ("end_array", None)

Event = tuple[str, Any]


def list_entries(path: Path, keys: Collection[str], buffer_bytes: int = _BUFFER_BYTES) -> Iterator[tuple[str, Any]]:
    """Yield (key, entry) of the lists that a document {key: [entry, ...], ...} holds under `keys`, in file order.

    Raises:
        LiveHandError: the file is missing, cut short or not JSON, or lacks one of the lists.
    """
    missing = set(keys)
    with _events(path, buffer_bytes) as events:
        for key in _members(events):
            first = next(events)
            if key not in keys or first[0] != "start_array":
                _value(first, events)
                continue
            missing.discard(key)
            for entry in iter(events.__next__, _END_ARRAY):
                yield key, _value(entry, events)
    if missing:
        raise LiveHandError(f"{path} must hold lists {sorted(keys)}, got none under {sorted(missing)}")


def member(path: Path, key: str, buffer_bytes: int = _BUFFER_BYTES) -> Any:
    """Yield the value that a document {key: value, ...} holds under `key`; one value at a time is in memory.

    Raises:
        LiveHandError: the file is missing, cut short or not JSON, or lacks the key.
    """
    others = []
    with _events(path, buffer_bytes) as events:
        for name in _members(events):
            value = _value(next(events), events)
            if name == key:
                return value
            others.append(name)
    raise LiveHandError(f"{path} must hold {key!r}, got {others[:40]}")


def member_names(path: Path) -> Iterator[str]:
    """Yield the keys of a document {key: value, ...} in file order; a value is read when the next key is requested.

    Raises:
        LiveHandError: the file is missing, cut short or not JSON.
    """
    with _events(path, _BUFFER_BYTES) as events:
        for name in _members(events):
            yield name
            _value(next(events), events)


@contextmanager
def _events(path: Path, buffer_bytes: int) -> Iterator[Iterator[Event]]:
    """Yield the file's (event, value) pairs; errors of the file and of its JSON become `LiveHandError`."""
    try:
        import ijson
    except ImportError as error:
        raise LiveHandError(f"large JSON files need ijson ({error}); install it with: pip install ijson") from error
    try:
        check_regular(path)
    except LiveHandError as error:
        raise LiveHandError(f"{path} must be a readable JSON file ({error})") from error
    try:
        with path.open("rb") as file:
            yield ijson.basic_parse(file, use_float=True, buf_size=buffer_bytes)
    except OSError as error:
        raise LiveHandError(f"{path} must be a readable JSON file ({error})") from error
    except (ijson.JSONError, ValueError, RecursionError) as error:
        raise LiveHandError(f"{path} must be whole, well-formed JSON ({error}); download it again") from error


def _members(events: Iterator[Event]) -> Iterator[str]:
    """Yield the keys of the document's object; the caller consumes the value of each before the next."""
    if next(events) != ("start_map", None):
        raise ValueError("expected an object")
    for _, key in iter(events.__next__, _END_MAP):
        yield key


def _value(first: Event, events: Iterator[Event]) -> Any:
    """Build the value whose first event is given; its other events are consumed."""
    event, value = first
    if event == "start_map":
        return {key: _value(next(events), events) for _, key in iter(events.__next__, _END_MAP)}
    if event == "start_array":
        return [_value(entry, events) for entry in iter(events.__next__, _END_ARRAY)]
    return value

"""The records beside a frame: of each of its files, what made it.

One JSON object describes the files that were rendered together, named by its key `formats`. What a later run adds to
the frame has a record of its own under the first one's key `added`; records of files that stay are kept as they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..records.errors import LiveHandError
from ..system.readers import read_json

_MOST_BYTES = 1 << 24

FrameRecord = dict[str, Any]


def read_records(path: Path, present: Sequence[str]) -> list[FrameRecord]:
    """Read the records in a file, each with its `formats`; none if there is no such file, or it holds something else.

    Args:
        path: of the file.
        present: the formats that the frame has; a record of an early version names none, and describes all of them.
    """
    try:
        first = read_json(path, _MOST_BYTES)
    except LiveHandError:
        return []
    if not isinstance(first, dict):
        return []
    added = first.pop("added", [])
    records = [first, *(added if isinstance(added, list) else [])]
    return [_with_formats(record, present) for record in records if isinstance(record, dict)]


def record_of(records: Sequence[FrameRecord], file_format: str) -> FrameRecord | None:
    """Find the record of one of the frame's files; None if none describes it."""
    return next((record for record in records if file_format in record["formats"]), None)


def kept_records(records: Sequence[FrameRecord], formats: Sequence[str]) -> list[FrameRecord]:
    """Select the records of the files in these formats, which stay."""
    kept = [{**one, "formats": [name for name in one["formats"] if name in formats]} for one in records]
    return [record for record in kept if record["formats"]]


def joined_records(kept: Sequence[FrameRecord], new: Mapping[str, Any]) -> FrameRecord:
    """Join the records that stay and a new one; a file that was made in the same way shares its record."""
    for record in kept:
        if {**record, "formats": new["formats"]} == new:
            merged = {**record, "formats": [*record["formats"], *new["formats"]]}
            return _nested([merged if one is record else one for one in kept])
    return _nested([*kept, dict(new)])


def _nested(records: Sequence[FrameRecord]) -> FrameRecord:
    first, *added = records
    return {**first, "added": added} if added else dict(first)


def _with_formats(record: FrameRecord, present: Sequence[str]) -> FrameRecord:
    formats = record.get("formats")
    is_list = isinstance(formats, list) and all(isinstance(name, str) for name in formats)
    return record if is_list else {**record, "formats": list(present)}

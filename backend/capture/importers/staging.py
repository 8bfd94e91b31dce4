"""Writes a capture completely or not at all.

The capture is written to `NAME.partial` and renamed at the end; repeating an interrupted import resumes it.
"""

from __future__ import annotations

import shutil
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

from tqdm import tqdm

from ...records.errors import LiveHandError
from ...system.files import MIB, check_regular, replacing
from ..capture import Capture, index_document, load_capture, save_capture_index

_MOST_BYTES = 1024 * MIB  # of one image


def check_target(folder: Path) -> None:
    """Raise LiveHandError if the folder of a new capture exists and is not empty."""
    if folder.exists() and not (folder.is_dir() and not any(folder.iterdir())):
        raise LiveHandError(f"a new capture needs an empty folder, {folder} is not empty; choose another")


def write_capture(capture: Capture, files: Mapping[str, Path], texts: Mapping[str, str] | None = None) -> None:
    """Copy the files (name in the capture -> source) and texts (name -> text), and write the index.

    Raises:
        LiveHandError: the folder is not empty, holds another unfinished import, or a file cannot be copied.
    """
    check_target(capture.folder)
    partial = capture.folder.with_name(capture.folder.name + ".partial")
    try:
        _begin_or_resume(partial, capture)
        for name, source in tqdm(files.items(), unit="file", desc="copy"):
            _copy(source, partial / name)
        for name, text in (texts or {}).items():
            (partial / name).write_text(text)
        if capture.folder.exists():
            capture.folder.rmdir()  # empty
        partial.rename(capture.folder)
    except OSError as error:
        raise LiveHandError(f"{capture.folder} must be writable and its sources readable ({error})") from error


def _begin_or_resume(partial: Path, capture: Capture) -> None:
    """Write the index, or check that the unfinished import is of the same capture."""
    (partial / "images").mkdir(parents=True, exist_ok=True)
    if not (partial / "transforms.json").exists():
        save_capture_index(replace(capture, folder=partial))
        return
    previous = load_capture(partial)
    is_same = index_document(previous) == index_document(capture) and all(
        (getattr(one, name) == getattr(other, name)).all()
        for one, other in zip(previous.poses, capture.poses, strict=True)
        for name in ("theta", "beta", "transl")
    )
    if not is_same:
        raise LiveHandError(f"{partial} must be of the same import, got another unfinished one; delete it")


def _copy(source: Path, target: Path) -> None:
    if target.exists():
        return
    check_regular(source, _MOST_BYTES)
    with replacing(target) as unfinished:
        shutil.copyfile(source, unfinished)

"""Where training's figures are kept: a log of JSON lines beside the avatar, and TensorBoard."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Protocol, runtime_checkable

import numpy as np

from ..records.errors import LiveHandError


@runtime_checkable
class Journal(Protocol):
    """Takes down figures by step."""

    def figures(self, step: int, values: Mapping[str, float]) -> None:
        """Scalars by name, `group/name`."""

    def picture(self, step: int, sheet: np.ndarray) -> None:
        """The preview [H, W, 3] uint8."""

    def close(self) -> None:
        """Nothing more will come."""


class LogFile:
    """One JSON object a line: `step`, and figures by name. A resumed training goes on in the same file.

    Args:
        path: of the file.
        first_step: lines of later steps are dropped: they will be taken again.
    """

    def __init__(self, path: Path, first_step: int):
        kept = [line for line in _lines(path) if _step_of(line) <= first_step] if first_step else []
        partial = path.with_name(f".{path.name}.partial")
        partial.write_text("".join(f"{line}\n" for line in kept))
        partial.replace(path)
        self._file = path.open("a")

    def figures(self, step: int, values: Mapping[str, float]) -> None:
        """A line, at once."""
        self._file.write(json.dumps({"step": step, **{name: _short(value) for name, value in values.items()}}) + "\n")
        self._file.flush()

    def picture(self, step: int, sheet: np.ndarray) -> None:
        """Nothing: pictures lie in a file of their own."""

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class TensorBoard:
    """Event files for TensorBoard.

    Args:
        folder: of the event files.
        first_step: events of later steps, of a session that was cut off, are hidden.

    Raises:
        LiveHandError: the package `tensorboard` is missing, or the folder cannot be written.
    """

    def __init__(self, folder: Path, first_step: int):
        check_tensorboard()
        from torch.utils.tensorboard import SummaryWriter

        try:
            self._writer = SummaryWriter(str(folder), purge_step=first_step + 1 if first_step else None)
        except OSError as error:
            raise LiveHandError(f"the folder for TensorBoard must be writable, got {error}") from error

    def figures(self, step: int, values: Mapping[str, float]) -> None:
        """A scalar each."""
        for name, value in values.items():
            self._writer.add_scalar(name, value, step)

    def picture(self, step: int, sheet: np.ndarray) -> None:
        """The preview."""
        self._writer.add_image("held_out/preview", sheet, step, dataformats="HWC")

    def close(self) -> None:
        """Write out what is still in memory."""
        self._writer.close()


def check_tensorboard() -> None:
    """See that TensorBoard's files can be written.

    Raises:
        LiveHandError: the package is missing.
    """
    try:
        import torch.utils.tensorboard  # noqa: F401
    except ImportError as error:
        raise LiveHandError(
            "TensorBoard logs need the package tensorboard, got none; install it with: "
            'pip install "livehand[tensorboard]"'
        ) from error


def _lines(path: Path) -> list[str]:
    return path.read_text(errors="replace").splitlines() if path.is_file() else []


def _step_of(line: str) -> float:
    """The step of a line; of one that a kill cut short, a step that never comes."""
    try:
        return float(json.loads(line)["step"])
    except (ValueError, KeyError, TypeError):
        return float("inf")


def _short(value: float) -> float:
    """Six digits are more than any figure here has."""
    return float(f"{value:.6g}")

"""Where the metrics of training are written: a log of JSON lines beside the avatar, and TensorBoard event files."""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from ..records.errors import LiveHandError
from ..system.files import replacing


class MetricWriter(ABC):
    """Writes metrics by step."""

    @abstractmethod
    def write_scalars(self, step: int, values: Mapping[str, float]) -> None:
        """Write scalars, named `group/name`."""

    @abstractmethod
    def close(self) -> None:
        """Finish the files."""

    def write_preview(self, step: int, sheet: np.ndarray) -> None:  # noqa: B027
        """Write a preview [H, W, 3] uint8, if the files hold images."""


class JsonLinesLog(MetricWriter):
    """A log with one JSON object per line: `step`, and scalars by name. A resumed training continues the same file.

    Args:
        path: of the file.
        first_step: lines of later steps are removed, because these steps will be repeated.
    """

    def __init__(self, path: Path, first_step: int):
        lines = path.read_text(errors="replace").splitlines() if path.is_file() and first_step else []
        with replacing(path) as temporary:
            temporary.write_text("".join(f"{line}\n" for line in lines if _step_of(line) <= first_step))
        self._file = path.open("a")

    def write_scalars(self, step: int, values: Mapping[str, float]) -> None:
        """Write a line and flush it; six digits are enough for all scalars."""
        rounded = {name: float(f"{value:.6g}") for name, value in values.items()}
        self._file.write(json.dumps({"step": step, **rounded}) + "\n")
        self._file.flush()

    def close(self) -> None:
        """Close the file."""
        self._file.close()


class TensorBoardLog(MetricWriter):
    """Event files for TensorBoard.

    Args:
        folder: of the event files.
        first_step: events of later steps, from an interrupted session, are hidden.

    Raises:
        LiveHandError: the package `tensorboard` is missing, or the folder cannot be written to.
    """

    def __init__(self, folder: Path, first_step: int):
        try:
            from torch.utils.tensorboard import SummaryWriter

            self._writer = SummaryWriter(str(folder), purge_step=first_step + 1 if first_step else None)
        except ImportError as error:
            raise LiveHandError(
                "TensorBoard logs need the package tensorboard, got none; install it with: "
                'pip install "livehand[tensorboard]"'
            ) from error
        except OSError as error:
            raise LiveHandError(f"the folder for TensorBoard must be writable, got {error}") from error

    def write_scalars(self, step: int, values: Mapping[str, float]) -> None:
        """Write each scalar."""
        for name, value in values.items():
            self._writer.add_scalar(name, value, step)

    def write_preview(self, step: int, sheet: np.ndarray) -> None:
        """Write the image."""
        self._writer.add_image("held_out/preview", sheet, step, dataformats="HWC")

    def close(self) -> None:
        """Flush and close the files."""
        self._writer.close()


def _step_of(line: str) -> float:
    """Read the step of a line; infinity if the line is incomplete."""
    try:
        return float(json.loads(line)["step"])
    except (ValueError, KeyError, TypeError):
        return float("inf")

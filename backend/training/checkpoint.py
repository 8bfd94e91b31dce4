"""Training state on disk: weights, their average, optimiser and progress, in one `.safetensors` beside the avatar.

All randomness of training is a function of (seed, step), so that there is no random state to keep.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from ..records.errors import LiveHandError


@dataclass(frozen=True)
class Progress:
    """How far a training has come.

    Attributes:
        step: steps taken.
        seconds: wall-clock time they took, over all sessions.
        skipped: steps among them that left the weights as they were.
    """

    step: int = 0
    seconds: float = 0.0
    skipped: int = 0


@dataclass(frozen=True)
class TrainState:
    """What a checkpoint holds beside the progress."""

    parts: nn.Module
    average: nn.Module
    optimiser: torch.optim.Optimizer

    def tensors(self) -> dict[str, Tensor]:
        """All of them, by name, on the CPU."""
        named = {f"part.{key}": value for key, value in self.parts.state_dict().items()}
        named |= {f"average.{key}": value for key, value in self.average.state_dict().items()}
        for index, state in self.optimiser.state_dict()["state"].items():
            named |= {f"optimiser.{index}.{key}": torch.as_tensor(value) for key, value in state.items()}
        return {key: value.detach().cpu().contiguous() for key, value in named.items()}

    def restore(self, tensors: dict[str, Tensor]) -> None:
        """Set everything to what `tensors` once gave."""
        self.parts.load_state_dict(_under(tensors, "part."))
        self.average.load_state_dict(_under(tensors, "average."))
        states: dict[int, dict[str, Tensor]] = {}
        for key, value in _under(tensors, "optimiser.").items():
            index, name = key.split(".")
            states.setdefault(int(index), {})[name] = value
        self.optimiser.load_state_dict({**self.optimiser.state_dict(), "state": states})


def checkpoint_path(avatar_path: Path) -> Path:
    """Where the training state of an avatar lies."""
    return avatar_path.with_suffix(".checkpoint")


def save_checkpoint(path: Path, state: TrainState, progress: Progress, run: str) -> None:
    """Write the state of the run that `run` describes.

    The one before it stays until this one is whole and on the disk, so that a kill or a power cut at any moment leaves
    one of the two.

    Raises:
        LiveHandError: it cannot be written; the one before it is still there.
    """
    partial = path.with_suffix(".checkpoint_partial")
    try:
        save_file(state.tensors(), partial, metadata={"progress": json.dumps(asdict(progress)), "run": run})
        with partial.open("rb+") as file:
            os.fsync(file.fileno())
        partial.replace(path)
    except (SafetensorError, OSError) as error:
        raise LiveHandError(
            f"checkpoint {path} must be writable, got {error}; make room, and go on from the one before with --resume"
        ) from error


def load_checkpoint(path: Path, state: TrainState, run: str) -> Progress:
    """Restore the state; returns how far training had come.

    Raises:
        LiveHandError: unreadable, or of another run (capture, configuration or steps differ).
    """
    try:
        with safe_open(path, framework="pt") as archive:
            metadata = archive.metadata() or {}
            tensors = {key: archive.get_tensor(key) for key in archive.keys()}
    except (SafetensorError, OSError) as error:
        raise LiveHandError(f"checkpoint {path} must be readable, got {error}; delete it to start anew") from error
    if metadata.get("run") != run:
        raise LiveHandError(
            f"checkpoint {path} must be of the same capture and settings, got another run's; repeat its settings, "
            "choose another output, or delete it"
        )
    state.restore(tensors)
    return Progress(**json.loads(metadata["progress"]))


def _under(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}

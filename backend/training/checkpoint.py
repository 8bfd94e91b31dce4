"""Training state on disk: weights, their average, optimiser and progress, in one `.safetensors` beside the avatar.

All randomness of training is a function of (seed, step), so there is no random state to save.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from math import inf
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from ..records.errors import LiveHandError
from ..system.files import check_regular, replacing
from ..system.readers import parse_json

_CHECKSUM = "sha256"


@dataclass(frozen=True)
class Progress:
    """How far training has come.

    Attributes:
        step: number of steps done.
        seconds: wall-clock time they took, over all sessions.
        skipped: number of steps among them that did not change the weights.
    """

    step: int = 0
    seconds: float = 0.0
    skipped: int = 0


@dataclass(frozen=True)
class TrainState:
    """What a checkpoint holds besides the progress."""

    parts: nn.Module
    average: nn.Module
    optimiser: torch.optim.Optimizer

    def tensors(self) -> dict[str, Tensor]:
        """Return all tensors of the state, by name, on the CPU."""
        named = {f"part.{key}": value for key, value in self.parts.state_dict().items()}
        named |= {f"average.{key}": value for key, value in self.average.state_dict().items()}
        for index, state in self.optimiser.state_dict()["state"].items():
            named |= {f"optimiser.{index}.{key}": torch.as_tensor(value) for key, value in state.items()}
        return {key: value.detach().cpu().contiguous() for key, value in named.items()}

    def restore(self, tensors: dict[str, Tensor]) -> None:
        """Restore the state from the result of `tensors`."""
        self.parts.load_state_dict(_under(tensors, "part."))
        self.average.load_state_dict(_under(tensors, "average."))
        states: dict[int, dict[str, Tensor]] = {}
        for key, value in _under(tensors, "optimiser.").items():
            index, name = key.split(".")
            states.setdefault(int(index), {})[name] = value
        self.optimiser.load_state_dict({**self.optimiser.state_dict(), "state": states})


def checkpoint_path(avatar_path: Path) -> Path:
    """Return the path of the checkpoint of an avatar."""
    return avatar_path.with_suffix(".checkpoint")


def save_checkpoint(path: Path, state: TrainState, progress: Progress, run: str) -> None:
    """Write the state of the run with the identity `run`.

    The previous checkpoint is replaced only when this one is complete and on the disk, so that one of the two survives
    if the process is killed or the power fails.

    Raises:
        LiveHandError: the checkpoint cannot be written; the previous one is still there.
    """
    tensors = state.tensors()
    metadata = {"progress": json.dumps(asdict(progress)), "run": run}
    with replacing(path, is_durable=True) as temporary:
        temporary.write_bytes(save(tensors, metadata={**metadata, _CHECKSUM: _checksum(metadata, tensors)}))


def load_checkpoint(path: Path, state: TrainState, run: str) -> Progress:
    """Restore the state and return its progress.

    Raises:
        LiveHandError: the checkpoint is unreadable, altered, or another run's (capture, configuration or steps differ).
    """
    try:
        check_regular(path)
        with safe_open(path, framework="pt") as archive:
            metadata = dict(archive.metadata() or {})
            tensors = {key: archive.get_tensor(key) for key in archive.keys()}
    except (SafetensorError, LiveHandError, OSError) as error:
        raise LiveHandError(f"checkpoint {path} must be readable, got {error}; delete it to start again") from error
    if metadata.pop(_CHECKSUM, None) != _checksum(metadata, tensors):
        raise LiveHandError(
            f"checkpoint {path} must match its own checksum, got an altered or damaged one; delete it to start again"
        )
    if metadata.get("run") != run:
        raise LiveHandError(
            f"checkpoint {path} must be of the same capture and settings, got another run's; repeat its settings, "
            "choose another output, or delete it"
        )
    try:
        progress = Progress(**parse_json(metadata["progress"].encode(), "progress"))
        if not all(type(value) in (int, float) and 0 <= value < inf for value in asdict(progress).values()):
            raise ValueError(progress)
        state.restore(tensors)
    except (LiveHandError, RuntimeError, KeyError, TypeError, ValueError) as error:
        raise LiveHandError(f"checkpoint {path} must be whole, got {error}; delete it to start again") from error
    return progress


def _checksum(metadata: Mapping[str, str], tensors: Mapping[str, Tensor]) -> str:
    digest = hashlib.sha256(json.dumps(metadata, sort_keys=True).encode())
    for key, value in sorted(tensors.items()):
        digest.update(f"{key} {value.dtype} {list(value.shape)}".encode())
        digest.update(value.reshape(-1).view(torch.uint8).numpy().data)
    return digest.hexdigest()


def _under(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}

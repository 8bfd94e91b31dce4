"""Training state on disk: networks, optimiser and step, in one `.safetensors` beside the avatar.

All randomness of training is a function of (seed, step), so that there is no random state to keep.
"""

from __future__ import annotations

from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor, nn

from ..errors import LiveHandError


def checkpoint_path(avatar_path: Path) -> Path:
    """Where the training state of an avatar lies."""
    return avatar_path.with_suffix(".checkpoint")


def save_checkpoint(path: Path, networks: nn.Module, optimiser: torch.optim.Optimizer, step: int, run: str) -> None:
    """Write the state after `step` steps of the run that `run` describes; a kill at any moment leaves a whole file."""
    tensors = {f"network.{key}": value.detach().cpu().contiguous() for key, value in networks.state_dict().items()}
    for index, state in optimiser.state_dict()["state"].items():
        for key, value in state.items():
            tensors[f"optimiser.{index}.{key}"] = torch.as_tensor(value).detach().cpu().contiguous()
    partial = path.with_suffix(".checkpoint_partial")
    save_file(tensors, partial, metadata={"step": str(step), "run": run})
    partial.replace(path)


def load_checkpoint(path: Path, networks: nn.Module, optimiser: torch.optim.Optimizer, run: str) -> int:
    """Restore the state; returns the step it was saved after.

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
    networks.load_state_dict(_under(tensors, "network."))
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in _under(tensors, "optimiser.").items():
        index, name = key.split(".")
        state.setdefault(int(index), {})[name] = value
    optimiser.load_state_dict({**optimiser.state_dict(), "state": state})
    return int(metadata["step"])


def _under(tensors: dict[str, Tensor], prefix: str) -> dict[str, Tensor]:
    return {key.removeprefix(prefix): value for key, value in tensors.items() if key.startswith(prefix)}

"""The file of a fitted method: tensors in `.safetensors`, with its name, so that it is never taken for an avatar."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from safetensors import SafetensorError, safe_open
from safetensors.torch import save
from torch import Tensor, nn

from ...records.errors import LiveHandError
from ...system.files import check_regular, replacing
from ...system.readers import parse_json

FILE = "method.safetensors"
"""Its name in the row's folder."""
_KEY = "livehand_method"


def save_method(folder: Path, kind: str, tensors: Mapping[str, Tensor], facts: Mapping[str, Any] | None = None) -> None:
    """Write the tensors of a method of this kind.

    Raises:
        LiveHandError: the file cannot be written.
    """
    plain = {name: value.detach().cpu().contiguous() for name, value in tensors.items()}
    with replacing(folder / FILE, is_durable=True) as partial:
        partial.write_bytes(save(plain, metadata={_KEY: json.dumps({"kind": kind, **(facts or {})})}))


def load_method(folder: Path, kind: str) -> tuple[dict[str, Tensor], dict[str, Any]]:
    """Read tensors and facts.

    Raises:
        LiveHandError: the file is missing, damaged, or of another method.
    """
    path = folder / FILE
    try:
        check_regular(path)
        with safe_open(path, framework="pt") as archive:
            facts = parse_json((archive.metadata() or {})[_KEY].encode(), _KEY)
            tensors = {key: archive.get_tensor(key) for key in archive.keys()}
    except (SafetensorError, LiveHandError, OSError, KeyError, ValueError) as error:
        raise LiveHandError(f"{path} must hold a fitted {kind}, got {error}; fit it again with --redo") from error
    if not isinstance(facts, dict) or facts.get("kind") != kind:
        raise LiveHandError(f"{path} must hold a fitted {kind}, got {str(facts)[:40]}; fit it again with --redo")
    return tensors, facts


def load_network(folder: Path, kind: str, network: nn.Module) -> nn.Module:
    """Load the network with the weights of the folder, ready to render.

    Raises:
        LiveHandError: as `load_method`, or the weights are of another size.
    """
    tensors, _ = load_method(folder, kind)
    try:
        network.load_state_dict(tensors)
    except RuntimeError as error:
        raise LiveHandError(f"{folder / FILE} must fit this version's {kind} ({error}); use --redo") from error
    return network.eval()


def parameter_count(network: nn.Module) -> int:
    """Count the learnt numbers."""
    return sum(parameter.numel() for parameter in network.parameters())

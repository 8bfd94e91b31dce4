"""The options of commands that measure LPIPS: by which network, and from where its weights."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from .perceptual.lpips_package import FETCH_COMMAND, LPIPS_NETWORKS, has_lpips

if TYPE_CHECKING:
    import torch

    from .distances import Distance

_NONE = "none"
_DEFAULT = "alexnet"
"""The network by which LPIPS is mostly reported, the paper's too."""
_NOT_MEASURED = f"LPIPS was not measured: it needs weights that are not shipped; fetch them once: {FETCH_COMMAND}"


def add_lpips_arguments(parser: argparse.ArgumentParser) -> None:
    """Add `--lpips` and `--lpips-weights`."""
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--lpips",
        nargs="+",
        choices=(*LPIPS_NETWORKS, _NONE),
        metavar="NETWORK",
        help=f"measure LPIPS 0.1 by {' or '.join(LPIPS_NETWORKS)}, or {_NONE} (default: {_DEFAULT}, once it was "
        "brought by livehand fetch-perceptual)",
    )
    group.add_argument(
        "--lpips-weights",
        type=Path,
        nargs=2,
        metavar=("NETWORK", "HEADS"),
        help="measure LPIPS with torchvision's VGG16, AlexNet or SqueezeNet 1.1 and the published linear heads for it",
    )


def lpips_of(args: argparse.Namespace, device: torch.device) -> list[Distance]:
    """Load what the options ask for; nothing if they do not ask and the default has not been fetched.

    Raises:
        LiveHandError: weights that they ask for are missing, or of another network.
    """
    from .distances import fetched_lpips_distances, lpips_distances

    if args.lpips_weights:
        network, heads = args.lpips_weights
        return lpips_distances(network, heads, device)
    return [distance for name in _networks(args) for distance in fetched_lpips_distances(name, device)]


def lpips_names(args: argparse.Namespace) -> list[str]:
    """Name the weights for the record of a result: files, or networks that were fetched."""
    if args.lpips_weights:
        return [path.name for path in args.lpips_weights]
    return [f"LPIPS 0.1 {name}" for name in _networks(args)]


def lpips_note(args: argparse.Namespace) -> str | None:
    """Word that LPIPS was not measured, unless it was or nobody wants it."""
    is_measured = bool(args.lpips_weights) or bool(_networks(args))
    return None if is_measured or args.lpips else _NOT_MEASURED


def _networks(args: argparse.Namespace) -> list[str]:
    if args.lpips:
        return list(dict.fromkeys(name for name in args.lpips if name != _NONE))
    return [_DEFAULT] if has_lpips(_DEFAULT) else []

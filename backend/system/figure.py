"""Figures drawn by matplotlib, which is optional, and their files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ..records.errors import LiveHandError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def new_figure(width_in: float, height_in: float) -> Figure:
    """Create an empty figure.

    Raises:
        LiveHandError: matplotlib is not installed.
    """
    try:
        from matplotlib.figure import Figure
    except ImportError as error:
        raise LiveHandError(f"--plot needs matplotlib ({error}); install it with: pip install matplotlib") from error
    return Figure((width_in, height_in), layout="constrained")


def save_figure(figure: Figure, path: Path) -> None:
    """Write the figure; its folder is created.

    Raises:
        LiveHandError: the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path)  # pyright: ignore[reportUnknownMemberType]
    except (OSError, ValueError) as error:
        raise LiveHandError(f"the plot {path} could not be written ({error}); choose another .png") from error


def check_plot_name(path: Path) -> None:
    """Raise LiveHandError unless the file's name ends in .png."""
    if path.suffix.lower() != ".png":
        raise LiveHandError(f"--plot must name a .png file, got {path.name}")

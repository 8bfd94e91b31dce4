"""The plot of how a frame's cost grows with coverage, image size and number of hands, drawn with matplotlib."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ...system.figure import new_figure
from .growth import GrowthPoint
from .measure import SizeResult
from .rounds import frame_spread

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_SIZE_IN = (13.2, 3.6)


def growth_figure() -> Figure:
    """Make an empty figure. Raises LiveHandError if matplotlib is not installed."""
    return new_figure(*_SIZE_IN)


def draw_growth(
    figure: Figure,
    coverage: Sequence[GrowthPoint],
    sizes: Sequence[SizeResult],
    hands: Sequence[GrowthPoint],
    size: str,
) -> None:
    """Draw three panels; `size` names the image size at which coverage and hands were measured."""
    by_size = sorted((_size_point(result) for result in sizes), key=lambda point: point.x)
    panels = (
        (f"ms a frame, {size}", "the hand's share of the image", coverage),
        ("ms a frame", "megapixels", by_size),
        (f"ms a frame, {size}", "hands", hands),
    )
    for axes, (title, x_label, points) in zip(figure.subplots(1, len(panels)), panels, strict=True):
        axes.set(title=title, xlabel=x_label)
        _draw_curves(axes, points)


def _draw_curves(axes: Axes, points: Sequence[GrowthPoint]) -> None:
    """Draw the medians of each configuration, with bars from the 10th to the 90th percentile; axes start at zero."""
    for name in points[0].frame_ms:
        spreads = [point.frame_ms[name] for point in points]
        bars_ms = [[s.median - s.p10 for s in spreads], [s.p90 - s.median for s in spreads]]
        axes.errorbar([point.x for point in points], [s.median for s in spreads], bars_ms, marker="o", label=name)
    axes.set(xlim=(0, None), ylim=(0, None))
    axes.grid(alpha=0.4)
    axes.legend(loc="upper left")


def _size_point(result: SizeResult) -> GrowthPoint:
    """Plot the avatar's own configurations at one size; x is megapixels."""
    spreads = {name: frame_spread(frames)[0] for name, frames in result.taken.items() if name.startswith("default")}
    return GrowthPoint(result.size_px[0] * result.size_px[1] / 1e6, spreads)

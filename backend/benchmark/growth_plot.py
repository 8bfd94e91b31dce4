"""The curves of cost over coverage, size and hands, as panels of one plot."""

from __future__ import annotations

from collections.abc import Sequence

from .growth import GrowthPoint
from .measure import SizeResult
from .plot import Curve, Panel
from .rounds import frame_spread


def growth_panels(
    coverage: Sequence[GrowthPoint], sizes: Sequence[SizeResult], hands: Sequence[GrowthPoint], size: str
) -> list[Panel]:
    """Three panels; `size` names the size at which coverage and hands were measured."""
    by_size = sorted((_size_point(result) for result in sizes), key=lambda point: point.x)
    return [
        Panel(f"ms a frame, {size}", "the hand's share of the image", _curves(coverage)),
        Panel("ms a frame", "megapixels", _curves(by_size)),
        Panel(f"ms a frame, {size}", "hands", _curves(hands)),
    ]


def _size_point(result: SizeResult) -> GrowthPoint:
    """The avatar's own configurations at one size; x is megapixels."""
    spreads = {name: frame_spread(taken)[0] for name, taken in result.taken.items() if name.startswith("default")}
    return GrowthPoint(result.size_px[0] * result.size_px[1] / 1e6, spreads)


def _curves(points: Sequence[GrowthPoint]) -> list[Curve]:
    def curve(name: str) -> Curve:
        spreads = [(point.x, point.frame_ms[name]) for point in points]
        return Curve(name, [(x, s.median) for x, s in spreads], [(s.p10, s.p90) for _, s in spreads])

    return [curve(name) for name in points[0].frame_ms]

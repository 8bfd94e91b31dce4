"""What speaks against a result of retargeting, in words for a warning: a poor fit, joints without bones, odd poses."""

from __future__ import annotations

import numpy as np

from ..hand.model import JOINT_NAMES
from ..motion import gate
from ..motion.motion import HandMotion
from .rest_alignment import RestAlignment
from .shape_fit import MOST_BETA

_MOST_ERROR_MM = 12.0
SMALLEST_SIZE, LARGEST_SIZE = 0.7, 1.4  # of the built-in hand's
_AT_BOUND = 0.99


def fit_doubts(alignment: RestAlignment) -> list[str]:
    """List signs that the bones are not a hand's joints, or those of a hand very unlike ours."""
    found = []
    errors_mm = 1e3 * np.linalg.norm(alignment.joints - alignment.heads, axis=1) / alignment.shape.scale
    known = np.isfinite(errors_mm)
    if errors_mm[known].mean() > _MOST_ERROR_MM:
        worst = JOINT_NAMES[int(np.where(known, errors_mm, 0).argmax())]
        found.append(
            f"its joints are {errors_mm[known].mean():.0f} mm from the hand's on average, {worst} is "
            f"{errors_mm[known].max():.0f} mm"
        )
    if (np.abs(alignment.shape.beta) >= _AT_BOUND * MOST_BETA).any():
        found.append("its proportions are beyond the range of the hand's shapes")
    return found


def rest_doubts(alignment: RestAlignment, factor: float = 1.0) -> str | None:
    """Join all that speaks against the bones of an alignment, whose lengths are scaled by a factor; None: nothing."""
    found, size = fit_doubts(alignment), alignment.shape.scale * factor
    if not SMALLEST_SIZE <= size <= LARGEST_SIZE:
        found.append(f"it is {size:.3g} times as large as a hand{_unit_guess(size)}")
    return "; ".join([*found, *_missing(alignment)]) or None


def _unit_guess(size: float) -> str:
    """Word the scale by a power of ten, or of inches, that makes a size a hand's; empty: none does."""
    scales = [*(10.0**power for power in range(-6, 7)), 0.0254, 1 / 0.0254]
    best = min(scales, key=lambda scale: abs(np.log(size * scale))) if size > 0 else 1.0
    is_usual = best != 1.0 and SMALLEST_SIZE <= size * best <= LARGEST_SIZE
    return f", as if in another unit: scaled by {best:.4g} it would be one" if is_usual else ""


def motion_doubts(alignment: RestAlignment, motion: HandMotion) -> str | None:
    """Join all that speaks against a motion and its alignment; None: nothing."""
    found = [*gate.motion_doubts(alignment.model, motion), *fit_doubts(alignment), *_missing(alignment)]
    return "; ".join(found) or None


def sampled_doubts(alignment: RestAlignment, motion: HandMotion) -> str | None:
    """Join all that speaks against frames here and there of a motion, and its alignment; None: nothing."""
    found = [
        *gate.pose_doubts(alignment.model, motion, counted=None),
        *fit_doubts(alignment),
        *_missing(alignment),
    ]
    return "; ".join(found) or None


def _missing(alignment: RestAlignment) -> list[str]:
    names = [name for name, head in zip(JOINT_NAMES, alignment.heads, strict=True) if np.isnan(head[0])]
    return [f"no bones for {', '.join(names)}, which stay at rest"] if names else []

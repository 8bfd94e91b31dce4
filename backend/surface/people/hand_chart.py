"""Where on the built-in hand each texel of its atlas lies: on which digit, how far along it, on which side.

The chart ships beside the hand, by vertices of the detail surface (`tools/builtin_hand/hand_chart.py` makes it).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...hand.model_file import DEFAULT_HAND, builtin_hand_path
from ..atlas_texels import AtlasTexels
from ..detail_mesh import DetailTemplate

CHART_FILE = f"chart_of_{DEFAULT_HAND}.npz"
"""Beside the hand model's own."""
COORDINATE_STEP_MM, SHARE_STEP, WHOLE_SHARE = 0.01, 0.001, 255
"""What one step of the stored whole numbers is worth; and the steps of a share of 1."""
REACH_MM = 9.0
"""From a digit's surface, up to which a vertex has coordinates on it."""
THUMB = 4
"""The place of the thumb among the digits: index, middle, pinky, ring, thumb."""
_ON_DIGIT_MM = (3.0, 1.2)
_NO_DIGIT_MM = -299.0  # along one, of vertices beyond its reach
_BOTH = 0.4  # of a digit's section: how softly one ends where another begins
_ROOT_MM, _THUMB_ROOT_MM = (8.0, 16.0), (-12.0, -2.0)  # along a digit, over which it leaves the palm


@dataclass(frozen=True)
class HandChart:
    """Points of the skin at rest, and their coordinates on the digit that each is nearest to.

    Attributes:
        points_mm: [T, 3] template frame, mm: fingers towards -X, the back +Y, the thumb +Z.
        normals: [T, 3] unit.
        digit: [T] in the order of `THUMB`'s docstring.
        on_digit: [T] 1 on the digit's own skin, 0 on the palm, the back and the arm.
        along, lateral: [T] mm along the digit from the head of its metacarpal, and to the side.
        side, height: [T] lateral and dorsal offset, 1 on the section's side and back, -1 on its palm side.
        nail_along, nail_across: [T] -1 and 1 at the nail's root and free end, and at its sides.
        palm, arm: [T] 1 on the palm side; on the arm.
        joints_along: [5, 3] mm, of each digit.
        length: [5] mm to each digit's tip.
    """

    points_mm: np.ndarray
    normals: np.ndarray
    digit: np.ndarray
    on_digit: np.ndarray
    along: np.ndarray
    lateral: np.ndarray
    side: np.ndarray
    height: np.ndarray
    nail_along: np.ndarray
    nail_across: np.ndarray
    palm: np.ndarray
    arm: np.ndarray
    joints_along: np.ndarray
    length: np.ndarray

    @classmethod
    def at_texels(cls, template: DetailTemplate, texels: AtlasTexels) -> HandChart:
        """Interpolate the chart at the texels of an atlas, within each face by the coordinates of one digit."""
        return cls._of(template, texels.corners, texels.weights, chart_arrays())

    @classmethod
    def at_vertices(cls, template: DetailTemplate) -> HandChart:
        """Read the chart at the vertices of the detail surface."""
        count = len(template.offset_m)
        corners = np.repeat(np.arange(count)[:, None], 3, 1)
        return cls._of(template, corners, np.tile(np.array([1, 0, 0], np.float32), (count, 1)), chart_arrays())

    @classmethod
    def _of(
        cls, template: DetailTemplate, corners: np.ndarray, weights: np.ndarray, chart: Mapping[str, np.ndarray]
    ) -> HandChart:
        def blended(values: np.ndarray) -> np.ndarray:
            shape = (-1, *(1 for _ in values.shape[2:]))
            return sum(weights[:, k].reshape(shape) * values[:, k] for k in range(3))  # pyright: ignore

        digit = np.median(chart["digit"][corners], 1).astype(int)
        of_digit = digit[:, None]
        along, lateral = np.moveaxis(
            blended(chart["along_lateral"][corners, of_digit].astype(np.float32)) * np.float32(COORDINATE_STEP_MM), 1, 0
        )
        shares = blended(chart["shares"][corners, of_digit].astype(np.float32)) * np.float32(SHARE_STEP)
        palm, arm = (blended(chart[name][corners].astype(np.float32)) / WHOLE_SHARE for name in ("palm", "arm"))
        normals = blended(template.normals.numpy()[corners])
        return cls(
            points_mm=blended(1e3 * template.rest_vertices().numpy()[corners]),
            normals=normals / np.linalg.norm(normals, axis=1, keepdims=True).clip(1e-6),
            digit=digit,
            on_digit=blended(_on_digits(chart)[corners]),
            along=along,
            lateral=lateral,
            side=shares[:, 0],
            height=shares[:, 1],
            nail_along=shares[:, 2],
            nail_across=shares[:, 3],
            palm=palm,
            arm=arm,
            joints_along=chart["joints_along"],
            length=chart["length"],
        )

    @cached_property
    def from_joint_mm(self) -> np.ndarray:
        """[T, 3] mm along the digit from each of its joints."""
        return self.along[:, None] - self.joints_along[self.digit]

    @cached_property
    def is_thumb(self) -> np.ndarray:
        """[T] whether the nearest digit is the thumb, whose first joint lies at the base of its metacarpal."""
        return self.digit == THUMB


def chart_arrays() -> dict[str, np.ndarray]:
    """Read the file's arrays, in whole steps."""
    with np.load(builtin_hand_path().with_name(CHART_FILE), allow_pickle=False) as archive:
        return {name: archive[name] for name in archive.files}


def _on_digits(chart: Mapping[str, np.ndarray]) -> np.ndarray:
    """Compute how much each vertex [N] is a digit's; between two it is of both, and nothing steps where they meet."""
    along_mm = chart["along_lateral"][..., 0] * np.float32(COORDINATE_STEP_MM)
    ends = (_THUMB_ROOT_MM if digit == THUMB else _ROOT_MM for digit in range(along_mm.shape[1]))
    root = np.stack([smoothstep(along, *end) for along, end in zip(along_mm.T, ends, strict=True)], 1)
    across = np.hypot(*np.moveaxis(chart["shares"][..., :2] * np.float32(SHARE_STEP), -1, 0))
    across = np.where(along_mm > _NO_DIGIT_MM, across, np.inf)
    nearest = np.where(np.isfinite(across.min(1)), across.min(1), 0)[:, None]
    share = np.exp((nearest - across) / _BOTH)
    distance_mm = chart["distance"] * np.float32(COORDINATE_STEP_MM)
    return (share * root).sum(1) / share.sum(1).clip(1e-6) * smoothstep(distance_mm, *_ON_DIGIT_MM)


def smoothstep(values: np.ndarray, start: float, end: float) -> np.ndarray:
    """Rise smoothly from 0 at `start` to 1 at `end`, which may be less."""
    share = np.clip((values - np.float32(start)) / np.float32(end - start), 0, 1)
    return share * share * (3 - 2 * share)


def bump(values: np.ndarray, width: float | np.ndarray) -> np.ndarray:
    """Compute a Gaussian of 1 at 0, of this deviation."""
    return np.exp(-0.5 * (values / width) ** 2)

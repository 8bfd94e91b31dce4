"""The surface of the built-in hand as its captures show it, at two levels of subdivision, with what a pose raises.

Heights lie along the normals of a surface finer than the template, which has none of them: that of captures
(`teacher/detailed_surface.py`), or that of pictures (`detail_surface_of`).

The template's faces are chords of a round surface, up to a millimetre below it, and know neither knuckles nor tendons.
The generator knows where the surface is (`tools/builtin_hand/fine_offsets.py` writes the base's file). Vertices follow
the posed template: Loop's subdivision of its vertices, moved by these offsets in their local frames. So sculpted and
retargeted hands have a detail surface, too.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ..hand.gestures import Degrees
from .base_surface import SURFACE_FILE, base_arrays, has_base

_CLENCHED_DEG = 80  # mean bend of the knuckles at which veins stand out most
_KNUCKLES = [1, 4, 7, 10]
_FLAT_VEINS, _CLENCHED_VEINS = 0.75, 0.5  # of their height: in a flat hand, and what a clenched one adds


@dataclass(frozen=True)
class PoseForm:
    """A form of one joint.

    Attributes:
        joint: in 0..15; 0 is the wrist, bent by the forearm.
        start_deg: flexion from the rest pose at which it begins to show; negative where extension raises it.
        full_deg: flexion at which it has its full height.
        height_mm: [N] along the vertex normals.
    """

    joint: int
    start_deg: Degrees
    full_deg: Degrees
    height_mm: np.ndarray

    @property
    def is_of_extension(self) -> bool:
        """Whether it shows where a joint is lifted, as extensor tendons do."""
        return self.full_deg < self.start_deg

    def share(self, flexion_deg: Degrees) -> float:
        """Compute the share of the full height, in [0, 1]."""
        return float(_risen(*map(np.atleast_1d, (flexion_deg, self.start_deg, self.full_deg)))[0])

    def scaled(self, factor: float) -> PoseForm:
        """Return the form so many times as high."""
        return replace(self, height_mm=self.height_mm * np.float32(factor))


def _risen(flexion_deg: np.ndarray, start_deg: np.ndarray, full_deg: np.ndarray) -> np.ndarray:
    """Compute the shares of full heights of forms that joints raise between these bends."""
    bent = np.clip((flexion_deg - start_deg) / (full_deg - start_deg), 0.0, 1.0)
    return bent * bent * (3 - 2 * bent)


class RaisedParts(NamedTuple):
    """What rises on each of N vertices, as `PoseDisplacement.shares` of a pose say.

    Attributes:
        resting_mm: [N] in a straight hand.
        start: [N + 1] where the parts of each vertex begin.
        part: [K] that raises a vertex.
        height_mm: [K] by how much.
        parts: their number.
    """

    resting_mm: np.ndarray
    start: np.ndarray
    part: np.ndarray
    height_mm: np.ndarray
    parts: int


@dataclass(frozen=True)
class PoseDisplacement:
    """All that rises on a surface of N vertices.

    Attributes:
        forms: that the pose raises.
        vein: [N] 0 to 1 where veins are highest.
        flexion: [16, 3] unit axes about which joints bend, right hand, template frame; zero for the wrist.
        padding_mm: [N] that rises in every pose: flesh in hollows.
    """

    forms: tuple[PoseForm, ...]
    vein: np.ndarray
    flexion: np.ndarray
    padding_mm: np.ndarray

    def with_tendons(self, strength: float) -> PoseDisplacement:
        """Return what rises on a person whose tendons of lifted fingers stand out so far; 1: as they are."""
        if strength == 1:
            return self
        forms = (form.scaled(strength) if form.is_of_extension else form for form in self.forms)
        return replace(self, forms=tuple(forms))

    def height_mm(self, theta: np.ndarray, veins_mm: float, forearm: np.ndarray | None = None) -> np.ndarray:
        """Compute heights [N] of the right hand in a pose theta [16, 3], rad; `forearm` as in `HandPose`.

        Veins of `veins_mm` are a quarter lower in a flat hand and a quarter higher in a clenched one.
        """
        clenched, *shares = self.shares(theta, forearm)
        height = veins_mm * (_FLAT_VEINS + _CLENCHED_VEINS * clenched) * self.vein + self.padding_mm
        form, vertex, form_mm = self._vertices_of_forms
        of_forms = np.bincount(vertex, np.array(shares)[form] * form_mm, len(height))
        return height + of_forms.astype(height.dtype)

    def shares(self, theta: np.ndarray, forearm: np.ndarray | None = None) -> np.ndarray:
        """Compute how much of each part a pose raises, [1 + forms] in [0, 1]: veins, then forms; as `height_mm`."""
        flexion_deg = np.rad2deg((theta * self.flexion).sum(1))
        if forearm is not None:
            flexion_deg[0] = -np.rad2deg(forearm[2])  # about the template's Z, which the arm's end turns to the palm
        clenched = np.clip(flexion_deg[_KNUCKLES].mean() / _CLENCHED_DEG, 0, 1)
        joint, *bends = self._bends_of_forms
        return np.concatenate([[clenched], _risen(flexion_deg[joint], *bends)])

    def parts_mm(self, veins_mm: float) -> np.ndarray:
        """Return the heights [1 + forms, N] of the parts, which `shares` of a pose add to those of a straight hand."""
        return np.stack([_CLENCHED_VEINS * veins_mm * self.vein, *(form.height_mm for form in self.forms)])

    def parts_of_vertices(self, veins_mm: float) -> RaisedParts:
        """List what the parts raise of each vertex; as `parts_mm`."""
        heights_mm = self.parts_mm(veins_mm).T
        vertex, part = heights_mm.nonzero()
        start = np.searchsorted(vertex, np.arange(len(heights_mm) + 1))
        resting_mm = veins_mm * _FLAT_VEINS * self.vein + self.padding_mm
        return RaisedParts(resting_mm, start, part.astype(np.int32), heights_mm[vertex, part], 1 + len(self.forms))

    @cached_property
    def _bends_of_forms(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of each form: the joint that raises it, and the bends at which it starts and is full, degrees."""
        joints = np.array([form.joint for form in self.forms], int)
        start_deg = np.array([form.start_deg for form in self.forms], float)
        return joints, start_deg, np.array([form.full_deg for form in self.forms], float)

    @cached_property
    def _vertices_of_forms(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """[K] each: a form, a vertex that it raises, and how much, mm. Forms raise few of all vertices."""
        heights_mm = np.stack([form.height_mm for form in self.forms])
        form, vertex = heights_mm.nonzero()
        return form, vertex, heights_mm[form, vertex]


LEVELS = 2
"""Of subdivision."""
OFFSET_STEP_M, HEIGHT_STEP_MM, VEIN_STEP = 1e-6, 0.025, 0.01
"""What one step of the stored whole numbers is worth."""
PADDING = "padding"
"""The array of a person's own flesh, which a surface may lack."""


@dataclass(frozen=True)
class DetailSurface:
    """The surface at rest, N vertices, right hand.

    Attributes:
        offset_m: [N, 3] from Loop's subdivision of the template to the surface, in the template's frame.
        raised: what rises on it.
    """

    offset_m: np.ndarray
    raised: PoseDisplacement

    def with_tendons(self, strength: float) -> DetailSurface:
        """Return it as `PoseDisplacement.with_tendons`."""
        return replace(self, raised=self.raised.with_tendons(strength))


def surface_arrays(surface: DetailSurface) -> dict[str, np.ndarray]:
    """Return the arrays of a file, in whole steps."""
    forms, raised = surface.raised.forms, surface.raised
    return {
        "offset": _steps(surface.offset_m, OFFSET_STEP_M, np.int16),
        "vein": _steps(raised.vein, VEIN_STEP, np.int8),
        "flexion": raised.flexion.astype(np.float32),
        "form/joint": np.array([form.joint for form in forms], np.int8),
        "form/range_deg": np.array([(form.start_deg, form.full_deg) for form in forms], np.float32),
        "form/height": _steps(np.stack([form.height_mm for form in forms]), HEIGHT_STEP_MM, np.int8),
    }


def load_detail_surface(hand_sha256: str) -> DetailSurface | None:
    """Load the base surface of a built-in hand; None: this hand has none."""
    return detail_surface_of(base_arrays(SURFACE_FILE)) if has_base(hand_sha256) else None


def detail_surface_of(arrays: Mapping[str, np.ndarray]) -> DetailSurface:
    """Build the surface of a file's arrays (`stored_surface.ARRAYS`)."""
    heights_mm = arrays["form/height"] * np.float32(HEIGHT_STEP_MM)
    forms = [
        PoseForm(int(joint), float(start), float(full), height)
        for joint, (start, full), height in zip(arrays["form/joint"], arrays["form/range_deg"], heights_mm, strict=True)
    ]
    vein = arrays["vein"] * np.float32(VEIN_STEP)
    padding_mm = arrays[PADDING] * np.float32(HEIGHT_STEP_MM) if PADDING in arrays else np.zeros_like(vein)
    raised = PoseDisplacement(tuple(forms), vein, arrays["flexion"], padding_mm)
    return DetailSurface(arrays["offset"] * np.float32(OFFSET_STEP_M), raised)


def _steps(values: np.ndarray, step: float, kind: type[np.signedinteger]) -> np.ndarray:
    whole, limits = np.round(values / step), np.iinfo(kind)
    if whole.min() < limits.min or whole.max() > limits.max:
        raise ValueError(f"values from {values.min()} to {values.max()} need more steps of {step} than {limits.max}")
    return whole.astype(kind)

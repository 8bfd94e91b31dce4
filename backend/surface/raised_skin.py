"""What rises on the skin of the built-in hand: veins, and the forms that a pose raises.

Heights lie along the normals of a surface finer than the template, which has none of them: that of captures
(`builtin/detailed_surface.py`), or that of pictures (`fine_surface.py`).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..hand.gestures import Degrees

_CLENCHED_DEG = 80  # mean bend of the knuckles at which veins stand out most
_KNUCKLES = [1, 4, 7, 10]


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

    def share(self, flexion_deg: Degrees) -> float:
        """In [0, 1], of the full height."""
        bent = min(max((flexion_deg - self.start_deg) / (self.full_deg - self.start_deg), 0.0), 1.0)
        return bent * bent * (3 - 2 * bent)


@dataclass(frozen=True)
class RaisedSkin:
    """All that rises on a surface of N vertices.

    Attributes:
        forms: that the pose raises.
        vein: [N] 0 to 1 where veins are highest.
        flexion: [16, 3] unit axes about which joints bend, right hand, template frame; zero for the wrist.
    """

    forms: tuple[PoseForm, ...]
    vein: np.ndarray
    flexion: np.ndarray

    def height_mm(self, theta: np.ndarray, veins_mm: float, forearm: np.ndarray | None = None) -> np.ndarray:
        """[N] in a pose theta [16, 3] rad of the right hand, with veins of this height; `forearm` as in `HandPose`.

        Veins are a quarter lower in a flat hand and a quarter higher in a clenched one.
        """
        flexion_deg = np.rad2deg((theta * self.flexion).sum(1))
        if forearm is not None:
            flexion_deg[0] = -np.rad2deg(forearm[2])  # about the template's Z, which the arm's end turns to the palm
        clenched = np.clip(flexion_deg[_KNUCKLES].mean() / _CLENCHED_DEG, 0, 1)
        height = veins_mm * (0.75 + 0.5 * clenched) * self.vein
        shares = np.array([form.share(float(flexion_deg[form.joint])) for form in self.forms])
        form, vertex, form_mm = self._places_of_forms
        of_forms = np.bincount(vertex, shares[form] * form_mm, len(height))
        return height + of_forms.astype(height.dtype)

    @cached_property
    def _places_of_forms(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """[K] each: a form, a vertex that it raises, and how much, mm. Forms raise few of all vertices."""
        heights_mm = np.stack([form.height_mm for form in self.forms])
        form, vertex = heights_mm.nonzero()
        return form, vertex, heights_mm[form, vertex]

"""Blood in the skin: what it does to albedo, and how skin pales where it is pressed, as its blood leaves.

A fingertip that is pressed squeezes the bed of its nail against the plate, too, most near the free edge.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..field.rays import CameraTensors
from ..hand.lbs import SkinTensors
from ..image.shading import ShadingInputs
from ..light.lighting import DIFFUSE, SCATTERED
from .detail_mesh import DetailMesh, DetailTemplate, PixelSurface, barycentric, blend_corners

BLOOD_LOG_ALBEDO = (-0.03, -0.38, -0.58)
"""By which blood of 1 more, the mean of people, changes the logarithm of albedo."""
_MOST_LEAVES = 0.6  # of the blood
_HALF_M = 0.0004  # flattened by which half of that has left
_LEAST = 1e-3  # share of blood whose lack nobody sees
_LAST_JOINTS = (3, 6, 9, 12, 15)
_THROUGH_M, _FADES_M = 0.011, 0.004  # a fingertip's thickness, and how the pressure fades beyond
_OF_NAIL = 0.6  # of what leaves the pad leaves the nail's bed, seen through its plate


class Blanching(NamedTuple):
    """Where a detail mesh of N vertices lacks blood.

    Attributes:
        bloodless: [N] share of it that has left the skin.
        under_nails: [N] share that has left the beds of nails, were there nails.
    """

    bloodless: Tensor
    under_nails: Tensor

    @classmethod
    def of(cls, pressed_m: np.ndarray, template: DetailTemplate) -> Blanching:
        """Compute it from how far [V] m the mesh that is subdivided is flattened."""
        pressed = torch.as_tensor(pressed_m, dtype=torch.float32, device=template.normals.device)
        both = torch.stack([pressed, _squeezed(_share_left(pressed), template.skin)], 1)
        for level in template.levels:
            both = level(both)
        return cls(_share_left(both[:, 0]), both[:, 1].clamp(0, _MOST_LEAVES))

    @property
    def both(self) -> Float[Tensor, "N 2"]:
        """Both side by side."""
        return torch.stack([self.bloodless, self.under_nails], 1)

    def paled(
        self, image: ShadingInputs, visible: PixelSurface, mesh: DetailMesh, camera: CameraTensors
    ) -> ShadingInputs:
        """Return the image with paler skin where it is pressed, and paler nails across from there.

        Args:
            image: with the surface's detail, at full size.
            visible: what it shows of the surface.
            mesh: posed.
            camera: of the image.
        """
        face = visible.face[image.pixel].long()
        both = self.both
        is_pressed = (both > _LEAST).any(1)[mesh.faces].any(1)
        row = ((face >= 0) & is_pressed[face.clamp(min=0)]).nonzero()[:, 0]
        weights = barycentric(mesh, camera, face[row], image.pixel[row])
        bloodless, under_nail = blend_corners(both[mesh.faces[face[row]]], weights).clamp(min=0).unbind(1)
        nail = bloodless.new_zeros(len(row)) if image.skin is None else image.skin.nail[row].to(bloodless)
        bloodless = torch.lerp(bloodless, torch.maximum(bloodless, under_nail), nail)[:, None]
        factor = torch.exp(-bloodless * bloodless.new_tensor(BLOOD_LOG_ALBEDO))
        coefficients = image.coefficients.clone()
        coefficients[row, SCATTERED.start : DIFFUSE.stop] *= factor.repeat(1, 3).to(coefficients.dtype)
        return image._replace(coefficients=coefficients)


def _share_left(pressed_m: Tensor) -> Tensor:
    """Return the share of blood that leaves skin flattened by so much."""
    squared = pressed_m.square()
    return _MOST_LEAVES * squared / (squared + _HALF_M**2)


def _squeezed(share: Tensor, skin: SkinTensors) -> Tensor:
    """Return the share [V] of blood that leaves beds of nails, from that [V] which leaves the skin of fingertips."""
    squeezed = torch.zeros_like(share)
    for joint in _LAST_JOINTS:
        of_tip = share * skin.lbs_weights[:, joint]
        if of_tip.max() < _LEAST:
            continue
        middle = of_tip @ skin.v_template / of_tip.sum()
        beyond_m = (torch.linalg.norm(skin.v_template - middle, dim=1) - _THROUGH_M).clamp(min=0)
        through = torch.exp(-0.5 * (beyond_m / _FADES_M) ** 2) * skin.lbs_weights[:, joint]
        squeezed = torch.maximum(squeezed, _OF_NAIL * of_tip.max() * through)
    return squeezed

"""Blood in the skin: what it does to albedo, and how skin pales where it is pressed, as its blood leaves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor

from ..field.rays import CameraTensors
from ..image.shading import ShadingInputs
from ..light.lighting import DIFFUSE, SCATTERED
from .detail_mesh import DetailMesh, DetailTemplate, PixelSurface, barycentric, blend_corners

BLOOD_LOG_ALBEDO = (-0.03, -0.38, -0.58)
"""By which blood of 1 more, the mean of people, changes the logarithm of albedo."""
_MOST_LEAVES = 0.6  # of the blood
_HALF_M = 0.0004  # flattened by which half of that has left
_LEAST = 1e-3  # share of blood whose lack nobody sees


class Blanching(NamedTuple):
    """Where a detail mesh of N vertices lacks blood: [N] share of it that has left."""

    bloodless: Tensor

    @classmethod
    def of(cls, pressed_m: np.ndarray, template: DetailTemplate) -> Blanching:
        """Compute it from how far [V] m the mesh that is subdivided is flattened."""
        pressed = torch.as_tensor(pressed_m, dtype=torch.float32, device=template.normals.device)[:, None]
        for level in template.levels:
            pressed = level(pressed)
        squared = pressed[:, 0].square()
        return cls(_MOST_LEAVES * squared / (squared + _HALF_M**2))

    def paled(
        self, image: ShadingInputs, visible: PixelSurface, mesh: DetailMesh, camera: CameraTensors
    ) -> ShadingInputs:
        """Return the image with paler skin where it is pressed.

        Args:
            image: with the surface's detail, at full size.
            visible: what it shows of the surface.
            mesh: posed.
            camera: of the image.
        """
        face = visible.face[image.pixel].long()
        is_pressed = (self.bloodless > _LEAST)[mesh.faces].any(1)
        row = ((face >= 0) & is_pressed[face.clamp(min=0)]).nonzero()[:, 0]
        weights = barycentric(mesh, camera, face[row], image.pixel[row])
        bloodless = blend_corners(self.bloodless[mesh.faces[face[row]]][..., None], weights).clamp(min=0)
        factor = torch.exp(-bloodless * bloodless.new_tensor(BLOOD_LOG_ALBEDO))
        coefficients = image.coefficients.clone()
        coefficients[row, SCATTERED.start : DIFFUSE.stop] *= factor.repeat(1, 3).to(coefficients.dtype)
        return image._replace(coefficients=coefficients)

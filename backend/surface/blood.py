"""Blood in the skin: what it does to albedo, and how skin pales as its blood leaves, where it is pressed or tight.

A fingertip that is pressed squeezes the bed of its nail against the plate, too, most near the free edge. Joints that
are red at rest pale as they bend and their skin is drawn tight over the bones.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..field.rays import CameraTensors
from ..hand.lbs import SkinTensors
from ..image.shading import ShadingInputs
from ..light.lighting import DIFFUSE, SCATTERED
from .curved_faces import CurvedFaces
from .detail_mesh import DetailMesh, DetailTemplate, PixelSurface, barycentric, blend_corners

BLOOD_LOG_ALBEDO = (-0.03, -0.38, -0.58)
"""By which blood of 1 more, the mean of people, changes the logarithm of albedo."""
PLACE_LOG_ALBEDO, PIGMENTED_LOG_ALBEDO = (-0.03, -0.40, -0.32), (0.0, 0.02, -0.16)
"""The same of blood in places, which is less yellow; and what pigment of 1 adds: it is brown, not magenta."""
DRAINS, DRAIN_STEP = "drains", 0.01
"""The array of the blood that makes joints red at rest, and what a step of it is worth."""
TIGHT_FROM, TIGHT_AT = 0.25, 1.05
"""Bends of the skin (`SkinFlexion.flex`) over a joint, at which blood begins to leave and has left."""
_MOST_LEAVES = 0.6  # of the blood
_HALF_M = 0.0004  # flattened by which half of that has left
_LEAST = 1e-3  # share of blood whose lack nobody sees
_LAST_JOINTS = (3, 6, 9, 12, 15)
_THROUGH_M, _FADES_M = 0.011, 0.004  # a fingertip's thickness, and how the pressure fades beyond
_OF_NAIL = 0.6  # of what leaves the pad leaves the nail's bed, seen through its plate


class JointBlood(NamedTuple):
    """The blood that makes a person's joints red at rest.

    Attributes:
        drains: [N] of it, at the vertices of the detail surface; 1 is what a person has in the mean.
        log_albedo: [3] by which 1 of it changes the logarithm of albedo.
    """

    drains: Tensor
    log_albedo: Tensor

    @classmethod
    def of(cls, arrays: Mapping[str, np.ndarray], melanin: float, device: torch.device | str) -> JointBlood | None:
        """Read that of a surface's arrays; None: its joints' redness does not follow the pose, but the networks do."""
        drains = drains_of(arrays)
        if drains is None:
            return None
        colour = torch.as_tensor(place_log_albedo(melanin), device=device)
        return cls(torch.as_tensor(drains, device=device), colour)

    def blanching(self, flex: Tensor) -> Blanching | None:
        """Return where a bend of the skin [N], or of the first vertices, draws blood out; None: nowhere."""
        share = tightness(flex)
        if not share.any():
            return None
        left, nowhere = self.drains[: len(flex)] * share, torch.zeros_like(flex)
        return Blanching(nowhere, nowhere, left, self.log_albedo)


def drains_of(arrays: Mapping[str, np.ndarray]) -> np.ndarray | None:
    """Read the blood [N] that joints lose where they bend; None: the surface has none of its own."""
    return arrays[DRAINS] * np.float32(DRAIN_STEP) if DRAINS in arrays else None


def place_log_albedo(melanin: float) -> np.ndarray:
    """Compute by how much [3] blood of 1 in a place changes the logarithm of albedo, under so much pigment."""
    pigmented = np.array(PIGMENTED_LOG_ALBEDO, np.float32) * np.float32(min(melanin, 1.0))
    return np.array(PLACE_LOG_ALBEDO, np.float32) + pigmented


def tightness(flex: Tensor) -> Tensor:
    """Return the share of the joints' blood that a bend of the skin (`SkinFlexion.flex`) draws out; at rest none."""
    share = ((flex - TIGHT_FROM) / (TIGHT_AT - TIGHT_FROM)).clamp(0, 1)
    return share * share * (3 - 2 * share)


class Blanching(NamedTuple):
    """Where a detail mesh of N vertices lacks blood.

    Attributes:
        bloodless: [N] share of it that has left the skin.
        under_nails: [N] share that has left the beds of nails, were there nails.
        of_joints: [N] that has left tight joints, 1 being what a person has in the mean.
        joint_log_albedo: [3] as `JointBlood.log_albedo`.
    """

    bloodless: Tensor
    under_nails: Tensor
    of_joints: Tensor
    joint_log_albedo: Tensor

    @classmethod
    def of(cls, pressed_m: np.ndarray, template: DetailTemplate) -> Blanching:
        """Compute it from how far [V] m the mesh that is subdivided is flattened."""
        pressed = torch.as_tensor(pressed_m, dtype=torch.float32, device=template.normals.device)
        both = torch.stack([pressed, _squeezed(_share_left(pressed), template.skin)], 1)
        for level in template.levels:
            both = level(both)
        left, nowhere = _share_left(both[:, 0]), torch.zeros(len(both), device=both.device)
        return cls(left, both[:, 1].clamp(0, _MOST_LEAVES), nowhere, both.new_tensor(PLACE_LOG_ALBEDO))

    def and_of(self, joints: Blanching | None) -> Blanching:
        """Add what leaves tight joints."""
        if joints is None:
            return self
        return self._replace(of_joints=joints.of_joints, joint_log_albedo=joints.joint_log_albedo)

    def on_curved(self, faces: CurvedFaces) -> Blanching:
        """Return the same of the mesh whose faces these are split from, with its vertices on edges."""
        names = ("bloodless", "under_nails", "of_joints")
        return self._replace(**{name: faces.with_middles(getattr(self, name)) for name in names})

    @property
    def both(self) -> Float[Tensor, "N 2"]:
        """Both side by side."""
        return torch.stack([self.bloodless, self.under_nails], 1)

    def paled(
        self, image: ShadingInputs, visible: PixelSurface, mesh: DetailMesh, camera: CameraTensors
    ) -> ShadingInputs:
        """Return the image with paler skin where it is pressed or tight, and paler nails across from pressed pads.

        Args:
            image: with the surface's detail, at full size.
            visible: what it shows of the surface.
            mesh: posed.
            camera: of the image.
        """
        face = visible.face[image.pixel].long()
        all_three = torch.stack([self.bloodless, self.under_nails, self.of_joints], 1)
        is_pale = (all_three > _LEAST).any(1)[mesh.faces].any(1)
        row = ((face >= 0) & is_pale[face.clamp(min=0)]).nonzero()[:, 0]
        weights = barycentric(mesh, camera, face[row], image.pixel[row])
        found = blend_corners(all_three[mesh.faces[face[row]]], weights).clamp(min=0)
        bloodless, under_nail, of_joints = found.unbind(1)
        nail = bloodless.new_zeros(len(row)) if image.skin is None else image.skin.nail[row].to(bloodless)
        bloodless = torch.lerp(bloodless, torch.maximum(bloodless, under_nail), nail)[:, None]
        log_left = bloodless * bloodless.new_tensor(BLOOD_LOG_ALBEDO)
        factor = torch.exp(-(log_left + (of_joints * (1 - nail))[:, None] * self.joint_log_albedo))
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

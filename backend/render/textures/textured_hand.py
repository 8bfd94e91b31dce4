"""An avatar's hand as a mesh for other engines: fine, skinned, with pose correctives and textures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from ...avatars.avatar import Avatar
from ...hand.corrective_keys import Corrective, factor_correctives
from ...hand.model import HandModel
from ...surface.detail_mesh import DetailTemplate
from ..avatar_surface import avatar_surface_of
from .atlas_textures import AtlasTextures, atlas_textures


@dataclass(frozen=True)
class TexturedHand:
    """A hand at rest in the template's frame, N vertices, M faces.

    Attributes:
        vertices: [N, 3] m.
        faces: [M, 3].
        corner_uv: [M, 3, 2].
        weights: [N, 17] of the 16 joints and of the forearm.
        correctives: shape keys [N, 3] m by the rotations of joints.
        textures: over the atlas.
    """

    vertices: np.ndarray
    faces: np.ndarray
    corner_uv: np.ndarray
    weights: np.ndarray
    correctives: tuple[Corrective, ...]
    textures: AtlasTextures


@torch.inference_mode()
def textured_hand(avatar: Avatar, hand: HandModel, beta: np.ndarray, resolution: int) -> TexturedHand:
    """Make the mesh of a shape: that of the avatar's surface, which the renderer shows too, if it has one.

    Args:
        avatar: relightable.
        hand: its model, of the side that is wanted.
        beta: [10].
        resolution: of the textures.

    Raises:
        LiveHandError: the avatar is not relightable.
    """
    plain = TexturedHand(
        hand.v_template + hand.shapedirs @ beta,
        hand.f,
        hand.vt[hand.ft],
        skin_weights(hand),
        tuple(factor_correctives(hand.posedirs)),
        atlas_textures(avatar, hand, resolution),
    )
    surface = avatar_surface_of(avatar, torch.device("cpu"))
    if surface is None:
        return plain
    template = DetailTemplate.of(surface.surface, hand)
    height_m = 1e-3 * surface.surface.raised.height_mm(np.zeros((16, 3)), surface.veins_mm)

    def finer(values: np.ndarray) -> np.ndarray:
        found = torch.as_tensor(values, dtype=torch.float32)
        for level in template.levels:
            found = level(found)
        return found.numpy().astype(np.float64)

    on_surface = template.offset_m + torch.as_tensor(height_m, dtype=torch.float32)[:, None] * template.normals
    return replace(
        plain,
        vertices=finer(plain.vertices) + on_surface.numpy(),
        faces=template.faces.numpy(),
        corner_uv=template.corner_uv.numpy(),
        weights=finer(plain.weights),
        correctives=tuple(key._replace(displacement=finer(key.displacement)) for key in plain.correctives),
    )


def skin_weights(hand: HandModel) -> np.ndarray:
    """Return [V, 17] weights of the 16 joints and of the forearm; rows sum to 1."""
    weights = np.concatenate([hand.lbs_weights, hand.arm_weights[:, None]], 1)
    weights[:, 0] -= hand.arm_weights
    return weights

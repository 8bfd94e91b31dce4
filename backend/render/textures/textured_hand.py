"""An avatar's hand as a mesh for other engines: fine, skinned, with pose correctives and textures."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch

from ...avatars.avatar import Avatar
from ...geometry.rotation import axis_angle_to_matrix
from ...hand.corrective_keys import Corrective, factor_correctives
from ...hand.model import MIRROR_AXIS_ANGLE, HandModel
from ...records.side import Side
from ...surface.detail_mesh import DetailTemplate
from ...surface.detail_surface import PoseDisplacement
from ..avatar_surface import avatar_surface_of
from .atlas_textures import AtlasTextures, atlas_textures


@dataclass(frozen=True)
class MorphTargets:
    """What poses add to a mesh of N vertices at rest: K targets, first the correctives, then what rises on the surface.

    Attributes:
        displacements: [K, N, 3] m at value 1.
        correctives: of the hand model.
        raised: by the surface; None: it has none.
        side: of the hand.
    """

    displacements: np.ndarray
    correctives: tuple[Corrective, ...]
    raised: PoseDisplacement | None
    side: Side

    def values(self, theta: np.ndarray, forearm: np.ndarray) -> np.ndarray:
        """Compute the targets' values [T, K] in poses theta [T, 16, 3] and forearm [T, 3], rad."""
        turns = axis_angle_to_matrix(theta) - np.eye(3)
        linear = [(turns[:, one.joint] * one.form).sum((1, 2)) for one in self.correctives]
        of_model = np.stack(linear, 1) if linear else np.zeros((len(theta), 0))
        if self.raised is None:
            return of_model
        mirror = 1 if self.side == "right" else MIRROR_AXIS_ANGLE
        shares = [self.raised.shares(*pose) for pose in zip(theta * mirror, forearm * mirror, strict=True)]
        return np.concatenate([of_model, np.stack(shares)], 1)


@dataclass(frozen=True)
class TexturedHand:
    """A hand at rest in the template's frame, N vertices, M faces.

    Attributes:
        vertices: [N, 3] m.
        faces: [M, 3].
        corner_uv: [M, 3, 2].
        weights: [N, 17] of the 16 joints and of the forearm.
        morphs: what poses add.
        textures: over the atlas.
    """

    vertices: np.ndarray
    faces: np.ndarray
    corner_uv: np.ndarray
    weights: np.ndarray
    morphs: MorphTargets
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
    correctives = tuple(factor_correctives(hand.posedirs))
    of_model = np.zeros((0, *hand.v_template.shape))
    if correctives:
        of_model = np.stack([one.displacement for one in correctives])
    plain = TexturedHand(
        hand.v_template + hand.shapedirs @ beta,
        hand.f,
        hand.vt[hand.ft],
        skin_weights(hand),
        MorphTargets(of_model, correctives, None, hand.side),
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
    raised = surface.surface.raised
    rising = 1e-3 * raised.parts_mm(surface.veins_mm)[..., None] * template.normals.numpy()
    return replace(
        plain,
        vertices=finer(plain.vertices) + on_surface.numpy(),
        faces=template.faces.numpy(),
        corner_uv=template.corner_uv.numpy(),
        weights=finer(plain.weights),
        morphs=MorphTargets(
            np.concatenate([*(finer(one)[None] for one in of_model), rising]), correctives, raised, hand.side
        ),
    )


def skin_weights(hand: HandModel) -> np.ndarray:
    """Return [V, 17] weights of the 16 joints and of the forearm; rows sum to 1."""
    weights = np.concatenate([hand.lbs_weights, hand.arm_weights[:, None]], 1)
    weights[:, 0] -= hand.arm_weights
    return weights

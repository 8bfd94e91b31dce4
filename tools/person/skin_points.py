"""Where the atlas' texels lie on the hand at rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...backend.avatars.file import load_avatar
from ...backend.avatars.library import shipped_avatar_path
from ...backend.hand.model_file import load_default_hand
from ...backend.person.lit_model.model import PersonModel
from ...backend.records.shot import HandPose
from ...backend.surface.atlas_texels import AtlasTexels
from ...backend.teacher.frames import swap_distal, template_to_build

_ANYBODY = "light"


class BakedPoints(NamedTuple):
    """The T texels of an atlas on the hand at rest, anatomical axes (x distal, y dorsal, z radial).

    Attributes:
        texels: of the atlas.
        at_mm: [T, 3].
        normals: [T, 3] unit.
    """

    texels: AtlasTexels
    at_mm: np.ndarray
    normals: np.ndarray


def skin_points(resolution: int) -> BakedPoints:
    """Place the texels of an atlas."""
    model = PersonModel.of(load_avatar(shipped_avatar_path(_ANYBODY)), load_default_hand())
    template, mesh = model.template, model.posed(HandPose.rest())
    texels = AtlasTexels.of(template.corner_uv, template.faces, resolution)
    at_m, normals = (texels.at_texels(values.numpy().astype(np.float64)) for values in (mesh.vertices, mesh.normals))
    normals = swap_distal(normals)
    return BakedPoints(
        texels, swap_distal(template_to_build(at_m)), normals / np.linalg.norm(normals, axis=1, keepdims=True)
    )

"""The detailed surface of the built-in hand, from which synthetic captures are rendered.

The template is subdivided by Loop's scheme, relaxed along the surface, and projected onto the signed distance with
details. Weights, atlas and every linear field of the template carry over through the subdivision's matrix.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..geometry.loop import loop_step
from ..hand.gestures import FingerAxes
from ..hand.model import HandModel
from ..records.errors import LiveHandError
from ..surface.detail_surface import PoseDisplacement, PoseForm
from .dependencies import needs
from .forearm import FOREARM_MM, STUMP_MM
from .frames import build_to_template, swap_distal, template_to_build
from .loop import neighbour_mean, subdivide
from .meshes import vertex_normals
from .pose_forms import pose_forms
from .projection import project_to_surface
from .rays import build_rays
from .sdf import signed_distance
from .skin_masks import skin_masks

with needs("scipy"):
    from scipy import sparse

_ON_SURFACE = 0.1  # mm: largest median distance of the built-in template's vertices from the surface
_RELAXATIONS = 4


@dataclass(frozen=True)
class DetailedSurface:
    """N vertices, M triangles; at three levels of subdivision 81,282 and 162,560.

    Attributes:
        vertices_m: [N, 3] at rest, in the frame of `HandModel.v_template`, m.
        faces: [M, 3], outward.
        subdivision: sparse [N, V], rows sum to 1; maps fields of the template (shapedirs, posedirs) to the N
            vertices, which are `subdivision @ v_template` moved onto the surface.
        lbs_weights: [N, 16], rows sum to 1.
        arm_weights: [N] as in `HandModel`.
        uv: [M, 3, 2] per face corner, in the model's atlas.
        masks: [N] each; see `skin_masks.py`.
        flex_axis: [16, 3] unit flexion axes of the joints, template frame; zero for the wrist.
        normals: [N, 3] unit, at rest.
        forms: heights along the normals that the pose raises.
        padding_mm: [N] heights along the normals of a person's own flesh in hollows.
        drains: [N] a person's own blood that leaves joints as they bend (`surface.blood`).
    """

    vertices_m: np.ndarray
    faces: np.ndarray
    subdivision: sparse.csr_array
    lbs_weights: np.ndarray
    arm_weights: np.ndarray
    uv: np.ndarray
    masks: dict[str, np.ndarray]
    flex_axis: np.ndarray
    normals: np.ndarray
    forms: tuple[PoseForm, ...]
    padding_mm: np.ndarray
    drains: np.ndarray

    @property
    def raised(self) -> PoseDisplacement:
        """Veins and forms of the pose."""
        return PoseDisplacement(self.forms, self.masks["vein"], self.flex_axis, self.padding_mm)

    def relief_m(self, theta: np.ndarray, veins_mm: float = 0.0, forearm: np.ndarray | None = None) -> np.ndarray:
        """Compute [N, 3] offsets at rest, m, of what the pose theta [16, 3] rad raises, and of veins of this height.

        `forearm` as in `HandPose`.
        """
        return 1e-3 * self.raised.height_mm(theta, veins_mm, forearm)[:, None] * self.normals

    def with_tendons(self, strength: float) -> DetailedSurface:
        """Return the surface of a person whose tendons of lifted fingers stand out so far; 1: as they are."""
        return replace(self, forms=self.raised.with_tendons(strength).forms)

    def worn(
        self, model: HandModel, vein: np.ndarray, padding_mm: np.ndarray, drains: np.ndarray | None
    ) -> DetailedSurface:
        """Return the surface with a person's own veins, flesh and blood [K], as `at_vertices` takes them."""
        own = replace(self, masks={**self.masks, "vein": self.at_vertices(model, vein)})
        own = replace(own, padding_mm=self.at_vertices(model, padding_mm))
        return own if drains is None else replace(own, drains=self.at_vertices(model, drains))

    def at_vertices(self, model: HandModel, values: np.ndarray) -> np.ndarray:
        """Interpolate values [K], given at the vertices of any of its subdivisions, at its own vertices [N]."""
        faces, count = model.f, len(model.v_template)
        while count < len(self.vertices_m):
            step = loop_step(faces, count)
            if len(values) == count:
                values = np.bincount(step.row, step.value * values[step.column], step.vertex_count)
            faces, count = step.faces, step.vertex_count
        return values[:count]


def detailed_surface(model: HandModel, levels: int = 3) -> DetailedSurface:
    """Build a built-in hand with its creases, folds and nails; about 20 s at three levels on two cores.

    Raises:
        LiveHandError: the model is not a built-in right hand, or scipy is missing.
    """
    rays = build_rays()
    coarse = template_to_build(model.v_template)
    forearm_mm = FOREARM_MM if model.has_arm else STUMP_MM
    project = partial(project_to_surface, rays, forearm_mm=forearm_mm)
    _check_builtin(model, signed_distance(rays, swap_distal(coarse), with_details=False, forearm_mm=forearm_mm))
    fine = subdivide(model.f, model.vt[model.ft], len(coarse), levels)
    relaxed = _relaxed_on_surface(project, fine.matrix @ coarse, fine.faces)
    vertices = project(relaxed, with_details=True, steps=3, damping=0.8)
    normals = vertex_normals(vertices, fine.faces)
    return DetailedSurface(
        vertices_m=build_to_template(vertices),
        faces=fine.faces,
        subdivision=fine.matrix,
        lbs_weights=fine.matrix @ model.lbs_weights,
        arm_weights=fine.matrix @ model.arm_weights,
        uv=fine.uv,
        masks=skin_masks(rays, vertices, normals),
        flex_axis=FingerAxes.of_default_hand().flexion,
        normals=normals,
        forms=pose_forms(rays, swap_distal(vertices)),
        padding_mm=np.zeros(len(vertices)),
        drains=np.zeros(len(vertices)),
    )


def _relaxed_on_surface(project: Callable[..., np.ndarray], vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Space the vertices evenly: smoothing shrinks the mesh, and projection onto the surface undoes that."""
    mean = neighbour_mean(faces, len(vertices))
    vertices = project(vertices, with_details=False, steps=2)
    for _ in range(_RELAXATIONS):
        for _ in range(4):
            vertices = 0.5 * vertices + 0.5 * (mean @ vertices)
        vertices = project(vertices, with_details=False, steps=1)
    return vertices


def _check_builtin(model: HandModel, distance: np.ndarray) -> None:
    if model.side != "right" or np.median(np.abs(distance)) > _ON_SURFACE:
        raise LiveHandError(
            f"it must be a built-in right hand, got the {model.side} hand {model.name!r}; leave --hand out"
        )

"""An avatar's density on a grid around its posed hand, and how far a mesh lies from the avatar's surface."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial import KDTree
from torch import Tensor
from torch.nn.functional import normalize

from ...field.conditions import FrameConditions, gather_field_inputs
from ...field.field import MlpField, PlaneField
from ...field.near_skin import NearSkin
from ...field.volume import Steps
from ...geometry.closest_point import closest_on_triangles
from ...geometry.mesh import PosedMesh, Topology
from ...geometry.uvh import SurfaceSamples
from ...records.errors import LiveHandError
from ...records.shot import Shot, SurfaceMesh
from ...render.renderer import Renderer

_STEP_MM = 0.25  # of the ray through each point, whose opacity tells the density there
_SURE = 4.0  # logarithm of a density's ratio to the level, beyond which it does not count
_OFF_SHELL = 5.0  # the same where the field is not asked
_MARGIN_M = 0.008  # beyond the shell, within which heights are exact
_AT_ONCE = 1 << 15
_MOST_POINTS = 1 << 27
_FOOTPRINT_M = 1e-4  # planes are read as sharp as they are
_CANDIDATES = 8  # triangles, by their middles, among which the closest is sought


class Volume(NamedTuple):
    """Values on a grid: positive where the hand is denser than the level.

    Attributes:
        values: [X, Y, Z] logarithm of the density's ratio to the level, within -4..4 in the shell, 5 or -5 off it.
        origin: [3] m, world.
        spacing: m.
    """

    values: np.ndarray
    origin: np.ndarray
    spacing: float


@torch.inference_mode()
def density_volume(renderer: Renderer, shot: Shot, level_per_mm: float, spacing_m: float) -> Volume:
    """Ask an avatar's field for its density around a posed hand.

    Outside the field's shell there is none, and inside it all is dense.

    Raises:
        LiveHandError: the avatar's field is not one of the surface, the grid would have too many points, or the density
            does not cross the level within the shell.
    """
    pipeline, field = renderer.pipeline, renderer.pipeline.field
    if isinstance(field, MlpField) and field.asks != "surface":
        raise LiveHandError(f"a mesh is extracted from fields of the surface, got one of points in the {field.asks}")
    topology, mesh = pipeline.topology_of(shot), pipeline.mesh(shot)
    visibility = pipeline.backend.visibility(mesh, topology)
    theta = pipeline.tensor(pipeline.canonical_theta(shot.pose))
    conditions = FrameConditions.of(theta, pipeline.skinning, topology, mesh, visibility)
    density = _FieldDensity(field, mesh, topology, conditions, pipeline.avatar.config.sampler.shell_m)
    reach_m = density.shell_m * float(mesh.scale) + 2 * spacing_m
    origin, shape = _grid(mesh.vertices.cpu().numpy(), reach_m, spacing_m)
    skin, values = NearSkin(mesh, topology), np.empty(int(np.prod(shape)), np.float32)
    for start in range(0, len(values), _AT_ONCE):
        index = np.arange(start, min(start + _AT_ONCE, len(values)))
        points = pipeline.tensor(origin + spacing_m * np.stack(np.unravel_index(index, shape), -1))
        near, height_m = skin.roughly(points, reach_m + _MARGIN_M)
        ratio = torch.where(height_m < 0, _OFF_SHELL, -_OFF_SHELL)
        ratio[near] = density.ratio(skin.at(points[near]), level_per_mm)
        values[index] = ratio.cpu().numpy()
    _check_crossed(values, level_per_mm)
    return Volume(values.reshape(shape), origin, spacing_m)


class _FieldDensity(NamedTuple):
    """A field in one pose; `shell_m` in the template's metres."""

    field: MlpField | PlaneField
    mesh: PosedMesh
    topology: Topology
    conditions: FrameConditions
    shell_m: float

    def ratio(self, samples: SurfaceSamples, level_per_mm: float) -> Float[Tensor, " S"]:
        """Compute the logarithm of the density's ratio to the level, within -4..4; off the shell 5 or -5."""
        ratio = torch.where(samples.height_m < 0, _OFF_SHELL, -_OFF_SHELL)
        (asked,) = torch.where(samples.height_m.abs() <= self.shell_m)
        if len(asked):
            density = self._per_mm(SurfaceSamples(*(values[asked] for values in samples)))
            ratio[asked] = (density / level_per_mm).clamp(min=1e-30).log().clamp(-_SURE, _SURE)
        return ratio

    def _per_mm(self, samples: SurfaceSamples) -> Float[Tensor, " S"]:
        """Compute the densities per mm that make a short step of a ray as opaque as it is."""
        view = -normalize(self.mesh.normals[self.topology.faces[samples.face]].sum(1), dim=-1)
        footprint_m = torch.full_like(samples.height_m, _FOOTPRINT_M)
        light = self.field.light_code(self.conditions.visibility)
        inputs = gather_field_inputs(samples, self.topology, self.conditions, light, view, footprint_m, self.shell_m)
        steps = Steps(
            torch.ones_like(footprint_m)[:, None],
            torch.full_like(footprint_m, _STEP_MM),
            torch.zeros_like(view[:, 0]) > 0,
        )
        alpha = self.field(inputs, steps).alpha.double().clamp(max=1 - 1e-12)
        return -torch.log1p(-alpha).float() / _STEP_MM


def _check_crossed(values: np.ndarray, level_per_mm: float) -> None:
    """Raise LiveHandError if the values in the shell are all on one side of the level."""
    in_shell = np.abs(values) < _OFF_SHELL
    for is_beyond, size in ((values > 0, "smaller"), (values <= 0, "larger")):
        if not (in_shell & is_beyond).any():
            raise LiveHandError(
                f"the density must cross {level_per_mm:g} per mm around the skin, it does not; give a {size} --density"
            )


def distances_m(points: np.ndarray, surface: SurfaceMesh) -> np.ndarray:
    """Measure the distances [N], m, of points [N, 3] to a surface."""
    triangles = torch.as_tensor(surface.vertices[surface.faces], dtype=torch.float32)
    _, nearest = KDTree(triangles.mean(1).numpy()).query(points, k=min(_CANDIDATES, len(triangles)))
    candidates = triangles[torch.as_tensor(nearest.reshape(len(points), -1))]
    squared = closest_on_triangles(torch.as_tensor(points, dtype=torch.float32)[:, None], candidates)[1]
    return squared.min(1).values.sqrt().numpy()


def _grid(vertices: np.ndarray, reach_m: float, spacing_m: float) -> tuple[np.ndarray, tuple[int, int, int]]:
    """Lay a grid around the mesh; returns its origin, m, and its shape."""
    low, high = vertices.min(0) - reach_m, vertices.max(0) + reach_m
    counts = np.ceil((high - low) / spacing_m).astype(int) + 1
    if np.prod(counts.astype(float)) > _MOST_POINTS:
        raise LiveHandError(
            f"the grid must have at most {_MOST_POINTS:,} points, got {' x '.join(map(str, counts))}; "
            "give a larger --spacing"
        )
    return low, (int(counts[0]), int(counts[1]), int(counts[2]))

"""The person so far: a base avatar's networks and the person's factor on albedo; renders what pictures should show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import torch

from ...avatars.avatar import Avatar
from ...field.rays import CameraTensors, camera_tensors, view_directions
from ...hand.lbs import posed_vertices
from ...hand.model import HandModel
from ...image.shading import diffuse_and_specular
from ...records.camera import Camera
from ...records.errors import LiveHandError
from ...records.frame import Frame, empty_frame
from ...records.light import Light
from ...records.shot import HandPose, Shot
from ...render.progress import RenderProgress
from ...render.relightable import RelightablePipeline
from ...render.renderer import Renderer
from ...surface.albedo_ratio import AlbedoRatio, vertex_ratio
from ...surface.detail_mesh import DetailMesh, DetailTemplate, barycentric, blend_corners


class GeometryMaps(NamedTuple):
    """What the pixels of a picture [H, W] show of the person's surface at their centres.

    Attributes:
        mesh: posed.
        is_seen: whether there is one.
        uv: [H, W, 2] atlas coordinates; zeros where there is none.
        facing: cosine of its normal and the direction to the camera.
        depth: m; infinite where there is none.
    """

    mesh: DetailMesh
    is_seen: np.ndarray
    uv: np.ndarray
    facing: np.ndarray
    depth: np.ndarray


class DiffuseAndSpecular(NamedTuple):
    """One frame in two parts, whose sum it is: light that has met the skin's pigment, and light that has not."""

    diffuse: Frame
    specular: Frame


@dataclass(frozen=True)
class PersonModel:
    """Renders a person of whom an atlas of albedo ratios is known.

    Attributes:
        avatar: the base: relightable, with a surface.
        hand: its model.
        offset_m: [V] the person's shape, along the normals of the template at rest.
        pipeline: of the base, with the person's factor.
    """

    avatar: Avatar
    hand: HandModel
    offset_m: np.ndarray
    pipeline: PersonPipeline

    @classmethod
    def of(cls, avatar: Avatar, hand: HandModel) -> PersonModel:
        """Begin with the base alone.

        Raises:
            LiveHandError: the base is not relightable, or has no surface.
        """
        base = Renderer(avatar, hand, "cpu").pipeline
        if not isinstance(base, RelightablePipeline) or avatar.surface is None:
            raise LiveHandError(
                f"the base must be a relightable avatar with a surface, got '{avatar.name}'; use one that ships"
            )
        pipeline = PersonPipeline(avatar, hand, base.device, base.precision, base.backend, base=base)
        return cls(avatar, hand, np.zeros(len(hand.v_template)), pipeline)

    def with_ratio(self, steps: np.ndarray | None) -> PersonModel:
        """Return the person with an atlas of ratios [A, A, 3] int8 (`albedo_ratio`); None: with the base's albedo."""
        return replace(self, pipeline=replace(self.pipeline, steps=steps))

    def with_offset(self, offset_m: np.ndarray) -> PersonModel:
        """Return the person with another shape [V] along the normals."""
        return replace(self, offset_m=offset_m)

    def vertices(self, pose: HandPose) -> np.ndarray:
        """Pose the mesh [V, 3], world, m, with the person's shape."""
        vertices = posed_vertices(self.hand, pose)
        if not self.offset_m.any():
            return vertices
        normals = self.pipeline.mesh(Shot(pose, vertices, _ANY_CAMERA)).normals.cpu().numpy()
        return vertices + self.offset_m[:, None] * normals

    def rendered(self, pose: HandPose, camera: Camera, light: Light) -> Frame:
        """Render the person without hair; a pose and a view that were rendered last take another light at once."""
        with torch.inference_mode():
            return self.pipeline.render(self._shot(pose, camera, light), _unseen_progress())

    def rendered_parts(self, pose: HandPose, camera: Camera, lights: Sequence[Light]) -> list[DiffuseAndSpecular]:
        """Render the person in each light as `rendered` does, what the skin reflects at its surface apart."""
        if not lights:
            return []
        shot = self._shot(pose, camera, lights[0])
        with torch.inference_mode():
            return [self.pipeline.render_parts(replace(shot, light=light), _unseen_progress()) for light in lights]

    def _shot(self, pose: HandPose, camera: Camera, light: Light) -> Shot:
        return Shot(pose, self.vertices(pose), camera, light, hair=0.0)

    def seen(self, pose: HandPose, camera: Camera) -> GeometryMaps:
        """Find what a picture shows of the surface."""
        mesh, view = self.posed(pose), camera_tensors(camera, "cpu")
        with torch.inference_mode():
            visible = self.pipeline.backend.visible_surface(mesh, view)
            pixel = (visible.face >= 0).nonzero()[:, 0]
            return _geometry_maps(mesh, view, pixel, visible.face[pixel].long(), visible.depth)

    def posed(self, pose: HandPose) -> DetailMesh:
        """Pose the detail surface."""
        shot = Shot(pose, self.vertices(pose), _ANY_CAMERA)
        surface = self.pipeline.surface
        assert surface is not None
        with torch.inference_mode():
            return surface.mesh(pose, self.pipeline.mesh(shot), self.pipeline.topology_of(shot).frames)

    @property
    def base_albedo(self) -> np.ndarray:
        """[V, 3] of the base at the mesh's vertices."""
        return self.pipeline.base_albedo

    @property
    def template(self) -> DetailTemplate:
        """Of the right hand's detail surface."""
        surface = self.pipeline.surface
        assert surface is not None
        return surface.levels("right").finest

    def at_detail(self, values: np.ndarray) -> np.ndarray:
        """Interpolate values [V, C] of the mesh's vertices at those of the detail surface [N, C]."""
        finer = torch.as_tensor(values, dtype=torch.float32)
        for level in self.template.levels:
            finer = level(finer)
        return finer.numpy()


@dataclass(frozen=True)
class PersonPipeline(RelightablePipeline):
    """The base's pipeline with another factor on albedo; networks and surface are the base's own, made once.

    Attributes:
        base: whose they are.
        steps: [A, A, 3] int8 of the factor (`albedo_ratio`); None: 1.
    """

    base: RelightablePipeline | None = None
    steps: np.ndarray | None = None

    def render_parts(self, shot: Shot, progress: RenderProgress) -> DiffuseAndSpecular:
        """Render a frame in two parts; raises what `Renderer.render` raises."""
        gbuffer = self.gbuffer_of(shot, progress)
        if gbuffer is None:
            empty = empty_frame(shot.camera.size_px)
            return DiffuseAndSpecular(empty, empty)
        parts = (replace(gbuffer, image=part) for part in diffuse_and_specular(gbuffer.image))
        with self.backend.threads_of_frame(gbuffer.crop.pixels):
            features = self.lit(gbuffer, shot)
            return DiffuseAndSpecular(*(self.developed(part, features) for part in parts))

    @cached_property
    def surface(self):
        """The base's surface with the person's factor."""
        base = self._base.surface
        if base is None or self.steps is None:
            return base
        return base.with_maps(base.skin.maps._replace(ratio=AlbedoRatio.of(self.steps, self.device)))

    @cached_property
    def _vertex_albedo(self) -> np.ndarray:
        albedo = self._base._vertex_albedo
        if self.steps is None:
            return albedo
        factor = vertex_ratio({"albedo/ratio": self.steps}, self.hand.vt[self.hand.ft], self.hand.f)
        return (albedo * factor).clip(0, 1)

    @cached_property
    def _networks(self):
        return self._base._networks

    @property
    def base_albedo(self) -> np.ndarray:
        """[V, 3] without the person's factor."""
        return self._base._vertex_albedo

    @property
    def _base(self) -> RelightablePipeline:
        assert self.base is not None
        return self.base


def _unseen_progress() -> RenderProgress:
    return RenderProgress(lambda: False, lambda stage: None)


_ANY_CAMERA = Camera(np.eye(3), np.eye(4), (1, 1))


def _geometry_maps(
    mesh: DetailMesh, view: CameraTensors, pixel: torch.Tensor, face: torch.Tensor, depth: torch.Tensor
) -> GeometryMaps:
    width, height = view.size_px
    weights = barycentric(mesh, view, face, pixel)
    normal = torch.nn.functional.normalize(blend_corners(mesh.normals[mesh.faces[face]], weights), dim=-1)
    facing = -(normal * view_directions(view, pixel)).sum(-1)

    def image(values: torch.Tensor) -> np.ndarray:
        whole = values.new_zeros(width * height, *values.shape[1:])
        whole[pixel] = values
        return whole.reshape(height, width, *values.shape[1:]).numpy()

    is_seen = image(torch.ones(len(pixel), dtype=torch.bool))
    uv = image(blend_corners(mesh.corner_uv[face], weights))
    depth_m = np.where(is_seen, depth.reshape(height, width).numpy(), np.inf)
    return GeometryMaps(mesh, is_seen, uv, image(facing), depth_m)

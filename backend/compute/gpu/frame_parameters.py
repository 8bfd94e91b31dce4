"""All that changes from one lit frame to the next: one block of numbers, filled on the host and copied at once.

Nothing of it is an argument of a launch, for a recorded sequence keeps those.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ...field.rays import CameraTensors
from ...field.sampler import BEFORE_M, BEHIND_M, LEAST_REACH_M
from ...image.edge_avoiding_filter import OFF_PLANE_M
from ...light.prefiltered_environment import SIDE, WIDTHS
from ...light.samples import LightSamples
from ...light.shadow_maps import (
    CELL_MAP_PX,
    LAMP_MAP_PX,
    SKY_MAP_PX,
    SOFT_MAP_PX,
    SURFEL_MAP_PX,
    ShadowViews,
    scene_lengths,
)
from ...light.sky_samples import SKY_DIRECTIONS
from ...surface.detail_maps import BUMP, SLOPE_STEP_MM
from ...surface.edge_antialiasing import STEP_M, STEP_PX
from ..lit_frames import FrameModel, LitShot
from .blocks import HostBlock, Layout

EDGE_SHARE = 0.125
"""Of the pixels of an image, how many may show two parts of a hand; most that was seen: 0.05."""
LAMP_COLUMNS = (
    *("lamp", "of_sample", "is_sun", "axis", "is_area", "share", "tan_spread", "spread_share"),
    *("cos_cone", "cone_edge", "shadow"),
)
"""The samples of lamps, in the order of `LampSamples` and of kernels."""


@dataclass(frozen=True)
class FrameShape:
    """The sizes of a frame: frames of one shape share buffers, and a recorded sequence.

    Attributes:
        size_px: of the rays' image.
        sky: directions.
        samples: of all lamps.
        hard: of these, of lamps whose shadows have edges.
        lamps: their number.
    """

    size_px: tuple[int, int]
    sky: int
    samples: int
    hard: int
    lamps: int

    @classmethod
    def of(cls, shot: LitShot) -> FrameShape:
        """Measure a shot."""
        sky, lamps = shot.light
        hard = int(lamps.is_hard.sum())
        return cls(shot.camera.size_px, len(sky.towards), len(lamps.lamp), hard, len(lamps.rgb))

    @property
    def rays(self) -> int:
        """Most rays: one for each pixel of their image."""
        return self.size_px[0] * self.size_px[1]

    @property
    def edges(self) -> int:
        """Most pixels of the full-size image that show two parts."""
        return int(4 * self.rays * EDGE_SHARE)

    @property
    def views(self) -> int:
        """Of the hand from its light: from the sky, from lamps at rays, and from lamps at surfels."""
        return self.sky + 2 * self.samples

    @property
    def map_cells(self) -> int:
        """Of all shadow maps, in three layers each."""
        soft = self.samples - self.hard
        of_sky = SKY_DIRECTIONS * CELL_MAP_PX**2 + (self.sky - SKY_DIRECTIONS) * SKY_MAP_PX**2
        cells = of_sky + self.hard * LAMP_MAP_PX**2 + soft * SOFT_MAP_PX**2
        return 3 * (cells + self.samples * SURFEL_MAP_PX**2)


def parameter_layout(model: FrameModel, shape: FrameShape) -> Layout:
    """Lay out the parameters of frames of one shape."""
    vertices, fine, views = len(model.albedo), len(model.template.offset_m), shape.views
    joints = len(model.template.skin.parents)
    lamp_kinds = wp.int64, wp.vec3, wp.bool, wp.vec3, wp.bool, *[wp.float32] * 6
    return {
        "vertices": (wp.vec3, (vertices,)),
        "theta": (wp.vec3, (joints,)),
        "forearm": (wp.vec3, (1,)),
        "transl": (wp.vec3, (1,)),
        "rest_joints": (wp.vec3, (joints,)),
        "beta": (wp.float32, (model.template.skin.shapedirs.shape[2],)),
        "joint_pose": (wp.float32, (joints, 9)),
        "height_m": (wp.float32, (fine,)),
        "flex": (wp.float32, (vertices,)),
        "K": (wp.float32, (3, 3)),
        "full_K": (wp.float32, (3, 3)),
        "world2cam": (wp.float32, (4, 4)),
        "view": (wp.vec3, (4,)),
        "full_view": (wp.vec3, (4,)),
        **{name: (wp.float32, (count,)) for name, count in _CONSTANTS.items()},
        "window": (wp.int32, (2,)),
        "frames": (wp.mat33, (views,)),
        "distance": (wp.float32, (views,)),
        "table": (wp.int32, (views, 9)),
        "towards": (wp.vec3, (shape.sky,)),
        "flux": (wp.vec3, (shape.sky,)),
        "brightness": (wp.float32, (shape.sky,)),
        "sky_share": (wp.float32, (shape.sky,)),
        "radiance": (wp.float32, ((SIDE + 2) ** 2, len(WIDTHS), 3)),
        **{name: (kind, (shape.samples,)) for name, kind in zip(LAMP_COLUMNS, lamp_kinds, strict=True)},
        "lamp_rgb": (wp.vec3, (shape.lamps,)),
        "lamp_radius_rad": (wp.float32, (shape.lamps,)),
    }


_CONSTANTS = {
    "scale": 1,
    "no_lift_m": 1,
    "lifts_m": 2,
    "reaches_m": 3,
    "units": 3,
    "edge_m": 1,
    "off_plane_m": 1,
    "part_steps": 2,
    "skin_constants": 5,
    "sphere": 4,
    "lengths": 4,
}
"""Names and lengths of what kernels take as constants of a view."""


def fill_parameters(host: HostBlock, model: FrameModel, shape: FrameShape, shot: LitShot) -> None:
    """Fill the parameters of a frame."""
    _fill_pose(host, model, shot)
    _fill_camera(host, shot.camera)
    host["window"][:] = shot.window_px
    for name, values in _constants(model, shot).items():
        host[name][:] = values
    _fill_light(host, shot.light)
    _fill_views(host, model, shape, shot)


def _fill_pose(host: HostBlock, model: FrameModel, shot: LitShot) -> None:
    skin, pose = model.template.skin, shot.pose
    named = {"theta": pose.theta, "forearm": pose.forearm[None], "transl": pose.transl[None], "beta": pose.beta}
    named |= {"vertices": shot.vertices, "joint_pose": shot.joint_pose, "height_m": shot.height_m, "flex": shot.flex}
    for name, values in named.items():
        host[name][:] = values
    shaped = skin.v_template.numpy() + skin.shapedirs.numpy() @ pose.beta
    host["rest_joints"][:] = skin.J_regressor.numpy() @ shaped


def _fill_camera(host: HostBlock, camera: CameraTensors) -> None:
    K, world2cam = camera.K.double().numpy(), camera.world2cam.double().numpy()
    host["world2cam"][:] = world2cam
    for name, matrix in (("", K), ("full_", np.diag([2.0, 2, 1]) @ K)):
        host[f"{name}K"][:] = matrix
        host[f"{name}view"][:] = camera_axes(matrix, world2cam)


def camera_axes(K: Float[np.ndarray, "3 3"], world2cam: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 3"]:
    """Compute a camera's centre, m, and the directions of a column, of a row, and of pixel (0, 0), world."""
    turn, offset = world2cam[:3, :3], world2cam[:3, 3]
    return np.concatenate([-(turn.T @ offset)[None], (turn.T @ np.linalg.inv(K)).T])


def _constants(model: FrameModel, shot: LitShot) -> dict[str, Any]:
    """Compute what kernels take as constants of a view."""
    scale, maps = shot.scale, model.maps
    focal_px, radius = float(shot.camera.focal_px), float(shot.bounds.radius)
    texel_m, slope = scale * maps.texel_m, scale * (-BUMP * 1e-3 * maps.resolution * SLOPE_STEP_MM)
    finer_by = 0.0 if maps.ratio is None else float(np.log2(maps.ratio.resolution / maps.resolution))
    return {
        "scale": scale,
        "no_lift_m": 0.0,
        "lifts_m": (model.sampler.shell_m * scale, model.stands_out_m * scale),
        "reaches_m": (scale * BEFORE_M, scale * BEHIND_M, scale * LEAST_REACH_M),
        "units": (model.sampler.shell_m, focal_px, scale),
        "edge_m": model.edge_m * scale,
        "off_plane_m": OFF_PLANE_M * scale,
        "part_steps": (STEP_M * scale, STEP_PX / (2 * focal_px)),
        "skin_constants": (1 / (2 * focal_px * texel_m), texel_m, float(maps.blurred_level), slope, finer_by),
        "sphere": (*shot.bounds.centre.tolist(), radius),
        "lengths": scene_lengths(scale / radius),
    }


def _fill_light(host: HostBlock, light: LightSamples) -> None:
    sky, lamps = light
    named: dict[str, Tensor] = {
        "towards": sky.towards,
        "flux": sky.flux,
        "brightness": sky.brightness,
        "sky_share": sky.share,
        "radiance": sky.mirrored.radiance,
        "lamp_rgb": lamps.rgb,
        "lamp_radius_rad": lamps.radius_rad,
        **dict(zip(LAMP_COLUMNS, lamps[: len(LAMP_COLUMNS)], strict=True)),
    }
    for name, values in named.items():
        host[name][:] = values.numpy()


def _fill_views(host: HostBlock, model: FrameModel, shape: FrameShape, shot: LitShot) -> None:
    """Fill the views of shadow maps, and which maps, points and casters they have."""
    sky, lamps = shot.light
    parts: tuple[ShadowViews, ...] = (sky.views(), *[lamps.views(shot.bounds)] * 2)
    for name, values in zip(("frames", "distance"), zip(*parts, strict=True), strict=True):
        host[name][:] = np.concatenate([one.numpy() for one in values])
    vertices, faces = len(model.albedo), len(model.topology.faces)
    on_mesh, on_surface = (0, vertices, 0, faces), (vertices, model.casting_vertices, faces, model.casting_faces)
    table, (first, second) = host["table"], (shape.sky, shape.sky + shape.samples)
    table[:first, 2:] = 0, vertices, 1, *on_mesh
    table[first:second, 2:] = vertices + shape.rays, 0, 1, *on_surface
    table[second:, 2:] = 0, vertices, 0, *on_mesh
    table[:SKY_DIRECTIONS, 0], table[SKY_DIRECTIONS:first, 0] = CELL_MAP_PX, SKY_MAP_PX
    table[second:, 0] = SURFEL_MAP_PX
    table[first:second, 0] = np.where(lamps.is_hard.numpy(), LAMP_MAP_PX, SOFT_MAP_PX)
    cells = 3 * table[:, 0] ** 2
    table[:, 1] = cells.cumsum() - cells

"""All that changes from one lit frame to the next: one block of numbers, filled on the host and copied at once.

Nothing of it is an argument of a launch, for a recorded sequence keeps those.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from jaxtyping import Float
from torch import Tensor

from ...field.rays import CameraTensors
from ...field.sampler import BEFORE_M, BEHIND_M, LEAST_REACH_M
from ...image.edge_avoiding_filter import OFF_PLANE_M
from ...light.prefiltered_environment import SIDE, WIDTHS
from ...surface.detail_maps import BUMP, SLOPE_STEP_MM
from ...surface.edge_antialiasing import STEP_M, STEP_PX
from ..whole_frames import LitModel, LitShot
from .blocks import HostBlock, Layout
from .frame_nearby import fill_nearby, nearby_layout
from .frame_shape import FrameShape
from .frame_views import fill_views

_OF_SAMPLES = {
    "lamp": wp.int64,
    "of_sample": wp.vec3,
    "is_sun": wp.bool,
    "axis": wp.vec3,
    "is_area": wp.bool,
    "share": wp.float32,
    "tan_spread": wp.float32,
    "spread_share": wp.float32,
    "cos_cone": wp.float32,
    "cone_edge": wp.float32,
    "shadow": wp.float32,
}
LAMP_COLUMNS = tuple(_OF_SAMPLES)
"""The samples of lamps, in the order of `LampSamples` and of kernels."""
SURFEL_LAMP_COLUMNS = tuple(f"surfel_{name}" for name in LAMP_COLUMNS)
"""The same, at surfels."""


CAMERA: Layout = {
    "K": (wp.float32, (3, 3)),
    "full_K": (wp.float32, (3, 3)),
    "world2cam": (wp.float32, (4, 4)),
    "view": (wp.vec3, (4,)),
    "full_view": (wp.vec3, (4,)),
    "window": (wp.int32, (2,)),
}
"""Of the rays and of the image; and how many columns and rows have rays."""


def parameter_layout(model: LitModel, shape: FrameShape) -> Layout:
    """Lay out the parameters of frames of one shape."""
    vertices, fine, views = len(model.albedo), len(model.template.offset_m), shape.views
    joints = len(model.template.skin.parents)
    return {
        "vertices": (wp.vec3, (vertices,)),
        "theta": (wp.vec3, (joints,)),
        "forearm": (wp.vec3, (1,)),
        "transl": (wp.vec3, (1,)),
        "rest_joints": (wp.vec3, (joints,)),
        "beta": (wp.float32, (model.template.skin.shapedirs.shape[2],)),
        "joint_pose": (wp.float32, (joints, 9)),
        "raised_shares": (wp.float32, (model.raised.parts,)),
        "flex": (wp.float32, (vertices,)),
        **CAMERA,
        **{name: (wp.float32, (count,)) for name, count in _CONSTANTS.items()},
        "frames": (wp.mat33, (views,)),
        "distance": (wp.float32, (views,)),
        "table": (wp.int32, (views, 10)),
        "spheres": (wp.float32, (2, 4)),
        "lengths": (wp.float32, (2, 4)),
        "towards": (wp.vec3, (shape.sky,)),
        "flux": (wp.vec3, (shape.sky,)),
        "brightness": (wp.float32, (shape.sky,)),
        "sky_share": (wp.float32, (shape.sky,)),
        "radiance": (wp.float32, ((SIDE + 2) ** 2, len(WIDTHS), 3)),
        **{name: (kind, (shape.samples,)) for name, kind in _OF_SAMPLES.items()},
        **{f"surfel_{name}": (kind, (shape.at_surfels,)) for name, kind in _OF_SAMPLES.items()},
        "pressed": (wp.vec2, (fine if shape.is_pressed else 0,)),
        "hair_count": (wp.int32, (1,)),
        "hair_unit": (wp.float32, (1,)),
        **nearby_layout(shape),
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
}
"""Names and lengths of what kernels take as constants of a view."""


def fill_parameters(
    host: HostBlock, model: LitModel, shape: FrameShape, shot: LitShot, last: LitShot | None = None
) -> None:
    """Fill the parameters of a frame; what the last one had as the same tensors is left as it is."""
    _fill_pose(host, model, shot, last)
    fill_camera(host, shot.camera)
    host["window"][:] = shot.window_px
    for name, values in _constants(model, shot).items():
        host[name][:] = values
    if shot.pressed is not None:
        host["pressed"][:] = shot.pressed
    _fill_light(host, shot, last)
    host["hair_count"][:] = shot.hairs
    host["hair_unit"][:] = (float(shot.light.unblocked(shot.bounds.centre)) or 1.0) if shot.hairs else 1.0
    fill_nearby(host, shot)
    fill_views(host, model, shape, shot, last)


def _fill_pose(host: HostBlock, model: LitModel, shot: LitShot, last: LitShot | None) -> None:
    skin, pose = model.template.skin, shot.pose
    named = {"theta": pose.theta, "forearm": pose.forearm[None], "transl": pose.transl[None], "beta": pose.beta}
    named |= {
        "vertices": shot.vertices,
        "joint_pose": shot.joint_pose,
        "raised_shares": shot.raised_shares,
        "flex": shot.flex,
    }
    for name, values in named.items():
        host[name][:] = values
    if last is not None and np.array_equal(pose.beta, last.pose.beta):
        return
    shaped = skin.v_template.numpy() + skin.shapedirs.numpy() @ pose.beta
    host["rest_joints"][:] = skin.J_regressor.numpy() @ shaped


def fill_camera(host: HostBlock, camera: CameraTensors) -> None:
    """Fill the camera of rays, and that of the image, twice as large."""
    K, world2cam = camera.K.numpy(), camera.world2cam.numpy()
    axes = camera_axes(K, world2cam)
    host["world2cam"][:] = world2cam
    host["K"][:], host["view"][:] = K, axes
    host["full_K"][:], host["full_view"][:] = K, axes
    host["full_K"][:2] *= 2
    host["full_view"][1:3] /= 2


def camera_axes(K: Float[np.ndarray, "3 3"], world2cam: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 3"]:
    """Compute a camera's centre, m, and the directions of a column, of a row, and of pixel (0, 0), world.

    K is inverted by hand, as `field.rays.camera_tensors` says why; it is an upper triangle that ends in 1.
    """
    turn, offset = world2cam[:3, :3].astype(np.float64), world2cam[:3, 3].astype(np.float64)
    (focal, skew, column), (_, tall, row), _ = K.tolist()
    inverse = [[1 / focal, -skew / (focal * tall), (skew * row / tall - column) / focal], [0, 1 / tall, -row / tall]]
    axes = np.empty((4, 3))
    axes[0] = -(turn * offset[:, None]).sum(0)
    axes[1:] = (np.array([*inverse, [0, 0, 1]])[:, :, None] * turn[:, None]).sum(0)
    return axes


def focal_of(camera: CameraTensors) -> float:
    """Return its `focal_px`, without torch."""
    K = camera.K.numpy()
    return float(np.sqrt(abs(K[0, 0] * K[1, 1])))


def _constants(model: LitModel, shot: LitShot) -> dict[str, Any]:
    """Compute what kernels take as constants of a view."""
    scale, maps = shot.scale, model.maps
    focal_px = focal_of(shot.camera)
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
    }


def _fill_light(host: HostBlock, shot: LitShot, last: LitShot | None) -> None:
    sky, lamps = shot.light
    named: dict[str, Tensor] = {"lamp_rgb": lamps.rgb, "lamp_radius_rad": lamps.radius_rad}
    if last is None or sky is not last.light.sky:
        of_sky = {"towards": sky.towards, "flux": sky.flux, "sky_share": sky.share}
        named |= {**of_sky, "brightness": sky.brightness, "radiance": sky.mirrored.radiance}
    if last is None or lamps.position is not last.light.lamps.position:
        named |= dict(zip(LAMP_COLUMNS, lamps[:-2], strict=True))
    if last is None or shot.at_surfels.position is not last.at_surfels.position:
        named |= dict(zip(SURFEL_LAMP_COLUMNS, shot.at_surfels[:-2], strict=True))
    for name, values in named.items():
        host[name][:] = values.numpy()

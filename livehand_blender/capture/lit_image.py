"""Renders the images of a lit capture: one Cycles render for all light groups of an image, cut to the hand's box."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np

from ...backend.capture.capture import Capture, CaptureView
from ...backend.capture.exr import read_exr, write_exr
from ...backend.capture.varied_light import GROUPS
from ...backend.hand.lbs import posed_vertices
from ...backend.hand.model import HandModel
from ...backend.records.errors import LiveHandError
from .light_groups import LightGroupPasses
from .lighting import SceneLighting
from .scene import set_camera

# Around the template's box: its detailed surface lies up to 8 mm outside, and a pixel's filter reaches 2 px.
_MARGIN_M, _MARGIN_PX = 0.01, 4
Box = tuple[int, int, int, int]
"""Left, top, right and bottom edges, px."""


class LitImages:
    """Renders images of a capture, each from its entries of one pose, camera and split."""

    def __init__(self, scene: bpy.types.Scene, capture: Capture, hand: HandModel):
        self._scene, self._capture, self._hand = scene, capture, hand
        self._lighting = SceneLighting(scene)
        self._passes = LightGroupPasses(scene, len(GROUPS))

    def render(self, views: Sequence[CaptureView]) -> None:
        """Write the files of one image's light groups; the surface must be posed, samples and seed be set.

        Raises:
            LiveHandError: a file cannot be written.
        """
        camera = views[0].camera
        set_camera(self._scene, camera)
        lights = [self._capture.lights[view.light] for view in views if view.light is not None]
        self._lighting.set_lights(lights, self._passes.names[: len(lights)])
        whole = (0, 0, *camera.size_px)
        box = self._hand_box(views[0])
        alpha, groups = self._render_box(box, len(views))
        if box != whole and _is_cut(alpha, box, camera.size_px):
            box = whole
            alpha, groups = self._render_box(box, len(views))
        for view, group in zip(views, groups, strict=True):
            write_picture(self._capture.folder / view.file, group * view.exposure, alpha, box, camera.size_px)

    def _hand_box(self, view: CaptureView) -> Box:
        """Find the image's part that may show the hand."""
        camera = view.camera
        positions_px, depth = camera.project(posed_vertices(self._hand, self._capture.poses[view.pose_index]))
        margin_px = _MARGIN_PX + _MARGIN_M * camera.K[0, 0] / depth.min() if depth.min() > _MARGIN_M else np.inf
        low = np.clip(np.floor(positions_px.min(0) - margin_px), 0, np.array(camera.size_px) - 1)
        high = np.clip(np.ceil(positions_px.max(0) + margin_px), low + 1, camera.size_px)
        return (*low.astype(int).tolist(), *high.astype(int).tolist())

    def _render_box(self, box: Box, count: int) -> tuple[np.ndarray, list[np.ndarray]]:
        set_border(self._scene.render, box)
        alpha, groups = self._passes.render(count)
        expected = (box[3] - box[1], box[2] - box[0])
        if alpha.shape != expected:
            raise LiveHandError(f"Cycles must render {expected} px (height, width), got {alpha.shape}")
        return alpha, groups


def set_border(render: bpy.types.RenderSettings, box: Box) -> None:
    """Render only this part of the image."""
    width, height = render.resolution_x, render.resolution_y
    render.use_border = render.use_crop_to_border = True
    # A thousandth of a pixel keeps the products from falling under a whole number.
    render.border_min_x, render.border_max_x = (box[0] + 1e-3) / width, (box[2] + 1e-3) / width
    render.border_min_y, render.border_max_y = (height - box[3] + 1e-3) / height, (height - box[1] + 1e-3) / height


def _is_cut(alpha: np.ndarray, box: Box, size_px: tuple[int, int]) -> bool:
    """Return whether the hand reaches an edge of the box that is not the image's."""
    edges = (alpha[:, 0], box[0] > 0), (alpha[0], box[1] > 0), (alpha[:, -1], box[2] < size_px[0])
    edges = (*edges, (alpha[-1], box[3] < size_px[1]))
    return any(is_inner and edge.max() > 0 for edge, is_inner in edges)


def write_picture(path: Path, colours: np.ndarray, alpha: np.ndarray, box: Box, size_px: tuple[int, int]) -> None:
    """Write a part [h, w, 3], premultiplied, and its alpha as a half-float OpenEXR of the whole image."""
    picture = np.zeros((size_px[1], size_px[0], 4), np.float16)
    largest = float(np.finfo(np.float16).max)
    picture[box[1] : box[3], box[0] : box[2]] = np.concatenate([np.minimum(colours, largest), alpha[..., None]], -1)
    write_exr(path, {name: picture[..., channel] for channel, name in enumerate("RGBA")})


def is_complete_picture(path: Path, size_px: tuple[int, int]) -> bool:
    """Return whether the OpenEXR file exists, can be decoded and has this size."""
    try:
        return read_exr(path)["A"].shape == (size_px[1], size_px[0])
    except (LiveHandError, KeyError):
        return False

"""All metrics of one view, keyed by their column in scores.csv; docs/make/evaluation.md defines them.

LDR-FLIP of sRGB-encoded images on black, at the package's default of 67 pixels per degree (a 4K display 0.7 m wide,
seen from 0.7 m). 0 means equal, 1 is the largest difference; the metric is the mean of the map.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..capture.capture import Capture, CaptureView
from ..field.rays import camera_tensors
from ..geometry.mesh import PosedMesh, Topology, posed_mesh
from ..hand.model import HandModel
from ..hand.topology import topology_of
from ..records.errors import LiveHandError
from ..records.side import Side
from .breakdown import error_breakdown
from .distances import Distance, distance_of
from .metrics import alpha_iou, difference_box, psnr_db, similarities
from .visible_surface import VisibleSurface, vertex_ambient_occlusion, visible_surface

# Over twice the reach of FLIP's filters (10 px): at this distance from any difference, FLIP is 0.
_MARGIN_PX = 32


def has_flip() -> bool:
    """Tell whether the package is installed."""
    return importlib.util.find_spec("flip_evaluator") is not None


def flip_map(image: Float[Tensor, "H W 3"], truth: Float[Tensor, "H W 3"]) -> Float[Tensor, "H W"]:
    """Compute FLIP per pixel.

    Raises:
        LiveHandError: the package is not installed.
    """
    if not has_flip():
        raise LiveHandError('FLIP needs the package flip-evaluator, got none; pip install "livehand[metrics]"')
    import flip_evaluator

    errors = torch.zeros(image.shape[:2])
    box = difference_box(image.permute(2, 0, 1), truth.permute(2, 0, 1), _MARGIN_PX)
    if box is not None:
        reference, test = (np.ascontiguousarray(x[*box].float().clamp(0, 1).numpy()) for x in (truth, image))
        found, _, _ = flip_evaluator.evaluate(reference, test, "LDR", applyMagma=False, computeMeanError=False)
        errors[*box] = torch.as_tensor(np.array(found[..., 0]))
    return errors


class _Posed(NamedTuple):
    topology: Topology
    mesh: PosedMesh
    ambient_occlusion: Tensor


class PosedHands:
    """The hand of a capture in each of its poses.

    Args:
        hand: the model, of either side.
        sides: the side of each pose.
        vertices: of each pose, [V, 3] m, world.
    """

    def __init__(self, hand: HandModel, sides: Sequence[Side], vertices: Sequence[np.ndarray]):
        self._hand, self._sides, self._vertices = hand, sides, vertices
        self._topologies: dict[Side, Topology] = {}
        self._posed: dict[int, _Posed] = {}

    def visible_to(self, view: CaptureView) -> VisibleSurface:
        """Look at the posed mesh as a view does."""
        posed = self._posed_mesh(view.pose_index)
        return visible_surface(posed.mesh, posed.topology, posed.ambient_occlusion, camera_tensors(view.camera, "cpu"))

    def _posed_mesh(self, index: int) -> _Posed:
        if index not in self._posed:
            side = self._sides[index]
            if side not in self._topologies:
                self._topologies[side] = topology_of(self._hand.for_side(side))
            topology = self._topologies[side]
            mesh = posed_mesh(topology, torch.as_tensor(self._vertices[index], dtype=torch.float32))
            self._posed[index] = _Posed(topology, mesh, vertex_ambient_occlusion(mesh, topology))
        return self._posed[index]


def train_view_angle_deg(
    origin: Float[np.ndarray, 3], train_origins: Float[np.ndarray, "T 3"], hand_centre: Float[np.ndarray, 3]
) -> float:
    """Measure the angle, degrees, at the hand's centre between a camera and the nearest training one; NaN without any.

    Positions are in world space, m. Distance does not count: a close-up along a training camera's axis has angle 0.
    """
    if not len(train_origins):
        return float("nan")
    direction, known = _unit(origin - hand_centre), _unit(train_origins - hand_centre)
    nearest = known[(known @ direction).argmax()]
    # From the chord, because arccos is imprecise at small angles.
    return float(np.degrees(2 * np.arcsin(min(np.linalg.norm(direction - nearest) / 2, 1.0))))


def train_origins(capture: Capture) -> Float[np.ndarray, "T 3"]:
    """List positions of the cameras of the training images, without duplicates, world, m."""
    origins = {tuple(view.camera.origin.round(6)) for view in capture.of_split("train")}
    return np.array(sorted(origins)).reshape(-1, 3)


def train_view_angles_deg(
    capture: Capture, views: Sequence[CaptureView], hand_centres: Float[np.ndarray, "P 3"]
) -> list[float]:
    """Measure the train-view angle of each view, degrees; `hand_centres` are indexed by pose."""
    known = train_origins(capture)
    return [train_view_angle_deg(view.camera.origin, known, hand_centres[view.pose_index]) for view in views]


def _unit(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def view_figures(
    image: np.ndarray, truth: np.ndarray, surface: VisibleSurface, distances: Sequence[Distance] = ()
) -> dict[str, float]:
    """Measure an image [H, W, 4] against the truth; both hold encoded colour times alpha, and alpha.

    FLIP is absent where its package is missing. A metric that is undefined for this image size or hand is NaN.
    """
    ours, true = (torch.as_tensor(x, dtype=torch.float32) for x in (image, truth))
    pair, hand = (ours[..., :3], true[..., :3]), true[..., 3] > 0.5
    figures = {"psnr_full": psnr_db(*pair), "psnr_hand": psnr_db(*pair, hand)}
    for name, found in zip(("ssim", "ms_ssim"), similarities(*pair, hand), strict=True):
        figures[name], figures[f"{name}_hand"] = found
    if has_flip():
        errors = flip_map(*pair)
        figures["flip"], figures["flip_hand"] = float(errors.mean()), float(errors[hand].mean())
    for distance in distances:
        figures[distance.name], figures[f"{distance.name}_hand"] = distance_of(distance, *pair, hand)
    breakdown = error_breakdown(ours, true, surface)
    figures |= {"alpha_iou": alpha_iou(ours[..., 3], true[..., 3]), "psnr_true_alpha": breakdown.psnr_true_alpha}
    figures |= {f"share_{name}": share for name, share in breakdown.share.items()}
    return figures | {f"area_{name}": area for name, area in breakdown.area.items()}

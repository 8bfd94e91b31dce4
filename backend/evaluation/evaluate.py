"""Renders an avatar beside a capture's views and measures the difference."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from ..captures.capture import Capture, CaptureView, Split
from ..hand.lbs import posed_vertices
from ..hand.model import HandModel
from ..nerf.avatar import Avatar
from ..nerf.backend import Precision
from ..records.errors import LiveHandError
from ..records.shot import Frame, Shot
from ..rendering.decode import straight_srgb
from ..rendering.renderer import Renderer
from .distances import Distance
from .figures import view_figures
from .posed_hands import PosedHands
from .train_view_angle import train_view_angles_deg


@dataclass(frozen=True)
class ViewScore:
    """One view's figures, by their column's name."""

    file: str
    split: Split
    camera_index: int
    pose_index: int
    camera_gap_deg: float
    figures: dict[str, float]


class ScoredView(NamedTuple):
    """A score and the two pictures [H, W, 4] (sRGB-encoded colour times alpha, alpha) behind it."""

    score: ViewScore
    truth: np.ndarray
    image: np.ndarray


def scored_views(
    renderer: Renderer,
    capture: Capture,
    views: Sequence[CaptureView],
    distances: Sequence[Distance] = (),
    max_camera_gap_deg: float | None = None,
) -> Iterator[ScoredView]:
    """Render and measure the views one by one; ones in which the hand covers no pixel are left out.

    Args:
        renderer: the avatar's.
        capture: where the views come from.
        views: what to measure.
        distances: perceptual ones, measured beside the rest.
        max_camera_gap_deg: views further from every training camera are left out.

    Raises:
        LiveHandError: the capture is of another hand, or has no training cameras to measure the gap to.
    """
    if capture.hand_sha256 != renderer.hand.sha256:
        raise LiveHandError(f"capture {capture.folder} must be of hand '{renderer.hand.name}', got one of another hand")
    vertices = [posed_vertices(renderer.hand, pose) for pose in capture.poses]
    hands = PosedHands(renderer.hand, [pose.side for pose in capture.poses], vertices)
    gaps = train_view_angles_deg(capture, views, np.array([of_pose.mean(0) for of_pose in vertices]))
    if max_camera_gap_deg is not None and np.isnan(gaps).any():
        raise LiveHandError(f"a camera gap needs training images, capture {capture.folder} has none; leave the gap out")
    limit_deg = np.inf if max_camera_gap_deg is None else max_camera_gap_deg
    chosen = [(view, gap) for view, gap in zip(views, gaps, strict=True) if not gap > limit_deg]
    for view, gap in tqdm(chosen, unit="image", desc="evaluate"):
        truth = capture.read_image(view)
        if (truth[..., 3] > 0.5).any():
            shot = Shot(capture.poses[view.pose_index], vertices[view.pose_index], view.camera)
            image = encoded_on_black(renderer.render(shot))
            figures = view_figures(image, truth, hands.seen_by(view), distances)
            score = ViewScore(view.file, view.split, view.camera_index, view.pose_index, gap, figures)
            yield ScoredView(score, truth, image)


def score_views(
    renderer: Renderer, capture: Capture, views: Iterable[CaptureView], distances: Sequence[Distance] = ()
) -> list[ViewScore]:
    """The figures of all views that show the hand.

    Raises:
        LiveHandError: the capture is of another hand, or none of the views shows it.
    """
    scores = [scored.score for scored in scored_views(renderer, capture, list(views), distances)]
    check_any(scores, capture)
    return scores


def evaluate_views(
    avatar: Avatar,
    hand: HandModel,
    capture: Capture,
    views: Iterable[CaptureView],
    device: str = "auto",
    precision: Precision = "fp32",
    distances: Sequence[Distance] = (),
) -> tuple[list[ViewScore], list[tuple[np.ndarray, np.ndarray]]]:
    """Scores of a few views, and their (truth, ours) pictures as `comparison_sheet` takes them.

    The avatar's networks are left as they were: in training, if they were, and where they were.

    Raises:
        LiveHandError: the avatar or the capture is of another hand, or none of the views shows it.
    """
    networks = (avatar.field, avatar.superres)
    before = [(network.training, next(network.parameters()).device) for network in networks]
    try:
        scored = list(scored_views(Renderer(avatar, hand, device, precision), capture, list(views), distances))
    finally:
        for network, (was_training, was_on) in zip(networks, before, strict=True):
            network.to(was_on).train(was_training)
    check_any(scored, capture)
    return [view.score for view in scored], [(view.truth, view.image) for view in scored]


def check_any(scores: Sequence, capture: Capture) -> None:
    """Refuse an evaluation of nothing.

    Raises:
        LiveHandError: there are no scores.
    """
    if not scores:
        raise LiveHandError(f"capture {capture.folder} must have views of the asked split that show the hand, got none")


def encoded_on_black(frame: Frame) -> np.ndarray:
    """[H, W, 4]: the frame's straight colour sRGB-encoded, times alpha; and alpha."""
    picture = straight_srgb(frame)
    return np.concatenate([picture[..., :3] * picture[..., 3:], picture[..., 3:]], -1)

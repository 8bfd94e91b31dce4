"""Renders a hand in the views of a capture and measures the difference."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from ..avatars.avatar import Avatar
from ..capture.capture import Capture, CaptureView, Split
from ..hand.lbs import posed_vertices
from ..image.decode import straight_srgb
from ..records.errors import LiveHandError
from ..records.frame import Frame
from ..records.light import Light
from ..records.shot import Shot
from ..surface.base_surface import whole_surface
from ..surface.surface_file import surface_sha256
from .contrast_bands import contrast_figures
from .distances import Distance
from .exposure import exposed, exposure_gain, is_reached
from .figures import PosedHands, train_view_angles_deg, view_figures
from .shot_renderer import ShotRenderer


@dataclass(frozen=True)
class ViewScore:
    """One view's metrics, keyed by column; `light_kind` is None in a capture without lights."""

    file: str
    split: Split
    camera_index: int
    pose_index: int
    train_view_angle_deg: float
    figures: dict[str, float]
    light_kind: str | None = None


class ScoredView(NamedTuple):
    """A score and its two images [H, W, 4]: sRGB-encoded colour times alpha, and alpha."""

    score: ViewScore
    truth: np.ndarray
    image: np.ndarray


def scored_views(
    renderer: ShotRenderer,
    capture: Capture,
    views: Sequence[CaptureView],
    distances: Sequence[Distance] = (),
    max_train_view_angle_deg: float | None = None,
    with_contrast: bool = False,
) -> Iterator[ScoredView]:
    """Render and measure the views one by one, but those in which the hand covers no pixel.

    Each view of a lit capture is rendered in its own light and exposed by its truth (`exposure`). One whose light does
    not reach what it shows is skipped, too: a lamp behind the hand, say.

    Args:
        renderer: of what is measured.
        capture: the ground truth.
        views: the capture's views to measure.
        distances: perceptual distances to measure too.
        max_train_view_angle_deg: views with a larger angle to the nearest training camera are skipped.
        with_contrast: measure the contrast by scale too (`contrast_bands`).

    Raises:
        LiveHandError: the capture is of another hand, or has no training cameras to measure the angle to.
    """
    if capture.hand_sha256 != renderer.hand.sha256:
        raise LiveHandError(f"capture {capture.folder} must be of hand '{renderer.hand.name}', got one of another hand")
    vertices = [posed_vertices(renderer.hand, pose) for pose in capture.poses]
    hands = PosedHands(renderer.hand, [pose.side for pose in capture.poses], vertices)
    angles = train_view_angles_deg(capture, views, np.array([of_pose.mean(0) for of_pose in vertices]))
    if max_train_view_angle_deg is not None and np.isnan(angles).any():
        raise LiveHandError(
            f"a limit of the train-view angle needs training images, capture {capture.folder} has none; leave it out"
        )
    limit_deg = np.inf if max_train_view_angle_deg is None else max_train_view_angle_deg
    chosen = [(view, angle) for view, angle in zip(views, angles, strict=True) if not angle > limit_deg]
    for view, angle in tqdm(chosen, unit="image", desc="evaluate"):
        truth = read_truth(capture, view)
        shot = Shot(
            capture.poses[view.pose_index], vertices[view.pose_index], view.camera, _kept(capture.light_of(view))
        )
        if _shows_the_hand(truth, shot):
            truth, image = rendered_pair(renderer, shot, truth, capture.is_lit)
            surface = hands.visible_to(view)
            figures = view_figures(image, truth, surface, distances)
            if with_contrast:
                figures |= contrast_figures(image, truth, surface)
            kind = None if view.light is None else capture.lights[view.light].kind
            score = ViewScore(view.file, view.split, view.camera_index, view.pose_index, angle, figures, kind)
            yield ScoredView(score, truth, image)


def _shows_the_hand(truth: np.ndarray, shot: Shot) -> bool:
    is_seen = bool((truth[..., 3] > 0.5).any())
    return is_seen and (shot.light is None or is_reached(truth, shot.light, shot.vertices))


def spaced_views(views: Sequence[CaptureView], most: int | None) -> Sequence[CaptureView]:
    """Select at most `most` of the views, evenly spaced."""
    if most is None or len(views) <= most:
        return views
    return [views[index * len(views) // most] for index in range(most)]


def read_truth(capture: Capture, view: CaptureView) -> np.ndarray:
    """Read [H, W, 4] of a view, premultiplied: linear colours of a lit capture, encoded ones of another."""
    return capture.read_linear(view) if capture.is_lit else capture.read_image(view)


def rendered_pair(renderer: ShotRenderer, shot: Shot, truth: np.ndarray, is_lit: bool) -> tuple[np.ndarray, np.ndarray]:
    """Render a shot beside its truth [H, W, 4], encoded on black; of a lit capture both are exposed by the truth."""
    frame = renderer.render(shot)
    if not is_lit:
        return truth, encoded_on_black(frame)
    gain = exposure_gain(truth)
    return exposed(truth, gain), exposed(_linear_of(frame), gain)


def shows_other_skin(capture: Capture, avatar: Avatar) -> bool:
    """Tell whether the capture is known to show another surface or skin than the avatar's; False: it is not known."""
    if capture.surface is None or avatar.surface is None:
        return False
    return surface_sha256(whole_surface(avatar.surface)) != capture.surface.sha256


def check_any(scores: Sequence, capture: Capture) -> None:
    """Raise LiveHandError if there are no scores."""
    if not scores:
        raise LiveHandError(
            f"capture {capture.folder} must have views of the requested split that show the hand in its light, got none"
        )


def _linear_of(frame: Frame) -> np.ndarray:
    """Return [H, W, 4] linear premultiplied colour, and alpha."""
    return np.concatenate([frame.rgb, frame.alpha[..., None]], -1)


def encoded_on_black(frame: Frame) -> np.ndarray:
    """Return [H, W, 4] of a frame: its straight colour, sRGB-encoded, times alpha; and alpha."""
    picture = straight_srgb(frame)
    return np.concatenate([picture[..., :3] * picture[..., 3:], picture[..., 3:]], -1)


def _kept(light: Light | None) -> Light | None:
    """Return the light as frames that are kept show it."""
    return None if light is None else replace(light, shadow_quality="fine")

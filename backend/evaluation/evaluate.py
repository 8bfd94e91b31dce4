"""Renders an avatar beside a capture's held-out views and measures the difference."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from statistics import fmean

import numpy as np
import torch
from tqdm import tqdm

from ..capture import Capture, CaptureView, Split
from ..colour import linear_to_srgb
from ..errors import LiveHandError
from ..hand.lbs import posed_vertices
from ..renderer import Renderer
from ..shot import Frame, Shot
from .metrics import alpha_iou, psnr_db, ssim


@dataclass(frozen=True)
class ViewScore:
    """One view's figures, and the two pictures [H, W, 4] (sRGB-encoded colour times alpha, alpha) behind them."""

    file: str
    split: Split
    psnr_full: float
    psnr_hand: float
    ssim: float
    alpha_iou: float
    truth: np.ndarray
    image: np.ndarray


def score_views(renderer: Renderer, capture: Capture, views: Iterable[CaptureView]) -> list[ViewScore]:
    """Render and measure the views; ones in which the hand covers no pixel are left out.

    Raises:
        LiveHandError: the capture is of another hand, or none of the views shows it.
    """
    if capture.hand_sha256 != renderer.hand.sha256:
        raise LiveHandError(f"capture {capture.folder} must be of hand '{renderer.hand.name}', got one of another hand")
    posed = {index: posed_vertices(renderer.hand, pose) for index, pose in enumerate(capture.poses)}
    scores = []
    for view in tqdm(list(views), unit="image", desc="evaluate"):
        truth = capture.read_image(view)
        if (truth[..., 3] > 0.5).any():
            shot = Shot(capture.poses[view.pose_index], posed[view.pose_index], view.camera)
            scores.append(_score(view, encoded_on_black(renderer.render(shot)), truth))
    if not scores:
        raise LiveHandError(f"capture {capture.folder} must have views of the asked split that show the hand, got none")
    return scores


def summary(scores: list[ViewScore]) -> dict[str, float | int]:
    """Mean figures: `images, psnr_full, psnr_hand, ssim, alpha_iou`."""
    names = ("psnr_full", "psnr_hand", "ssim", "alpha_iou")
    means = {name: round(fmean(getattr(score, name) for score in scores), 4) for name in names}
    return {"images": len(scores), **means}


def encoded_on_black(frame: Frame) -> np.ndarray:
    """[H, W, 4]: the frame's straight colour sRGB-encoded, times alpha; and alpha."""
    alpha = frame.alpha[..., None]
    straight = torch.as_tensor(frame.rgb / np.where(alpha > 0, alpha, 1))
    return np.concatenate([linear_to_srgb(straight.clamp(0, 1)).numpy() * alpha, alpha], -1)


def _score(view: CaptureView, image: np.ndarray, truth: np.ndarray) -> ViewScore:
    a, b = torch.as_tensor(image), torch.as_tensor(truth)
    return ViewScore(
        file=view.file,
        split=view.split,
        psnr_full=psnr_db(a[..., :3], b[..., :3]),
        psnr_hand=psnr_db(a[..., :3], b[..., :3], b[..., 3] > 0.5),
        ssim=ssim(a[..., :3], b[..., :3]),
        alpha_iou=alpha_iou(a[..., 3], b[..., 3]),
        truth=truth,
        image=image,
    )

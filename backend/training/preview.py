"""Previews of training: a few held-out views rendered beside the ground truth."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path
from statistics import fmean
from typing import NamedTuple

import numpy as np
import torch

from ..avatars.avatar import Avatar
from ..capture.capture import Capture, CaptureView, Split
from ..evaluation.contact_sheet import comparison_sheet, save_sheet
from ..evaluation.evaluate import read_truth, rendered_pair
from ..evaluation.metrics import psnr_db
from ..hand.lbs import posed_vertices
from ..hand.model import HandModel
from ..records.shot import Shot
from ..render.renderer import Renderer

# The hardest split first; a capture without held-out views is previewed by its training views.
_SPLITS: tuple[Split, ...] = ("test", "novel_pose", "novel_camera", "train")


class PreviewResult(NamedTuple):
    """A contact sheet (ground truth | prediction | error of every view) [H, W, 3] uint8, and mean metrics in dB."""

    sheet: np.ndarray
    metrics: dict[str, float]

    def save(self, path: Path) -> None:
        """Write the sheet; the file is replaced as a whole."""
        save_sheet(self.sheet, path)


class HeldOutPreview:
    """Held-out views of a capture that are rendered repeatedly while an avatar is trained.

    Args:
        capture: of the hand.
        hand: hand model of the avatar.
        device: to render on.
        count: largest number of views, spread over the split.
    """

    def __init__(self, capture: Capture, hand: HandModel, device: torch.device, count: int):
        self._capture, self._hand, self._device, self._count = capture, hand, device, count

    def render(self, avatar: Avatar) -> PreviewResult | None:
        """Render the views with the avatar; None if no view shows the hand. Its networks end up in evaluation mode."""
        if not self._views:
            return None
        renderer = Renderer(avatar, self._hand, str(self._device))
        pairs = [rendered_pair(renderer, shot, truth, self._capture.is_lit) for truth, shot in self._views]
        metrics = [_metrics(truth, image) for truth, image in pairs]
        means = {name: fmean(values[name] for values in metrics) for name in metrics[0]}
        return PreviewResult(comparison_sheet(pairs), means)

    @cached_property
    def _views(self) -> list[tuple[np.ndarray, Shot]]:
        """Ground truth and shot of each view, from the first split that shows the hand."""
        shown = (self._shown(self._capture.of_split(split)) for split in _SPLITS)
        return next((views for views in shown if views), [])

    def _shown(self, views: tuple[CaptureView, ...]) -> list[tuple[np.ndarray, Shot]]:
        found: list[tuple[np.ndarray, Shot]] = []
        for view in (views[index] for index in _spread_order(len(views))):
            truth = read_truth(self._capture, view)
            is_like_first = not found or truth.shape == found[0][0].shape  # all tiles of the sheet have one size
            if is_like_first and (truth[..., 3] > 0.5).any():
                pose = self._capture.poses[view.pose_index]
                light = self._capture.light_of(view)
                found.append((truth, Shot(pose, posed_vertices(self._hand, pose), view.camera, light)))
            if len(found) == self._count:
                break
        return found


def _spread_order(count: int) -> list[int]:
    """Order the indices below `count` so that the first k are spread evenly, for any k (golden ratio sequence)."""
    return np.argsort(np.arange(count) * 0.6180339887498949 % 1, kind="stable").tolist()


def _metrics(truth: np.ndarray, image: np.ndarray) -> dict[str, float]:
    prediction, expected = torch.as_tensor(image[..., :3]), torch.as_tensor(truth[..., :3])
    is_hand = torch.as_tensor(truth[..., 3] > 0.5)
    return {"psnr_full": psnr_db(prediction, expected), "psnr_hand": psnr_db(prediction, expected, is_hand)}

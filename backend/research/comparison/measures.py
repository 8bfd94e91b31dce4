"""What is measured of a fitted method, by the weights that the user has."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from ...capture.capture import Capture, CaptureView, Split
from ...evaluation.distances import Distance
from ...evaluation.evaluate import ViewScore, check_any, scored_views, spaced_views
from ...evaluation.perceptual.vgg import PerceptualLoss
from ...evaluation.report import Summary, by_split
from ...evaluation.shot_renderer import ShotRenderer
from .distributions import Distributions, FeatureNetwork, HandVggFeatures, WholeInceptionFeatures
from .inception import load_inception

GRID_VIEWS = 6


class Measured(NamedTuple):
    """One method in one capture's views.

    Attributes:
        scores: of every view.
        summaries: by split; means of the scores, and distances of distributions.
        pictures: truth and render [H, W, 4] of a few views, evenly spaced.
    """

    scores: list[ViewScore]
    summaries: dict[str, Summary]
    pictures: list[tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class Measures:
    """The networks of the figures; PSNR, SSIM and the silhouette need none.

    Attributes:
        distances: between two images.
        networks: of distributions.
        names: of the weights' files, for provenance.
    """

    distances: tuple[Distance, ...] = ()
    networks: tuple[FeatureNetwork, ...] = ()
    names: tuple[str, ...] = ()

    @classmethod
    def of(
        cls,
        vgg19: PerceptualLoss | None,
        lpips: Sequence[Distance],
        fid_weights: Path | None,
        device: torch.device,
        names: Sequence[str] = (),
    ) -> Measures:
        """Load the measures that the given weights allow.

        Raises:
            LiveHandError: a file is missing or of another network.
        """
        distances = list(lpips)
        networks: list[FeatureNetwork] = []
        if vgg19 is not None:
            distances.insert(0, Distance("vgg19", vgg19, device))
            networks.append(HandVggFeatures(vgg19))
        if fid_weights is not None:
            networks.append(WholeInceptionFeatures(load_inception(fid_weights).to(device)))
        return cls(tuple(distances), tuple(networks), tuple(names))

    def of_renderer(self, renderer: ShotRenderer, capture: Capture, views: Sequence[CaptureView]) -> Measured:
        """Render and measure the views.

        Raises:
            LiveHandError: the capture is of another hand, or no view shows it.
        """
        scores: list[ViewScore] = []
        pictures: list[tuple[np.ndarray, np.ndarray]] = []
        splits = list(dict.fromkeys(view.split for view in views))
        collected = {split: [Distributions(network) for network in self.networks] for split in splits}
        kept = {view.file for view in spaced_views(views, GRID_VIEWS)}
        for scored in scored_views(renderer, capture, views, self.distances):
            scores.append(scored.score)
            for distribution in collected[scored.score.split]:
                distribution.add(scored.truth, scored.image)
            if scored.score.file in kept:
                pictures.append((scored.truth, scored.image))
        check_any(scores, capture)
        summaries = by_split(scores)
        for split, distributions in collected.items():
            for distribution in distributions:
                found = {name: round(value, 6) for name, value in distribution.figures().items()}
                summaries.setdefault(split, {}).update(found)
        return Measured(scores, summaries, pictures)


def held_out_views(capture: Capture, splits: Sequence[Split], most: int | None) -> list[CaptureView]:
    """Select at most `most` views of each split, evenly spaced; splits without views are left out."""
    return [view for split in splits for view in spaced_views(capture.of_split(split), most)]

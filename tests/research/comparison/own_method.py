"""A researcher's own row, in a few lines: the mean colour of the training images on the posed mesh."""

import json
from dataclasses import dataclass

import numpy as np
import torch
from livehand.backend.research.baselines.mesh_wrapping import TexturedMesh
from livehand.backend.research.baselines.method import Fitted


@dataclass(frozen=True)
class MeanColour:
    name: str = "mean_colour"
    label: str = "Mean colour"
    tables: tuple[str, ...] = ("comparison",)
    version: int = 1
    notes: str = "One colour for the whole hand."

    def fit(self, capture, hand, budget, folder, machine):
        views = [capture.read_image(view) for view in capture.of_split("train")]
        colours = np.concatenate([image[image[..., 3] > 0.9] for image in views])[:, :3]
        (folder / "colour.json").write_text(json.dumps(colours.mean(0).tolist()))
        return Fitted(budget.steps, 0.01, 3)

    def load(self, folder, hand, device):
        colour = torch.tensor(json.loads((folder / "colour.json").read_text()))
        return TexturedMesh(hand, colour.expand(8, 8, 3).contiguous(), device)


ROW = MeanColour()
NOT_A_METHOD = object()

"""FLIP (Andersson et al. 2020), by the optional package `flip-evaluator`: the difference seen when alternating images.

LDR-FLIP of sRGB-encoded images on black, at the package's default of 67 pixels per degree (a 4K display 0.7 m wide,
seen from 0.7 m). 0 means equal, 1 is the largest difference; the metric is the mean of the map.
"""

from __future__ import annotations

import importlib.util

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from ..records.errors import LiveHandError
from .metrics import difference_box

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

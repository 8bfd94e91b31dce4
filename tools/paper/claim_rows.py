"""Rows of our default's network that differ in the perceptual loss alone: it learns in minutes what others do not.

`livehand compare --method livehand.tools.paper.claim_rows:NONE` and so on; losses are the paper's, 1 : 1.
"""

from __future__ import annotations

from dataclasses import replace

from ...backend.avatars.avatar import AvatarConfig
from ...backend.image.superres import SuperResConfig
from ...backend.research.baselines.avatar_rows import AvatarRow
from ...backend.training.config import PAPER

_PATCH_PX = 32
_FULL = PAPER.loss
_NONE = replace(_FULL, perceptual=0.0)
_PATCH = replace(_FULL, perceptual_region="patch", perceptual_patch_px=_PATCH_PX)
_WITHOUT_SR = replace(AvatarConfig(), superres=SuperResConfig(kind="none"))


def _row(name: str, label: str, config: AvatarConfig, loss: object) -> AvatarRow:
    return AvatarRow(name, label, ("components",), "Our default's networks, the paper's loss.", config, loss)  # type: ignore[arg-type]


NONE = _row("planes_none", "planes, no perceptual loss", AvatarConfig(), _NONE)
PATCH = _row("planes_patch", "planes, perceptual loss on patches", AvatarConfig(), _PATCH)
FULL = _row("planes_full", "planes, perceptual loss on the full image", AvatarConfig(), _FULL)
SHARP_NONE = _row("planes_no_sr_none", "planes without SR, no perceptual loss", _WITHOUT_SR, replace(_NONE, low_l2=0.0))
SHARP_FULL = _row("planes_no_sr_full", "planes without SR, perceptual, full", _WITHOUT_SR, replace(_FULL, low_l2=0.0))

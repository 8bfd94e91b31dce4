"""Makes the sheet of the people who ship: back, palm and fist of each in one key lamp, exposed for each.

python -m livehand.tools.avatars.sheet PICTURE [AVATAR ...]
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import torch

from ...backend.avatars.avatar import Avatar
from ...backend.avatars.file import load_avatar
from ...backend.avatars.library import AVATAR_HELP, SHIPPED, avatar_path
from ...backend.capture.picture import linear_to_srgb
from ...backend.evaluation.contact_sheet import save_sheet, tile
from ...backend.hand.model_file import load_default_hand
from ...backend.image.srgb import srgb_to_linear
from ..lookdev.sheets import AvatarStudio
from ..lookdev.views import WHOLE_HANDS

_TILE_PX, _FINER = 180, 2  # of a tile, and of the picture that is made small to it
# Views of lookdev: size of a pixel of that picture, and the exposure of deep skin against that of light skin.
_VIEWS = {"open, back": (0.7, 2.2), "open, palm": (0.7, 1.3), "fist, back": (0.46, 2.2)}
_GREY, _CLEAR = 0.12, 1e-3


def people_sheet(avatars: Sequence[Avatar]) -> np.ndarray:
    """Render [H, W, 3] uint8: a column for each avatar."""
    hand = load_default_hand()
    studios = [AvatarStudio.of(avatar, hand) for avatar in avatars]
    tiles = [_tile(studio, view) for view in _VIEWS for studio in studios]
    return tile(tiles, len(studios))


def _tile(studio: AvatarStudio, view: str) -> np.ndarray:
    """Render [P, P, 3] encoded."""
    mm_per_px, exposure_of_deep = _VIEWS[view]
    picture = studio.picture(WHOLE_HANDS[view]._replace(mm_per_px=mm_per_px), _FINER * _TILE_PX)
    surface = studio.renderer.avatar.surface
    deep = 0.0 if surface is None else min(surface.person.melanin, 1.0)
    colour, alpha = picture[..., :3], picture[..., 3:]
    linear = srgb_to_linear(torch.as_tensor(colour / alpha.clip(_CLEAR))).numpy()
    lit = alpha * linear * (1 + (exposure_of_deep - 1) * deep) + _GREY * (1 - alpha)
    return linear_to_srgb(lit.clip(0, 1).reshape(_TILE_PX, _FINER, _TILE_PX, _FINER, 3).mean((1, 3)))


def main() -> None:
    """Write the sheet."""
    parser = argparse.ArgumentParser(description="Make a sheet of back, palm and fist of people.")
    parser.add_argument("picture", type=Path, help="to write")
    parser.add_argument("avatars", nargs="*", type=avatar_path, help=AVATAR_HELP.replace("(default: light)", ""))
    arguments = parser.parse_args()
    paths = arguments.avatars or [avatar_path(name) for name in SHIPPED]
    save_sheet(people_sheet([load_avatar(path) for path in paths]), arguments.picture)


if __name__ == "__main__":
    main()

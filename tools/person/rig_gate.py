"""Makes persons from a rig's pictures of real hands, and prints how near they come to cameras held out.

It runs as `python -m livehand.tools.person.rig_gate FOLDER --held-out 4 9 15 --sheet DIR`.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from PIL import Image

from ...backend.evaluation.perceptual.lpips import load_lpips
from ...backend.hand.model_file import load_default_hand
from ...backend.person.camera_gains import with_camera_gains
from ...backend.person.lit_model.model import PersonModel
from ...backend.person.making import COARSE_ROUND, MakingOptions, RoundOptions, person_of_pictures
from ...backend.person.person_avatar import shipped_bases
from ...backend.person.rig.pictures_of_rig import pictures_of_rig
from ...backend.records.hand_picture import PicturedHand
from ...backend.records.side import Side
from .held_out import Distance, HeldOutFigures, measured


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the gate with the arguments of the command line."""
    args = _parser().parse_args(arguments)
    torch.set_num_threads(args.threads)
    started, distance = time.monotonic(), _lpips(args.lpips)

    def say(line: str) -> None:
        sys.stdout.write(f"[{time.monotonic() - started:5.0f} s] {line}\n")
        sys.stdout.flush()

    hands = with_camera_gains(pictures_of_rig(args.folder, args.held_out, say=say), load_default_hand())
    bases = shipped_bases(load_default_hand())
    for side, hand in hands.items():
        given = replace(hand, offset_m=None) if args.without_offset else hand
        options = MakingOptions(
            (COARSE_ROUND, RoundOptions(args.resolution, levels=True)), fits_poses=not args.without_offset
        )
        person, fitted = person_of_pictures(bases, given, options, say)
        light = person.lights.at(hand.pictures[0])
        for name, one in (("base", person.model.with_ratio(None)), ("person", person.model)):
            _report(f"{side} {name}", side, one, fitted, light, distance, args.sheet, say)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="pictures and calibration of a rig")
    parser.add_argument("--held-out", type=int, nargs="*", default=[4, 9, 15], help="cameras (default: %(default)s)")
    parser.add_argument("--lpips", type=Path, nargs=2, metavar=("NETWORK", "HEADS"), help="files of LPIPS")
    parser.add_argument("--sheet", type=Path, help="folder of pictures beside renders")
    parser.add_argument("--resolution", type=int, default=1024, help="of the atlas (default: %(default)s)")
    parser.add_argument("--threads", type=int, default=2, help="of rendering (default: %(default)s)")
    parser.add_argument("--without-offset", action="store_true", help="keep to the hand model's own shape")
    return parser


def _lpips(files: Sequence[Path] | None) -> Distance | None:
    if files is None:
        return None
    network = load_lpips(files[0], files[1])

    def distance(one: np.ndarray, other: np.ndarray) -> float:
        batch = [torch.as_tensor(image, dtype=torch.float32).permute(2, 0, 1)[None] for image in (one, other)]
        with torch.inference_mode():
            return float(network(*batch))

    return distance


def _report(name: str, side: Side, model: PersonModel, hand: PicturedHand, light, distance, sheet, say) -> None:
    """Print figures of each held-out picture and their means; write pictures beside renders."""
    rows: dict[int, HeldOutFigures] = {}
    for picture in hand.pictures:
        if picture.is_held_out:
            figures, image = measured(model, picture, light, distance)
            rows[picture.camera_index] = figures
            say(f"{name}, camera {picture.camera_index}: {_text(figures)}")
            if sheet is not None:
                sheet.mkdir(parents=True, exist_ok=True)
                pair = np.concatenate([picture.rgb, (255 * image).round().astype(np.uint8)], 1)
                Image.fromarray(pair[:, ::-1] if side == "left" else pair).save(
                    sheet / f"{name.replace(' ', '_')}_{picture.camera_index:02d}.png"
                )
    if rows:
        mask_db, inner_db, iou, lpips = np.mean([row[:4] for row in rows.values()], 0).tolist()
        say(f"{name}, mean: {_text(HeldOutFigures(mask_db, inner_db, iou, lpips, (0.0, 0.0)))}")


def _text(figures: HeldOutFigures) -> str:
    shift = f", moved {figures.shift_px[0]:.1f} {figures.shift_px[1]:.1f} px" if any(figures.shift_px) else ""
    return (
        f"mask {figures.mask_db:.2f} dB, 3 px inside {figures.inner_db:.2f} dB, overlap {figures.iou:.3f}, "
        f"LPIPS {figures.lpips:.3f}{shift}"
    )


if __name__ == "__main__":
    main()

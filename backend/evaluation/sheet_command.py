"""`livehand sheet`: a contact sheet of the frames in a folder."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from ..records.errors import LiveHandError
from ..system.command import Command, parse_count
from ..system.readers import opened_picture
from .contact_sheet import on_background, save_sheet, tile

SHEET_NAME = "contact_sheet.png"


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("folder", type=Path, help="a folder of PNG frames, all of one size")
    parser.add_argument("-o", "--output", type=Path, metavar="FILE", help=f"default: {SHEET_NAME} in the folder")
    parser.add_argument("--columns", type=parse_count, default=8, help="frames side by side (default: %(default)s)")


def _run(args: argparse.Namespace) -> dict:
    output = args.output or args.folder / SHEET_NAME
    paths = sorted(path for path in args.folder.glob("[!.]*.png") if path.name != SHEET_NAME and path != output)
    if not paths:
        raise LiveHandError(f"{args.folder} must hold PNG frames, got none; render them with --format png")
    frames = [read_frame(path) for path in paths]
    sizes = sorted({frame.shape[1::-1] for frame in frames})
    if len(sizes) > 1:
        raise LiveHandError(f"the frames in {args.folder} must be of one size, got {sizes} px")
    try:
        save_sheet(tile([on_background(frame) for frame in frames], args.columns), output)
    except (OSError, ValueError) as error:
        raise LiveHandError(f"the sheet {output} could not be written ({error}); choose another path") from error
    return {"sheet": str(output), "frames": len(frames), "summary": f"{output}: {len(frames)} frames"}


def read_frame(path: Path) -> np.ndarray:
    """Read [H, W, 4] float32 in [0, 1]: encoded colour times alpha, and alpha.

    Raises:
        LiveHandError: the file is not a readable image.
    """
    with opened_picture(path, ("PNG",)) as image:
        pixels = np.asarray(image.convert("RGBA"), np.float32) / 255
    return np.concatenate([pixels[..., :3] * pixels[..., 3:], pixels[..., 3:]], -1)


COMMAND = Command("sheet", "put the PNG frames of a folder on one contact sheet", _add_arguments, _run)

"""Make the film: `python -m livehand.tools.film.make OUT.mp4`; pictures are kept, and a second run goes on."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from ...backend.tracking.video_writer import write_video
from .cut import Cut, FilmSet, captioned
from .cuts import CUTS

_FADE_S = 0.4
_PREVIEWED, _PREVIEW_PX, _PREVIEW_MS = 4, (640, 360), 900  # pictures of a cut


def main(arguments: Sequence[str] | None = None) -> None:
    """Draw every cut, and write them as one film."""
    args = _parser().parse_args(arguments)
    args.output.parent.mkdir(parents=True, exist_ok=True)
    film_set = FilmSet((args.width, args.width * 9 // 16), args.rate, args.folder or args.output.with_suffix(""))
    cuts = [cut for cut in CUTS if not args.only or cut.name in args.only]
    pictures = [_drawn(cut, film_set) for cut in cuts]
    count = sum(map(len, pictures))
    write_video(_faded(pictures, round(_FADE_S * args.rate)), args.output, np.arange(count) / args.rate, args.rate)
    if args.preview:
        _write_preview(pictures, args.preview)
    sys.stdout.write(f"{args.output}: {count / args.rate:.0f} s, {args.output.stat().st_size / 1e6:.1f} MB\n")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("output", type=Path)
    parser.add_argument("--folder", type=Path, help="keeps pictures (default: beside the film)")
    parser.add_argument("--width", type=int, default=960, help="px; 16:9 (default: 960)")
    parser.add_argument("--rate", type=float, default=24, help="pictures a second (default: 24)")
    parser.add_argument(
        "--preview", type=Path, metavar="FILE.webp", help="also a small moving picture of it, for README"
    )
    parser.add_argument("--only", nargs="+", choices=[cut.name for cut in CUTS], help="these cuts")
    return parser


def _drawn(cut: Cut, film_set: FilmSet) -> list[Path]:
    """Draw the pictures of a cut that are not there yet; returns all in order."""
    folder = film_set.folder / cut.name
    folder.mkdir(parents=True, exist_ok=True)
    count = round(cut.seconds * film_set.rate)
    paths = [folder / f"{film_set.size_px[0]}_{count:05}_{index:05}.png" for index in range(count)]
    missing = [index for index, path in enumerate(paths) if not path.exists()]
    draw = cut.prepare(film_set) if missing else None
    for index in missing:
        assert draw is not None
        picture = Image.fromarray(captioned(draw(index / count), cut.caption))
        picture.save(paths[index].with_suffix(".part"), "PNG")
        paths[index].with_suffix(".part").rename(paths[index])
    sys.stdout.write(f"{cut.name}: {count} pictures\n")
    return paths


def _faded(cuts: list[list[Path]], fade: int) -> Iterator[np.ndarray]:
    """Read the pictures of all cuts in order; each cut comes out of black and goes into it."""
    for paths in cuts:
        for index, path in enumerate(paths):
            share = min(1.0, (index + 1) / (fade + 1), (len(paths) - index) / (fade + 1))
            yield (np.asarray(Image.open(path)) * share).round().astype(np.uint8)


def _write_preview(cuts: list[list[Path]], path: Path) -> None:
    """Show some pictures of each cut, small and for a second each."""
    chosen = [paths[(2 * index + 1) * len(paths) // (2 * _PREVIEWED)] for paths in cuts for index in range(_PREVIEWED)]
    first, *others = [Image.open(one).resize(_PREVIEW_PX, Image.Resampling.LANCZOS) for one in chosen]
    first.save(path, save_all=True, append_images=others, duration=_PREVIEW_MS, loop=0, quality=60, method=6)


if __name__ == "__main__":
    main()

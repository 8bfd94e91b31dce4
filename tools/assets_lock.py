"""Check or renew `assets.lock`, the list of large files in git: `python tools/assets_lock.py [--update] [FILE ...]`.

No file over 500 kB enters git unless it stands in that list with its SHA-256: every version of it stays in the history
forever and is in every full clone. A line is `SHA-256 BYTES PATH`. Without FILE, all files that git tracks are checked;
the pre-commit hook names those of a commit. `--update` writes the list anew from the working tree: do it when a release
brings other files, not for every training.
"""

from __future__ import annotations

import argparse
import hashlib
import subprocess
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
LOCK = "assets.lock"
LIMIT_BYTES = 500_000
REMEDY = (
    "make it smaller, keep it out of git (out/ is ignored), or, for a release: python tools/assets_lock.py --update"
)


class Asset(NamedTuple):
    """A large file in git: the SHA-256 of its content, its size, and its path from the root, with slashes."""

    sha256: str
    size_bytes: int
    path: str


def main(arguments: list[str] | None = None) -> int:
    """Check or renew the list; return the exit code."""
    parser = argparse.ArgumentParser(description="check or renew the list of large files in git")
    parser.add_argument("--update", action="store_true", help="write the list anew")
    parser.add_argument("--root", type=Path, default=ROOT, help="the repository (default: this one)")
    parser.add_argument("files", nargs="*", metavar="FILE", help="check only these (default: all that git tracks)")
    args = parser.parse_args(arguments)
    if args.update:
        assets = [read_asset(args.root, path) for path in large_files(args.root, tracked_files(args.root))]
        (args.root / LOCK).write_text(
            "".join(f"{' '.join(map(str, asset))}\n" for asset in assets), "utf-8", newline="\n"
        )
        return 0
    faults = find_faults(args.root, args.files or None)
    sys.stderr.write("".join(f"{fault}\n" for fault in faults))
    return 1 if faults else 0


def find_faults(root: Path, files: Iterable[str] | None = None) -> list[str]:
    """Return a sentence for every large file that is not listed as it is, and for every listed one that git lacks.

    `files`: paths from the root to check; None: all that git tracks, and the list itself.
    """
    listed = {asset.path: asset for asset in read_lock(root)}
    tracked = tracked_files(root)
    faults = []
    for path in large_files(root, tracked if files is None else files):
        asset = read_asset(root, path)
        if path not in listed:
            faults.append(
                f"{path} must have at most {LIMIT_BYTES:,} bytes or stand in {LOCK}, got {asset.size_bytes:,}: {REMEDY}"
            )
        elif asset != listed[path]:
            faults.append(
                f"{path} must be the file that {LOCK} lists ({listed[path].sha256}), got {asset.sha256}: {REMEDY}"
            )
    gone = sorted(set(listed) - set(tracked)) if files is None else []
    return faults + [f"{path} stands in {LOCK} and must be tracked by git, got none: {REMEDY}" for path in gone]


def read_lock(root: Path) -> list[Asset]:
    """Return the listed files.

    Raises:
        ValueError: a line is not `SHA-256 BYTES PATH`.
    """
    assets = []
    for number, text in enumerate((root / LOCK).read_text(encoding="utf-8").splitlines(), 1):
        parts = text.split(" ", 2)
        if len(parts) != 3 or len(parts[0]) != 64 or not parts[1].isdecimal():
            raise ValueError(f"{LOCK}, line {number} must be `SHA-256 BYTES PATH`, got {text!r}")
        assets.append(Asset(parts[0], int(parts[1]), parts[2]))
    return assets


def read_asset(root: Path, path: str) -> Asset:
    """Return a file as the list would name it."""
    content = (root / path).read_bytes()
    return Asset(hashlib.sha256(content).hexdigest(), len(content), path)


def large_files(root: Path, files: Iterable[str]) -> list[str]:
    """Return those of the files that are over the limit, by name; a file deleted from the working tree is none."""
    present = (path for path in sorted(files) if (root / path).is_file())
    return [path for path in present if (root / path).stat().st_size > LIMIT_BYTES]


def tracked_files(root: Path) -> list[str]:
    """Return the paths of all files that git tracks or that are staged."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=root, capture_output=True, check=True)
    return [path.decode() for path in listed.stdout.split(b"\0") if path]


if __name__ == "__main__":
    sys.exit(main())

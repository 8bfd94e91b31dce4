"""Write the tables of docs/results and of the README from docs/results/data: `python -m livehand.tools.results.write`.

A table stands between two comments, `<!-- table: NAME -->` and `<!-- end -->`, and what is between them is replaced.
NAME is one of `TABLES`, or `FILE.TABLE` for figures that were measured once and are kept in `data/FILE.json`. With
`--check` nothing is changed, and the exit code is 1 where a page and the data disagree.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from . import tables

ROOT = Path(__file__).parents[2]
DATA = Path("docs/results/data")
PAGES = (
    "README.md",
    "docs/use/install.md",
    "docs/results/speed.md",
    "docs/results/quality.md",
    "docs/results/comparison.md",
    "docs/results/paper.md",
    "docs/results/rigs.md",
)
BLOCK = re.compile(r"(<!-- table: ([\w.-]+) -->\n)(.*?)(<!-- end -->)", re.DOTALL)
OPENING = re.compile(r"<!-- table:")

Documents = Mapping[str, Any]
TABLES: dict[str, Callable[[Documents], list[str]]] = {
    "machine": lambda of: tables.machine(of["benchmark"]),
    "frames": lambda of: tables.frames(of["benchmark"]),
    "ratios": lambda of: tables.ratios(of["benchmark"]),
    "stages": lambda of: tables.stages(of["benchmark"]),
    "people": lambda of: tables.people(of["avatars"]),
    "splits": lambda of: tables.splits(of["avatars"]),
    "contrast": lambda of: tables.contrast(of["avatars"]),
    "zips": lambda of: tables.zips(of["release"]),
    "round_trips": lambda of: tables.round_trips(of["round_trips"]),
    "summary": lambda of: tables.summary(of["against_cycles"], of["avatars"], of["benchmark"], of["idle"]),
}


def rewrite(page: str, documents: Documents) -> str:
    """Return a page with all of its tables written again from the documents (name of the file -> its content).

    Raises:
        ValueError: a table has no end, or no document or function makes one of that name.
    """
    if len(BLOCK.findall(page)) != len(OPENING.findall(page)):
        raise ValueError("each `<!-- table: NAME -->` needs an `<!-- end -->` of its own after it")
    return BLOCK.sub(lambda found: f"{found[1]}{table(found[2], documents)}\n{found[4]}", page)


def table(name: str, documents: Documents) -> str:
    """Return one table's Markdown.

    Raises:
        ValueError: nothing makes a table of that name.
    """
    file, _, key = name.partition(".")
    if name in TABLES:
        return "\n".join(TABLES[name](documents))
    if key and key in documents.get(file, {}).get("tables", {}):
        return "\n".join(tables.recorded(documents[file], key))
    raise ValueError(f"a table's name must be one of {', '.join(TABLES)} or FILE.TABLE of {DATA}, got {name!r}")


def read_documents(folder: Path) -> dict[str, Any]:
    """Return the JSON files of a folder by their names without the suffix."""
    return {path.stem: json.loads(path.read_text(encoding="utf-8")) for path in sorted(folder.glob("*.json"))}


def main(arguments: list[str] | None = None) -> int:
    """Write all pages, or check them; return the exit code."""
    parser = argparse.ArgumentParser(description="write the tables of docs/results from its JSON files")
    parser.add_argument("--check", action="store_true", help="change nothing; exit with 1 if a page would change")
    parser.add_argument("--root", type=Path, default=ROOT, help="the repository (default: this one)")
    args = parser.parse_args(arguments)
    documents = read_documents(args.root / DATA)
    before = {page: (args.root / page).read_text(encoding="utf-8") for page in PAGES}
    after = {page: rewrite(text, documents) for page, text in before.items()}
    stale = [page for page in PAGES if after[page] != before[page]]
    for page in [] if args.check else stale:
        (args.root / page).write_text(after[page], encoding="utf-8")
    sys.stdout.write(f"{'out of date' if args.check else 'written'}: {', '.join(stale) or 'nothing'}\n")
    return 1 if args.check and stale else 0


if __name__ == "__main__":
    sys.exit(main())

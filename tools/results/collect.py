"""Collect figures from LiveHand's own commands into docs/results/data.

    python -m livehand.tools.results.collect avatars                     # headers of the avatars that ship; seconds
    python -m livehand.tools.results.collect benchmark [OPTIONS]         # `livehand benchmark`; minutes
    python -m livehand.tools.results.collect release                     # the zips in dist/release; seconds
    python -m livehand.tools.results.collect round_trips                 # a nightly test on twelve rigs; minutes

OPTIONS are those of `livehand benchmark`. Each file says by which command it was made, when, and at which commit.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

from ...backend.avatars.library import SKINS, shipped_avatar_path
from .tables import SPLITS
from .write import DATA, ROOT

ROUND_TRIPS = "tests/blender/test_round_trips.py"


def main() -> int:
    """Run the commands of one kind of figures and write their file; return the exit code."""
    parser = argparse.ArgumentParser(description="collect figures from LiveHand's own commands")
    parser.add_argument("what", choices=("avatars", "benchmark", "release", "round_trips"))
    args, options = parser.parse_known_args()
    collectors = {"avatars": collect_avatars, "release": collect_release, "round_trips": collect_round_trips}
    document = collectors[args.what]() if args.what in collectors else collect_benchmark(options)
    path = ROOT / DATA / f"{args.what}.json"
    news = keep(document, path)
    sys.stdout.write(f"{'written' if news else 'as before'}: {path.relative_to(ROOT)}\n")
    return 0


def keep(document: dict[str, Any], path: Path) -> bool:
    """Write a document unless its file has the same figures, of whatever day; return whether it was written."""
    before = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    if before | {"source": None} == document | {"source": None}:
        return False
    path.write_text(json.dumps(document, indent=1) + "\n", encoding="utf-8")
    return True


def collect_avatars() -> dict[str, Any]:
    """Inspect the avatars that ship."""
    paths = {skin: shipped_avatar_path(skin) for skin in SKINS}
    people = {skin: describe(run(["inspect", str(path)]), path) for skin, path in paths.items()}
    return {"source": source("`livehand inspect` of the avatars that ship"), "people": people}


def collect_release() -> dict[str, Any]:
    """Measure the zips that `make release` has built: what they are for, and their megabytes."""
    zips = {
        path.stem.split("-", 2)[2]: round(path.stat().st_size / 1e6, 1)
        for path in sorted((ROOT / "dist" / "release").rglob("*.zip"))
    }
    return {"source": source("`make release`"), "zips": zips}


def collect_round_trips() -> dict[str, Any]:
    """Run the test that sends a motion to twelve rigs and bakes it back, and keep what it recorded of each.

    Raises:
        CalledProcessError: a rig loses something; pytest has shown what.
    """
    begun = source(f"`pytest -m nightly {ROUND_TRIPS}`")
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder) / "report.xml"
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-q",
            "-m",
            "nightly",
            ROUND_TRIPS,
            "-o",
            "junit_family=xunit1",
            f"--junitxml={report}",
        ]
        subprocess.run(command, cwd=ROOT, check=True)
        rigs = recorded_cases(report.read_text(encoding="utf-8"))
    return {"source": begun, "rigs": rigs}


def recorded_cases(report: str) -> list[dict[str, Any]]:
    """Return the properties that each test of a JUnit report recorded."""
    cases = ElementTree.fromstring(report).iter("testcase")
    properties = ({one.attrib["name"]: one.attrib["value"] for one in case.iter("property")} for case in cases)
    return [{name: number_of(value) for name, value in of.items()} for of in properties if of]


def number_of(text: str) -> float | str:
    """Return a text's number, to four decimals, or else the text."""
    try:
        return round(float(text), 4)
    except ValueError:
        return text


def describe(header: Mapping[str, Any], path: Path) -> dict[str, Any]:
    """Return what the pages use of an avatar's header (`livehand inspect --json`), and its file's size and SHA-256."""
    provenance = header["provenance"]
    splits = {name: figures for name, figures in header["metrics"].items() if name in SPLITS}
    return {
        "sha256": hashlib.sha256(path.read_bytes()).hexdigest(),
        "bytes": path.stat().st_size,
        "person": provenance["capture"]["plan"]["person"],
        "licence": provenance["licence"],
        "trainings": trainings_of(provenance),
        "metrics": splits,
    }


def trainings_of(provenance: Mapping[str, Any]) -> int:
    """Return how many trainings an avatar went through, each of which began with the weights of the one before."""
    before = provenance.get("fine_tuned_from")
    return 1 + (trainings_of(before["provenance"]) if before else 0)


def collect_benchmark(options: list[str]) -> dict[str, Any]:
    """Run the benchmark."""
    begun = source(f"`{' '.join(['livehand benchmark', *options])}`")
    return {"source": begun, "result": run(["benchmark", *options])}


def run(arguments: list[str]) -> dict[str, Any]:
    """Run a command of LiveHand, show its messages, and return the JSON of its last line.

    Raises:
        CalledProcessError: the command failed; its message has been shown.
    """
    command = [sys.executable, "-m", "livehand.livehand_blender", *arguments, "--json"]
    last = "{}"
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        for text in process.stdout or ():
            if not text.startswith("{"):
                sys.stdout.write(text)
                sys.stdout.flush()
            last = text
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return json.loads(last)


def source(what: str) -> dict[str, str]:
    """Return what a document says of where it is from."""
    commit = subprocess.run(
        ["git", "rev-parse", "--short", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
    )
    return {"what": what, "date": datetime.now(UTC).date().isoformat(), "commit": commit.stdout.strip()}


def joined(sources: Sequence[Mapping[str, str]]) -> dict[str, str]:
    """Return where figures of several runs are from: the last one's words and day, and each commit once."""
    commits = dict.fromkeys(one["commit"] for one in sources)
    last = max(sources, key=lambda one: one["date"])
    return {**last, "commit": ", ".join(commits)}


if __name__ == "__main__":
    sys.exit(main())

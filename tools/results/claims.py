"""Measure again what README and docs/results say: `python -m livehand.tools.results.claims [--strict] [PART ...]`.

Each part of docs/results/data that a command gives is collected anew, in memory, and compared with what the pages show,
figure by figure. A difference of more than 5 % is a drift, and the exit code 1. What cannot be compared here (times of
another machine, or of a busy one) or has no command that makes it again is listed with the reason; with `--strict` that
fails, too.
"""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from . import write
from .collect import collect_avatars, collect_benchmark, collect_release, collect_round_trips
from .write import BLOCK, DATA, PAGES, ROOT, TABLES, read_documents

MOST = 0.05
_COMMAND = re.compile(r"`livehand benchmark ([^`]*)`")
_NUMBER = re.compile(r"-?\d[\d,]*(?:\.\d+)?")
_MOST_LOST = {"bones": 1.0, "joints_deg": 0.1, "wrist_mm": 1.0, "keys": 1.0}
_SAME_MACHINE = ("cpu", "threads", "numba", "avx512_vnni", "avx512_bf16", "amx")


@dataclass
class Outcome:
    """What came of one part.

    Attributes:
        compared: figures that were measured again.
        drifts: of those, the ones that have changed, in words.
        unmeasured: what could not be compared, and why.
    """

    compared: int = 0
    drifts: list[str] = field(default_factory=list)
    unmeasured: list[str] = field(default_factory=list)

    def compare(self, name: str, shown: Any, found: Any, scale: float | None = None) -> None:
        """Compare what is shown with what was found: numbers by their difference, all else by its equality.

        Args:
            name: of the figure, for people.
            shown: a number, a text, or lists and mappings of them.
            found: the same, of now.
            scale: that a difference is a share of; None: what is shown.
        """
        if isinstance(shown, Mapping) and isinstance(found, Mapping):
            for key in dict.fromkeys((*shown, *found)):
                self.compare(f"{name} {key}", shown.get(key), found.get(key), scale)
        elif isinstance(shown, list) and isinstance(found, list) and len(shown) == len(found):
            for index, pair in enumerate(zip(shown, found, strict=True)):
                self.compare(f"{name} {index + 1}", *pair, scale)
        else:
            self.compared += 1
            if not _holds(shown, found, scale):
                self.drifts.append(f"{name}: {shown} is shown, {found} was found")


def _holds(shown: Any, found: Any, scale: float | None) -> bool:
    numbers = [isinstance(one, int | float) and not isinstance(one, bool) for one in (shown, found)]
    if not all(numbers):
        return shown == found
    return abs(found - shown) <= MOST * abs(shown if scale is None else scale)


def avatars(documents: Mapping[str, Any]) -> Outcome:
    """Compare the headers of the avatars that ship."""
    outcome = Outcome()
    outcome.compare("avatar", documents["avatars"]["people"], collect_avatars()["people"])
    return outcome


def benchmark(documents: Mapping[str, Any]) -> Outcome:
    """Compare the benchmark: ratios and processor time on this kind of machine, times if it was idle both times."""
    shown = documents["benchmark"]
    found = collect_benchmark(options_of(shown["source"]["what"]))["result"]
    outcome = Outcome()
    if stranger := other_machine(shown["result"]["machine"], found["machine"]):
        outcome.unmeasured.append(f"benchmark: {stranger}")
        return outcome
    is_busy = shown["result"]["machine"]["busy"] or found["machine"]["busy"]
    if is_busy:
        outcome.unmeasured.append("benchmark's milliseconds: the machine is busy now, or was when they were measured")
    for size, of in shown["result"]["sizes"].items():
        _compare_size(outcome, size, of, found["sizes"].get(size, {}), is_busy)
    return outcome


def _compare_size(
    outcome: Outcome, size: str, shown: Mapping[str, Any], found: Mapping[str, Any], is_busy: bool
) -> None:
    for key in ("coverage", "ratio_paper", "ratio_paper_bf16", "ratio_paper_fp32", "ratio_cycles", "peak_mb"):
        outcome.compare(f"{size} {key}", shown.get(key), found.get(key))
    for key in ("core_s", *([] if is_busy else ["frame_ms"])):
        for name, spread in shown[key].items():
            median = found.get(key, {}).get(name, {}).get("median")
            outcome.compare(f"{size} {name} {key}", spread["median"], median)
    for name, stages in {} if is_busy else shown["stages"].items():  # a stage's share of the frame, as some are tiny
        times, others = ({stage: one["ms"] for stage, one in of.items()} for of in (stages, found["stages"][name]))
        outcome.compare(f"{size} {name} stage", times, others, shown["frame_ms"][name]["median"])


def idle(documents: Mapping[str, Any]) -> Outcome:
    """Compare the times that were kept of an idle machine, of which the README shows two."""
    table = documents["idle"]["tables"]["frames"]
    result = collect_benchmark(options_of(table["source"]["what"]))["result"]
    outcome = Outcome()
    if result["machine"]["busy"]:
        outcome.unmeasured.append("idle.frames: the machine is busy")
        return outcome
    if not result["machine"]["avx512_vnni"] or result["machine"]["threads"] != 2:
        outcome.unmeasured.append("idle.frames: the machine must have AVX-512, and two threads")
        return outcome
    for row in table["rows"]:
        of = result["sizes"].get(row[0], {})
        found = [
            *(of.get("frame_ms", {}).get(name, {}).get("median") for name in ("default_bf16", "default_fp32")),
            *(1000 * of["core_s"][name]["median"] for name in ("default_bf16", "default_fp32")),
            *(of["ratio_paper"].get(name) for name in ("bf16", "fp32")),
        ]
        for column, cell, value in zip(table["columns"][1:], row[1:], found, strict=True):
            if number := _NUMBER.match(cell):
                outcome.compare(f"idle {row[0]}, {column}", float(number[0].replace(",", "")), value)
    return outcome


def release(documents: Mapping[str, Any]) -> Outcome:
    """Compare the sizes of the zips, if `make release` has built them."""
    shown, found = documents["release"]["zips"], collect_release()["zips"]
    outcome = Outcome()
    for name in shown:
        if name in found:
            outcome.compare(f"zip {name}", shown[name], found[name])
        else:
            outcome.unmeasured.append(f"zip {name}: not in dist/release; make release")
    return outcome


def round_trips(documents: Mapping[str, Any]) -> Outcome:
    """Compare what rigs lose of a motion; differences count as shares of what they may lose."""
    outcome = Outcome()
    both = documents["round_trips"]["rigs"], collect_round_trips()["rigs"]
    shown, found = ({(one["rig"], one["side"]): one for one in rigs} for rigs in both)
    for key, one in shown.items():
        for name, scale in _MOST_LOST.items():
            outcome.compare(f"{' '.join(key)} {name}", one[name], found.get(key, {}).get(name), scale)
    return outcome


PARTS: dict[str, Callable[[Mapping[str, Any]], Outcome]] = {
    "avatars": avatars,
    "release": release,
    "benchmark": benchmark,
    "idle": idle,
    "round_trips": round_trips,
}


def by_hand(documents: Mapping[str, Any]) -> Iterator[str]:
    """List the tables on the pages that no command of this module makes again, with what made them."""
    for page in PAGES:
        for _, name, _, _ in BLOCK.findall((ROOT / page).read_text(encoding="utf-8")):
            file, _, key = name.partition(".")
            if name not in TABLES and file not in PARTS:
                yield f"{name}: {documents[file]['tables'][key]['source']['what']}"


def options_of(what: str) -> list[str]:
    """Return the options of the benchmark that a source names."""
    found = _COMMAND.search(what)
    if found is None:
        raise ValueError(f"a source must name `livehand benchmark ...`, got {what!r}")
    return shlex.split(found[1])


def other_machine(shown: Mapping[str, Any], found: Mapping[str, Any]) -> str:
    """Return what tells two machines apart; empty: times can be compared."""
    differing = [
        f"{key} {shown.get(key)}, here {found.get(key)}" for key in _SAME_MACHINE if shown.get(key) != found.get(key)
    ]
    return f"measured on another machine ({'; '.join(differing)})" if differing else ""


def main(arguments: Sequence[str] | None = None) -> int:
    """Measure the parts that are asked for, print what came of them, and return the exit code."""
    parser = argparse.ArgumentParser(description="measure the figures of README and docs/results again")
    parser.add_argument("parts", nargs="*", choices=[[], *PARTS], help="which (default: all)")
    parser.add_argument("--strict", action="store_true", help="fail if a figure could not be measured")
    args = parser.parse_args(arguments)
    documents = read_documents(ROOT / DATA)
    outcome = Outcome(drifts=["the pages are not those of the data: make results"] if write.main(["--check"]) else [])
    for name in args.parts or PARTS:
        part = PARTS[name](documents)
        outcome.compared += part.compared
        outcome.drifts += part.drifts
        outcome.unmeasured += part.unmeasured
    outcome.unmeasured += [] if args.parts else by_hand(documents)
    lines = [f"drifted: {line}" for line in outcome.drifts] + [f"not measured: {line}" for line in outcome.unmeasured]
    lines.append(f"{outcome.compared} figures measured, {len(outcome.drifts)} drifted by more than {100 * MOST:.0f} %")
    sys.stdout.write("\n".join(lines) + "\n")
    return 1 if outcome.drifts or (args.strict and outcome.unmeasured) else 0


if __name__ == "__main__":
    sys.exit(main())

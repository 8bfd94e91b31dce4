"""Markdown tables of results. Every function is pure: documents of docs/results/data in, the lines of one table out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from statistics import fmean
from typing import Any

Document = Mapping[str, Any]
Row = Sequence[str]

REFERENCE = "334x512"
CONFIGURATIONS = ("default_bf16", "default_fp32", "paper_bf16", "paper_fp32", "published", "cycles_16", "cycles_64")
SPLITS = {
    "novel_light": "light",
    "novel_camera": "camera and light",
    "novel_pose": "pose and light",
    "test": "pose, camera and light",
}
BANDS = {"l_1_2": "1 to 2 mm", "l_2_4": "2 to 4 mm", "l_4_8": "4 to 8 mm", "l_8_16": "8 to 16 mm"}
LIGHTS = {"soft": "soft", "key": "key", "rim": "rim", "block": "beside walls"}
NOTHING = ""


def markdown(head: Row, rows: Sequence[Row], is_text: bool = False) -> list[str]:
    """Return the lines of a Markdown table; columns but the first are aligned to the right, unless they are text."""
    return [line(head), line(["---", *["---" if is_text else "---:"] * (len(head) - 1)]), *map(line, rows)]


def line(cells: Row) -> str:
    """Return one line of a Markdown table, from the text of its cells."""
    return " ".join(["|", *(f"{cell} |" if cell else "|" for cell in cells)])


def origin(source: Mapping[str, str]) -> list[str]:
    """Return the paragraph below a table that says where its figures are from."""
    return [NOTHING, f"*{source['what']} ({source['date']}, commit {source['commit']}).*"]


def recorded(document: Document, name: str) -> list[str]:
    """Return a table that was measured once and is kept as it was: `tables.NAME` of its document."""
    table = document["tables"][name]
    rows = [[cell if isinstance(cell, str) else f"{cell:,}" for cell in row] for row in table["rows"]]
    return markdown(table["columns"], rows, table.get("is_text", False)) + origin(table["source"])


def machine(benchmark: Document) -> list[str]:
    """Return the machine of a benchmark, its measured peaks and what else ran on it."""
    of, peaks = benchmark["result"]["machine"], benchmark["result"]["machine"]["peaks"]
    software = [f"{name} {of[name]}" for name in ("python", "torch")]
    rows = [
        ["processor", f"{of['cpu']}, {of['cores']} cores, {of['threads']} threads used"],
        ["instructions", ", ".join(name for name in ("avx512_vnni", "avx512_bf16", "amx") if of.get(name)) or "AVX2"],
        ["software", ", ".join([*software, "numba" if of["numba"] else "no numba"])],
        ["peaks", f"{peaks['fp32_tflops']} TFLOP/s fp32, {peaks['bf16_tflops']} bf16, {peaks['int8_tflops']} int8"],
        ["bandwidth", f"{peaks['gb_per_s']} GB/s"],
        ["programs that wanted a core in the minute before", f"{of['load_before']}{', busy' if of['busy'] else ''}"],
    ]
    return [line(["machine", NOTHING]), line(["---", "---"]), *map(line, rows), *origin(benchmark["source"])]


def frames(benchmark: Document) -> list[str]:
    """Return one row for every size and configuration: wall time, processor time and memory of a frame."""
    head = ["size (hand's share)", "configuration", "ms, median", "10 % to 90 %", "core-ms", "MB", "frames"]
    rows = []
    for size, of in benchmark["result"]["sizes"].items():
        for name in (name for name in CONFIGURATIONS if name in of["frame_ms"]):
            ms, mb = of["frame_ms"][name], of["peak_mb"].get(name)
            rows.append(
                [
                    f"{size} ({100 * of['coverage']:.1f} %)",
                    f"`{name}`",
                    digits(ms["median"]),
                    f"{digits(ms['p10'])} to {digits(ms['p90'])}",
                    digits(1000 * of["core_s"][name]["median"]),
                    NOTHING if mb is None else f"{mb:.0f}",
                    str(of["frames"][name]),
                ]
            )
    return markdown(head, rows)


def ratios(benchmark: Document) -> list[str]:
    """Return how many times faster the default is than the paper's renderer and than Cycles, frame by frame."""
    of = benchmark["result"]["sizes"][REFERENCE]
    compared = {"the paper's renderer as published": of["ratio_paper"]}
    compared |= {f"Cycles, {samples} samples": ratio for samples, ratio in of["ratio_cycles"].items()}
    rows = [[name, times(ratio.get("bf16")), times(ratio.get("fp32"))] for name, ratio in compared.items() if ratio]
    same = [times(of[f"ratio_paper_{precision}"]) for precision in ("bf16", "fp32")]
    rows.append(["the paper's networks in our renderer, same precision", *same])
    return markdown([f"faster than, at {REFERENCE}", "bf16", "fp32"], rows)


def stages(benchmark: Document) -> list[str]:
    """Return the time of every stage of a frame at the reference size, with its floor on that machine."""
    of = benchmark["result"]["sizes"][REFERENCE]
    names = list(dict.fromkeys(stage for name in ("default_bf16", "published") for stage in of["stages"].get(name, {})))
    head = ["stage", "bf16, ms", "core-ms", "floor", "times", "fp32, ms", "floor", "times", "published, ms"]
    rows = []
    for stage in names:
        row = [f"`{stage}`", cell(of, "stages", "default_bf16", stage, "ms")]
        row.append(cell(of, "stages", "default_bf16", stage, "core_s", scale=1000))
        row += [cell(of, key, "default_bf16", stage) for key in ("floor_ms", "over_floor")]
        row.append(cell(of, "stages", "default_fp32", stage, "ms"))
        row += [cell(of, key, "default_fp32", stage) for key in ("floor_ms", "over_floor")]
        rows.append([*row, cell(of, "stages", "published", stage, "ms")])
    return markdown(head, rows)


def people(avatars: Document) -> list[str]:
    """Return the persons of the shipped avatars as numbers, and their files."""
    rows = {
        "melanin": lambda one: one["person"]["melanin"],
        "blood": lambda one: one["person"]["blood"],
        "freckles": lambda one: one["person"]["freckles"],
        "veins, mm": lambda one: one["person"]["veins_mm"],
        "folds": lambda one: one["person"]["folds"],
        "shape, greatest of beta": lambda one: max(one["person"]["beta"], key=abs, default=0.0),
        "trainings in a row": lambda one: one["trainings"],
        "views in the header": lambda one: sum(one["metrics"][split]["images"] for split in SPLITS),
        "file, MB": lambda one: round(one["bytes"] / 1e6, 1),
        "licence": lambda one: one["licence"],
    }
    of = avatars["people"]
    body = [[name, *(f"{value(one)}" for one in of.values())] for name, value in rows.items()]
    return markdown([NOTHING, *of], body) + origin(avatars["source"])


def splits(avatars: Document) -> list[str]:
    """Return what the headers of the avatars say of held-out views: PSNR on the hand and FLIP, by what was held out."""
    of = avatars["people"]
    head = ["held out", *(f"{name}: hand, dB" for name in of), *(f"{name}: FLIP" for name in of)]
    rows = [
        [
            label,
            *(f"{one['metrics'][split]['psnr_hand']:.1f} ({one['metrics'][split]['images']})" for one in of.values()),
            *(f"{one['metrics'][split]['flip']:.3f}" for one in of.values()),
        ]
        for split, label in SPLITS.items()
    ]
    means = [f"{mean_of(one, 'psnr_hand'):.1f}" for one in of.values()]
    return markdown(head, [*rows, ["**all views**", *means, *(f"{mean_of(one, 'flip'):.3f}" for one in of.values())]])


def contrast(avatars: Document) -> list[str]:
    """Return how much of the truth's contrast (L* in bands of size) the avatars show whose headers tell it."""
    of = {
        name: one for name, one in avatars["people"].items() if all("l_1_2" in one["metrics"][name] for name in SPLITS)
    }
    rows = [
        [label, *(f"{100 * share_of_truth(one, band):.0f} %" for one in of.values())] for band, label in BANDS.items()
    ]
    return markdown(["band", *of], rows)


def round_trips(document: Document) -> list[str]:
    """Return what of a motion each rig loses that gets its keys and gives them back, the worse of both sides."""
    rigs: dict[str, list[Document]] = {}
    for case in document["rigs"]:
        rigs.setdefault(case["rig"], []).append(case)
    rows = [
        [
            name,
            str(len(cases)),
            most(cases, "bones", 0),
            most(cases, "joints_deg", 4),
            most(cases, "wrist_mm", 4),
        ]
        for name, cases in rigs.items()
    ]
    head = ["rig", "sides", "bones with keys", "joints, degrees", "wrist, mm"]
    return markdown(head, rows) + origin(document["source"])


def most(cases: Sequence[Document], name: str, decimals: int) -> str:
    """Return the largest of a recorded figure as text."""
    return f"{max(case[name] for case in cases):.{decimals}f}"


SYSTEMS = {"windows_x64": "Windows", "macos_arm64": "macOS, Apple silicon", "linux_x64": "Linux"}


def zips(release: Document) -> list[str]:
    """Return the megabytes of a release's zips by system and Blender; the slim one is for all."""
    of = release["zips"]
    rows = [
        [label, *(size_of(of, f"{name}-{python}") for python in ("py311", "py313"))] for name, label in SYSTEMS.items()
    ]
    rows.append(["without packages", size_of(of, "slim"), size_of(of, "slim")])
    return markdown(["MB", "Blender 4.2 to 5.0", "5.1 and later"], rows) + origin(release["source"])


def size_of(sizes: Mapping[str, float], name: str) -> str:
    """Return the size of a zip as text; a dash if it was not built."""
    return digits(sizes[name]) if name in sizes else "-"


def summary(against_cycles: Document, avatars: Document, benchmark: Document, idle: Document) -> list[str]:
    """Return the README's four rows, of the light avatar but the first, linked to the pages that say what they mean.

    Times are the benchmark's, unless its machine was busy: then those of the idle machine that was kept.
    """
    quality, speed = "docs/results/quality.md", "docs/results/speed.md"
    busy = benchmark["result"]["machine"]["busy"]
    frame, advantage = idle_speed(idle) if busy else measured_speed(benchmark["result"]["sizes"][REFERENCE])
    rows = [
        [f"[PSNR]({quality}#by-light) on whole hands of all nine people, by light", light_figures(against_cycles)],
        [f"[contrast]({quality}#contrast) of the skin at 1 to 16 mm", contrast_range(avatars["people"]["light"])],
        [f"[a frame]({speed}#the-run) of {REFERENCE} on the CPU", frame],
        [f"[faster]({speed}#frames) than others", advantage],
    ]
    return markdown(["the light avatar, against path-traced pictures", NOTHING], rows)


def measured_speed(of: Document) -> tuple[str, str]:
    """Return a frame's time in reduced precision, and how many times faster it is than others of the same run."""
    wall_ms, cores_ms = of["frame_ms"]["default_bf16"]["median"], 1000 * of["core_s"]["default_bf16"]["median"]
    found = {"the paper's renderer": of["ratio_paper"], "Cycles": of["ratio_cycles"].get("64", {})}
    ratios_of = [f"{times(ratio['bf16'])} {name}" for name, ratio in found.items() if "bf16" in ratio]
    return f"{digits(wall_ms)} ms, {digits(cores_ms)} of processor time", ", ".join(ratios_of)


def idle_speed(idle: Document) -> tuple[str, str]:
    """Return the same of the kept table of an idle machine."""
    table = idle["tables"]["frames"]
    row = dict(zip(table["columns"], next(row for row in table["rows"] if row[0] == REFERENCE), strict=True))
    ratio = row["faster than the paper's renderer, bf16"]
    return f"{row['bf16, ms']} ms, {row['bf16, core-ms']} of processor time", f"{ratio} the paper's renderer"


def light_figures(against_cycles: Document) -> str:
    """Return the PSNR on whole hands in each kind of light."""
    psnr = {row[0]: row[1].split(" ")[0] for row in against_cycles["tables"]["psnr"]["rows"]}
    first, *others = (f"{psnr[kind]} {label}" for kind, label in LIGHTS.items())
    return ", ".join([first.replace(" ", " dB ", 1), *others])


def contrast_range(avatar: Document) -> str:
    """Return the least and the greatest share of the truth's contrast over the bands."""
    shares = [share_of_truth(avatar, band) for band in BANDS]
    return f"{100 * min(shares):.0f} to {100 * max(shares):.0f} % of the truth's"


def mean_of(avatar: Document, figure: str) -> float:
    """Return a figure's mean over all held-out views of an avatar's header."""
    counted = [(avatar["metrics"][split]["images"], avatar["metrics"][split][figure]) for split in SPLITS]
    return fmean([value for _, value in counted], [count for count, _ in counted])


def share_of_truth(avatar: Document, band: str) -> float:
    """Return an avatar's contrast in a band divided by the truth's, both as means over all held-out views."""
    return mean_of(avatar, band) / mean_of(avatar, f"{band}_truth")


def cell(of: Document, *keys: str, scale: float = 1.0) -> str:
    """Return the number at `keys`, times `scale`, as text; nothing if there is none."""
    value: Any = of
    for key in keys:
        if not isinstance(value, Mapping) or key not in value:
            return NOTHING
        value = value[key]
    return digits(scale * value)


def digits(value: float) -> str:
    """Return a number with the digits that a reader can use: 0.04, 4.1, 65.7, 903, 14,742."""
    if value >= 100:
        return f"{value:,.0f}"
    return f"{value:.1f}" if value >= 1 else f"{value:.2f}"


def times(ratio: float | None) -> str:
    """Return a ratio as text; nothing if it was not measured."""
    return NOTHING if ratio is None else f"{digits(ratio)} times"

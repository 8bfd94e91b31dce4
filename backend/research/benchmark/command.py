"""`livehand benchmark`: its arguments and its run. Torch is imported only when it runs, so that --help is quick."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...avatars.library import AVATAR_HELP, avatar_path
from ...records.errors import LiveHandError
from ...system.command import Command, parse_size_px, say
from ...system.figure import check_plot_name, save_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .machine import Peaks
    from .measure import Bench, BenchmarkPlan, CyclesRender, Size, SizeResult

_NAMED_SIZES = {"1080p": (1920, 1080), "2160p": (3840, 2160)}
_SMALLEST_PX = 16
_REFERENCE_PX = (334, 512)
_HELP = "measure the time of each stage of a frame against the machine's limits, the paper's renderer and Cycles"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the command's arguments."""
    add = parser.add_argument
    add("--avatar", type=avatar_path, metavar="NAME|FILE", help=AVATAR_HELP)
    add("--paper-avatar", type=Path, metavar="FILE", help="trained with --config paper (default: untrained)")
    add("--sizes", type=parse_sizes, default="167x256,334x512,1080p,2160p", help="(default: %(default)s)")
    add("--paper-sizes", type=parse_sizes, default="167x256,334x512,1080p", help="also for the paper (%(default)s)")
    add("--cycles-sizes", type=parse_sizes, default="334x512", help="also for Cycles (default: %(default)s)")
    add("--frames", type=int, default=24, help="of the moving hand, at each size (default: %(default)s)")
    add("--coverage", type=float, help="the hand's share of the image, 0 to 1 (default: the example's)")
    add("--budget", type=float, default=60.0, metavar="SECONDS", help="limit for one configuration at one size")
    add("--device", choices=("auto", "cpu", "cuda"), default="auto")
    add("--threads", type=int, help="of torch, numba and Cycles (default: their own choice)")
    add("--no-cycles", action="store_true", help="do not run Cycles")
    add("--cycles-samples", type=parse_counts, default="16,64", help="per pixel (default: %(default)s)")
    add("--cycles-frames", type=int, default=4, help="that Cycles renders (default: %(default)s)")
    add("--cycles-skin", type=Path, metavar="DIR", help="baked maps of a capture (default: bake them)")
    add("--plot", type=Path, metavar="FILE.png", help="plot cost against coverage, size and hands (needs matplotlib)")


def run(
    args: argparse.Namespace, make_cycles: Callable[[argparse.Namespace], CyclesRender] | None = None
) -> dict[str, Any]:
    """Measure and return the figures; `make_cycles` makes the renderer that needs Blender (None: without Cycles)."""
    from ...hand.model_file import load_default_hand
    from ...render.device import rendering_device
    from .cases import load_configurations
    from .machine import describe, set_threads
    from .measure import Bench
    from .plot import growth_figure

    plan = plan_of(args)
    set_threads(args.threads)
    machine = describe(rendering_device(args.device))  # its load is that of before
    figure = (
        growth_figure() if args.plot else None
    )  # before minutes of measurements: growth_figure raises where matplotlib is missing
    device, hand = rendering_device(args.device), load_default_hand()
    configurations = load_configurations(hand, device, args.avatar, args.paper_avatar)
    bench = Bench(configurations, hand, device, make_cycles(args) if make_cycles else None)
    sizes, peaks = bench.run(plan, lambda part: say(f"measuring {part}"))
    growth = _growth(bench, plan, sizes, figure, args.plot) if figure else {}
    return _result(machine, peaks, sizes, growth)


def plan_of(args: argparse.Namespace) -> BenchmarkPlan:
    """Make the plan that the arguments describe.

    Raises:
        LiveHandError: a number is out of range, or the plot is not a .png file.
    """
    from .measure import BenchmarkPlan

    for name, least in (("frames", 1), ("cycles_frames", 1), ("threads", 1), ("budget", 0)):
        value = getattr(args, name)
        if value is not None and value < least:
            raise LiveHandError(f"--{name.replace('_', '-')} must be {least} or more, got {value}")
    if args.coverage is not None and not 0 < args.coverage <= 1:
        raise LiveHandError(f"--coverage must be a share of the image above 0 and up to 1, got {args.coverage}")
    if args.plot:
        check_plot_name(args.plot)
    return BenchmarkPlan(
        args.sizes,
        args.paper_sizes,
        () if args.no_cycles else args.cycles_sizes,
        args.frames,
        args.cycles_samples,
        args.cycles_frames,
        args.coverage,
        args.budget,
    )


def parse_sizes(text: str) -> tuple[Size, ...]:
    """Parse `167x256,1080p` as sizes in px, without duplicates.

    Raises:
        argparse.ArgumentTypeError: malformed, or too small.
    """
    parts = [part.strip().lower() for part in text.split(",")]
    return tuple(dict.fromkeys(_NAMED_SIZES.get(part) or parse_size_px(part, _SMALLEST_PX) for part in parts))


def parse_counts(text: str) -> tuple[int, ...]:
    """Parse `16,64` as positive numbers, without duplicates.

    Raises:
        argparse.ArgumentTypeError: malformed.
    """
    parts = [part.strip() for part in text.split(",")]
    if not all(part.isdecimal() and int(part) > 0 for part in parts):
        raise argparse.ArgumentTypeError(f"must be whole numbers above 0, such as 16,64, got {text!r}")
    return tuple(dict.fromkeys(int(part) for part in parts))


def _result(machine: dict[str, Any], peaks: Peaks, sizes: list[SizeResult], growth: dict[str, Any]) -> dict[str, Any]:
    from .report import machine_lines, peaks_document, size_document, size_lines

    measured = peaks_document(peaks)
    documents = {_size_name(result.size_px): size_document(result, peaks) for result in sizes}
    lines = machine_lines(machine, measured)
    for name, document in documents.items():
        lines += ["", *size_lines(name, document)]
    return {"machine": machine | {"peaks": measured}, "sizes": documents, **growth, "summary": "\n".join(lines)}


def _growth(bench: Bench, plan: BenchmarkPlan, sizes: list[SizeResult], figure: Figure, path: Path) -> dict[str, Any]:
    """Measure the curves and plot them; returns them as JSON."""
    from .growth import grow_with_coverage, grow_with_hands
    from .plot import draw_growth
    from .report import growth_document

    size_px = _REFERENCE_PX if _REFERENCE_PX in plan.sizes_px else plan.sizes_px[0]
    say("measuring how cost grows")
    coverage = grow_with_coverage(bench, plan, size_px)
    hands = grow_with_hands(bench, plan, size_px)
    draw_growth(figure, coverage, sizes, hands, _size_name(size_px))
    save_figure(figure, path)
    curves = {"coverage": growth_document(coverage, "coverage"), "hands": growth_document(hands, "hands")}
    return {"growth": curves | {"size": _size_name(size_px)}, "plot": str(path)}


def _size_name(size_px: Size) -> str:
    return f"{size_px[0]}x{size_px[1]}"


COMMAND = Command("benchmark", _HELP, add_arguments, run)

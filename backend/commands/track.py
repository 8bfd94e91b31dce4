"""`livehand track`: the hands of a video as a take, which `render` and Blender's *Import Motion* read."""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ..hand.model import HandModel
from ..hand.model_file import DEFAULT_HAND, load_hand_model
from ..motion.landmarks.take_file import FilmedTake, take_doubts, write_take
from ..motion.landmarks.take_fit import LONGEST_GAP_S, MOST_FIT_ERROR, TakeFit, fit_take
from ..records.errors import LiveHandError
from ..records.side import SIDES, Side
from ..system.command import Command, parse_fov, warn
from ..system.figure import check_plot_name, new_figure, save_figure
from ..tracking.sighted_take import filmed_take, frames_of_film

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from ..tracking.video import Video, VideoFrame


PANEL_IN = (9.0, 2.4)
"""Width and height of a panel."""


def draw_fit_error(figure: Figure, fits: Mapping[Side, TakeFit]) -> None:
    """Plot fit errors in percent of the hand's size; shaded: no keys; dotted: mistakes above."""
    for axes, (side, fit) in zip(figure.subplots(len(fits), 1, squeeze=False)[:, 0], fits.items(), strict=True):
        step_s = 1 / (fit.motion.fps or 30.0)
        times = fit.start_s + np.arange(len(fit.fit_error)) * step_s
        is_seen = fit.fit_error < 1
        axes.plot(times, np.where(is_seen, 100 * fit.fit_error, np.nan), marker=".", markersize=3)
        for first, last in _runs(~fit.is_keyed):
            axes.axvspan(times[first] - step_s / 2, times[last] + step_s / 2, alpha=0.3, color="grey")
        axes.axhline(100 * MOST_FIT_ERROR, linestyle=":")
        axes.set(title=f"{side} hand", xlabel="s", ylabel="fit error, % of the hand's size", ylim=(0, None))
        axes.grid(alpha=0.4)


def _runs(is_in: np.ndarray) -> list[tuple[int, int]]:
    """Find the first and last index of every run."""
    edges = np.diff(np.r_[0, is_in.astype(int), 0])
    return list(zip(np.flatnonzero(edges == 1).tolist(), (np.flatnonzero(edges == -1) - 1).tolist(), strict=True))


_WORST = 5
_LITTLE_SKIN = 0.6  # one side of a hand is about 0.45


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("video", type=Path, help="the video")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="FILE", help="the take to write (.npz)")
    parser.add_argument(
        "--fov", type=parse_fov, metavar="DEG", help="the camera's horizontal angle of view (default: about 58)"
    )
    parser.add_argument("--hands", type=int, choices=(1, 2), default=2, help="hands to look for (default: %(default)s)")
    parser.add_argument("--weights", type=Path, metavar="DIR", help="the tracker's folder, if it is not the user's own")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="plot the fit error over time (needs matplotlib)")
    parser.add_argument(
        "--hand",
        type=Path,
        metavar="FILE",
        help="the hand model that is fitted (default: the built-in hand)",
    )
    parser.add_argument(
        "--capture",
        type=Path,
        metavar="DIR",
        help="make a capture of one hand that turns before a resting camera, to train on",
    )
    parser.add_argument("--side", choices=SIDES, help="the hand of the capture (default: the one seen longer)")


def _run(args: argparse.Namespace) -> dict[str, Any]:
    from ..tracking.takes import track_frames
    from ..tracking.tracker import HandTracker
    from ..tracking.video import open_video
    from ..tracking.weights import load_networks

    if args.output.suffix.lower() != ".npz":
        raise LiveHandError(f"a take must be written to a .npz file, got {args.output.name}")
    if args.plot:
        check_plot_name(args.plot)
        new_figure(*PANEL_IN)  # before minutes of tracking: it raises where matplotlib is missing
    if args.capture:
        from ..tracking.turning_hand.filmed_capture import check_capture_can_be_made

        check_capture_can_be_made(args.capture)
    elif args.side:
        raise LiveHandError(
            "--side names the hand of a capture, got no --capture; give its folder, or leave --side out"
        )
    model = load_hand_model(args.hand or DEFAULT_HAND)
    video, networks = open_video(args.video), load_networks(args.weights)
    if args.capture:  # before minutes of tracking
        from ..tracking.still import StillTracker
        from ..tracking.turning_hand.survey import check_hand_turns

        check_hand_turns(video.decoded(), video.count, StillTracker(networks))
    tracker = HandTracker(networks, args.hands)
    found = track_frames(_shown(frames_of_film(video), video.count), tracker)
    take = filmed_take(found, video.fps, args.fov, args.video)
    write_take(take, args.output)  # before minutes of fitting, which may fail
    fits: dict[Side, TakeFit] = {}
    for side, hand in take.hands.items():
        fits[side] = fit_take(hand, take.times, take.camera, model, side, take.fps)
        if doubt := take_doubts(fits[side], model):
            warn(f"livehand track: check the {side} hand: {doubt}")
    if args.plot:
        figure = new_figure(PANEL_IN[0], PANEL_IN[1] * len(fits))
        draw_fit_error(figure, fits)
        save_figure(figure, args.plot)
    lines = [_facts(side, fit) for side, fit in fits.items()]
    captured = _captured(args, video, take, model) if args.capture else {}
    lines += [captured.pop("line")] if captured else []
    return {
        "take": str(args.output),
        "frames": len(take.times),
        "hands": {side: _numbers(fit) for side, fit in fits.items()},
        **captured,
        "summary": f"{args.output}: {len(take.times)} frames\n" + "\n".join(lines),
    }


def _captured(args: argparse.Namespace, video: Video, take: FilmedTake, model: HandModel) -> dict[str, Any]:
    from ..tracking.turning_hand.filmed_capture import hand_to_capture, write_filmed_capture
    from ..tracking.turning_hand.take_shape import fit_with_shape

    side = hand_to_capture(take, args.side)
    if len(take.hands) > 1 and not args.side:
        warn(f"livehand track: the film shows two hands; the capture is of the {side} one (--side chooses)")
    fit = fit_with_shape(take, side, model)
    made = write_filmed_capture(video.frames, take, side, fit, model, args.capture, args.video.name)
    held_out = len(made.capture.of_split("novel_pose"))
    line = (
        f"  {args.capture}: {len(made.frames)} images of the {side} hand, {held_out} of them held out, "
        f"masks overlap the mesh by {made.overlap:.2f}, {made.covered:.0%} of the skin is seen"
    )
    if made.covered < _LITTLE_SKIN:
        warn(f"livehand track: the film shows {made.covered:.0%} of the hand's skin; the rest will be blurred")
    numbers = {"images": len(made.frames), "overlap": round(made.overlap, 4), "covered": round(made.covered, 3)}
    return {"capture": str(args.capture), **numbers, "line": line}


def _shown(frames: Iterator[VideoFrame], count: int) -> Iterator[VideoFrame]:
    from tqdm import tqdm

    yield from tqdm(frames, total=count or None, unit="frame", disable=None)


def _numbers(fit: TakeFit) -> dict[str, Any]:
    worst = np.argsort(-np.where(fit.is_keyed, fit.fit_error, 0))[:_WORST]
    return {
        "keyed": int(fit.is_keyed.sum()),
        "without_keys": int((~fit.is_keyed).sum()),
        "rejected": fit.rejected,
        "doubt": round(float(np.median(fit.fit_error[fit.is_keyed])), 4),
        "most_doubtful_s": [round(fit.start_s + int(index) / (fit.motion.fps or 30.0), 2) for index in sorted(worst)],
    }


def _facts(side: Side, fit: TakeFit) -> str:
    numbers = _numbers(fit)
    line = f"  {side} hand: {numbers['keyed']} frames, median fit error {100 * numbers['doubt']:.1f} % of its size"
    if numbers["without_keys"]:
        line += f"; {numbers['without_keys']} frames lie in gaps over {LONGEST_GAP_S} s and have no keys"
    if numbers["rejected"]:
        warn(f"livehand track: {side} hand: {numbers['rejected']} frames were taken for mistakes of the tracker")
    return f"{line}; look at {', '.join(f'{second:g}' for second in numbers['most_doubtful_s'])} s"


COMMAND = Command("track", "track the hands in a video", _add_arguments, _run)

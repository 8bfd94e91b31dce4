"""Kill `livehand render` repeatedly at random times, and check the frames on disk.

    python examples/kill_test.py [KILLS]        20 if not given

renders 40 frames of `wave.blend` at 251 x 384 px undisturbed, then again into another folder while it is killed with
SIGKILL at random times and restarted; the last run is not killed. Afterwards all frames must be complete and equal to
the undisturbed ones, and there must be no other files.
"""

import json
import random
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from livehand.backend.batch.frame_file import check_frame, read_exr_header

FRAMES = "1-40"
SIZE = "251x384"


def survive_kills(command: list[str], folder: Path, kills: int, delay_s: tuple[float, float], random: random.Random):
    """Run a render command undisturbed and with kills; returns figures.

    Args:
        command: without `-o`.
        folder: for both runs' frames; made.
        kills: how many.
        delay_s: (least, most) seconds to a kill from when the run has opened the shot and written 0 to 2 frames.
        random: source of the times.
    """
    calm, killed = folder / "calm", folder / "killed"
    written = _frames(_start(command, calm))
    lost: list[int] = []
    ended = 0
    rendered: list[int] = []
    for _ in range(kills):
        process = _start(command, killed)
        begun = _read_until(process, random.randint(0, 2))
        time.sleep(random.uniform(*delay_s))
        ended += process.poll() is not None
        process.kill()
        rendered += _frames(process, begun)
        lost.append(len({path.name.split(".")[1] for path in killed.glob(".*")}))
    last = _frames(_start(command, killed))
    rendered += last
    names = sorted(path.name for path in calm.glob("*.exr"))
    return {
        "frames": len(written),
        "kills": kills - ended,
        "kills_amid_a_frame": sum(count > 0 for count in lost),
        "most_frames_lost_per_kill": max(lost),
        "written_twice": len(rendered) - len(set(rendered)),
        "written_by_the_last_run": len(last),
        "equal": sum(_is_equal(calm / name, killed / name) for name in names),
        "leftovers": sorted({path.name for path in killed.iterdir()} ^ {path.name for path in calm.iterdir()}),
    }


def _start(command: list[str], folder: Path) -> subprocess.Popen[str]:
    return subprocess.Popen([*command, "-o", str(folder), "--json"], stdout=subprocess.PIPE, text=True)


def _read_until(process: subprocess.Popen[str], count: int) -> str:
    """The output of a process until it has opened the shot and written that many frames, or ends."""
    printed = process.stdout.readline()
    while len(_written(printed)) < count:
        line = process.stdout.readline()
        if not line:
            break
        printed += line
    return printed


def _frames(process: subprocess.Popen[str], printed: str = "") -> list[int]:
    """The frames that a process reported as written, read when it has ended."""
    out, _ = process.communicate()
    return _written(printed + out)


def _written(printed: str) -> list[int]:
    events = [json.loads(line) for line in printed.splitlines() if line.endswith("}")]
    return [event["frame"] for event in events if event.get("event") == "frame" and event["state"] == "written"]


def _is_equal(path: Path, other: Path) -> bool:
    """Whether both are complete and equal after the header, which contains the date."""
    data, expected = path.read_bytes(), other.read_bytes()
    parts, start = read_exr_header(data)
    _, other_start = read_exr_header(expected)
    check_frame(path, parts[0].size_px)
    table = 8 * sum(part.chunk_count for part in parts)
    return data[start + table :] == expected[other_start + table :]


def main() -> None:
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    shot = Path(__file__).with_name("wave.blend")
    command = [sys.executable, "-P", "-m", "livehand.livehand_blender", "render", str(shot)]
    with tempfile.TemporaryDirectory() as folder:
        report = survive_kills(
            [*command, "--frames", FRAMES, "--size", SIZE], Path(folder), kills, (0.0, 0.5), random.Random(1)
        )
    for name, value in report.items():
        print(f"{name}: {value}")
    sys.exit(report["equal"] != report["frames"] or bool(report["leftovers"]))


if __name__ == "__main__":
    main()

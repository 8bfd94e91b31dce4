"""Kills commands at random moments and repeats them until they are done: nothing may be lost, twice or half written.

    python tests/kills/run.py [--kills 200] [--commands render jobs containers poses train ...] [--seed 0]

Each command runs once undisturbed. Then, in new folders, it is killed with SIGKILL up to four times, at random moments
of its work, and repeated until it ends by itself. After every kill each file with a final name must be whole, and in
the end all files must be there, equal to the undisturbed run's, and no others.

`containers` is two processes that render into one folder and seem to be in two containers. One of them is killed, or
stopped until its leases are dead and then let go; the other one, alone, must end with 0 and all frames.
"""

import argparse
import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from livehand.backend.capture.capture import Capture, CaptureView, save_capture_index
from livehand.backend.hand.model_file import load_default_hand
from livehand.backend.records.camera import Camera, look_at
from livehand.backend.records.shot import HandPose
from PIL import Image

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE))
from contents import content, is_same  # noqa: E402
from small_livehand import STALE_S  # noqa: E402

EXAMPLES = HERE.parents[1] / "examples"
PICTURES = HERE.parent / "tracking" / "pictures"
MOST_KILLS_A_RUN = 4
END_S = 600.0
_UNFINISHED = (".jsonl",)  # written line by line


@dataclass(frozen=True)
class Killed:
    """A command that is killed.

    Attributes:
        arguments: a function (folder of inputs) -> the program's arguments, without `-o`.
        output: the name in the output's folder that `-o` gets; none: that folder.
        is_done: what the program answers when there is nothing left to do, if that is an error.
        writes_last: it writes its only file at its end; the moments of the kills are drawn from all its time.
        containers: how many processes run it at the same time.
    """

    arguments: Callable[[Path], list]
    output: str = ""
    is_done: str | None = None
    writes_last: bool = False
    containers: int = 1


def _render(inputs):
    return ["render", EXAMPLES / "wave.blend", "--frames", "1-24", "--size", "64x96", "--format", "exr,png", "--json"]


def _train(inputs):
    _painted(inputs / "capture")
    return ["train", inputs / "capture", *"--steps 60 --resume --perceptual 0 --preview-minutes 0".split()]


def _capture(inputs):
    plan = "--poses 3 --cameras 3 --cameras-per-pose 2 --size 24x32 --samples 1 --eval-samples 1 --eval-views 2"
    return ["capture", *plan.split(), "--threads", "1"]


def _import(inputs, count=400):
    inputs.mkdir(parents=True, exist_ok=True)
    frames = [{"file_path": f"{n}.png", "transform_matrix": np.eye(4).tolist(), "pose_index": 0} for n in range(count)]
    noise = np.random.default_rng(0).integers(0, 255, (count, 64, 64, 4), np.uint8)
    for frame, pixels in zip(frames, noise, strict=True):
        Image.fromarray(pixels).save(inputs / frame["file_path"])
    (inputs / "transforms.json").write_text(json.dumps({"camera_angle_x": 0.8, "w": 64, "h": 64, "frames": frames}))
    np.savez(inputs / "poses.npz", theta=np.zeros((1, 16, 3)), beta=np.zeros((1, 10)), transl=np.zeros((1, 3)))
    return ["import-transforms", inputs / "transforms.json", "--poses", inputs / "poses.npz"]


def _compare(inputs):
    _painted(inputs / "capture")
    rows = "--rows mesh_wrapping mesh_texture smplpix --steps 3 --without-perceptual --max-images 2"
    return ["compare", inputs / "capture", *rows.split(), *"--speed-frames 1 --speed-size 48x64 --split test".split()]


def _reenact(inputs):
    return ["reenact", _track(inputs)[1], "--device", "cpu"]


def _track(inputs):
    """A film of both hands; needs PyAV, and the tracker's networks in their folder (`livehand fetch-tracker`)."""
    import av

    inputs.mkdir(parents=True, exist_ok=True)
    shown = [np.asarray(Image.open(PICTURES / f"{name}.jpg").convert("RGB"))[::2] for name in ("palm", "left")]
    picture = np.concatenate([shown[0][:, 360:1000:2], shown[1][:, 100:740:2]], 1)
    with av.open(str(inputs / "film.mp4"), "w") as container:
        stream = container.add_stream("libx264", rate=30)
        stream.height, stream.width = picture.shape[:2]
        stream.pix_fmt = "yuv420p"
        for shift in range(24):
            frame = av.VideoFrame.from_ndarray(np.roll(picture, 2 * shift, 1), format="rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return ["track", inputs / "film.mp4"]


def _person(inputs):
    """A capture of a resting hand from six sides, by a person who ships."""
    from livehand.backend.capture.picture import linear_to_srgb
    from livehand.backend.hand.lbs import posed_vertices
    from livehand.backend.person.person_avatar import shipped_bases
    from livehand.backend.records.light import Light, Sky

    hand = load_default_hand()
    person, pose = shipped_bases(hand).models[0.42], HandPose.rest()
    middle = posed_vertices(hand, pose)[hand.framed_vertices].mean(0)
    K, views = np.array([[260.0, 0, 60], [0, 260, 75], [0, 0, 1]]), []
    folder = inputs / "capture"
    folder.mkdir(parents=True, exist_ok=True)
    for index, angle in enumerate(np.linspace(0, 2 * np.pi, 6, endpoint=False)):
        eye = middle + 0.42 * np.array([0.15, np.cos(angle), np.sin(angle)])
        camera = Camera(K, look_at(eye, middle, np.array([-1.0, 0, 0])), (120, 150))
        frame = person.rendered(pose, camera, Light(sky=Sky(np.full((16, 32, 3), 0.35))))
        rgb = linear_to_srgb((frame.rgb / np.maximum(frame.alpha[..., None], 1e-3)).clip(0, 1))
        pixels = (255 * np.concatenate([rgb, frame.alpha[..., None]], -1)).round().clip(0, 255).astype(np.uint8)
        Image.fromarray(pixels).save(folder / f"{index}.png")
        views.append(CaptureView(f"{index}.png", camera, index, 0, "train"))
    save_capture_index(Capture(folder, hand.sha256, {}, (pose,), tuple(views)))
    return ["person", folder, "--sheet", inputs / "sheet.png"]


COMMANDS = {
    "render": Killed(_render),
    "jobs": Killed(lambda inputs: [*_render(inputs), "--jobs", "3"]),
    "containers": Killed(_render, containers=2),
    "poses": Killed(lambda inputs: ["render", EXAMPLES / "take.json", "--size", "64x64"]),
    "train": Killed(_train, "a.safetensors"),
    "capture": Killed(_capture),
    "import": Killed(_import, "capture", "a new capture needs an empty folder"),
    "compare": Killed(_compare),
    "track": Killed(_track, "take.npz", writes_last=True),
    "reenact": Killed(_reenact),
    "person": Killed(_person, "made.safetensors"),
}


def _painted(folder):
    """A capture of one pose from four cameras, of noise."""
    hand, rng = load_default_hand(), np.random.default_rng(0)
    K = np.array([[70.0, 0, 16], [0, 70, 24], [0, 0, 1]])
    views = []
    for index, direction in enumerate(([0, 1, 0.2], [0.1, 1, -0.6], [0.1, 0.7, 0.9], [0.2, 0.9, 0.4])):
        origin = 0.6 * np.array(direction) / np.linalg.norm(direction)
        camera = Camera(K, look_at(origin, np.zeros(3), np.array([-1.0, 0, 0])), (32, 48))
        views.append(CaptureView(f"{index}.png", camera, index, 0, "test" if index == 3 else "train"))
    folder.mkdir(parents=True, exist_ok=True)
    pose = HandPose(np.zeros((16, 3)), np.zeros(10), -hand.joints[4])
    save_capture_index(Capture(folder, hand.sha256, {}, (pose,), tuple(views)))
    for view in views:
        Image.fromarray(rng.integers(0, 255, (48, 32, 4), np.uint8)).save(folder / view.file)


class Survivor:
    """One command, run undisturbed and killed.

    Args:
        name: of the command.
        folder: for inputs and outputs.
        random: source of the moments.
    """

    def __init__(self, name, folder, random):
        self._killed, self._folder, self._random = COMMANDS[name], folder, random
        (folder / "inputs").mkdir(parents=True)
        arguments = self._killed.arguments(folder / "inputs")
        self._command = [sys.executable, HERE / "small_livehand.py", *arguments]
        self.complaints, self.kills, self.kills_at_work = [], 0, 0
        calm = folder / "calm"
        process = self._start(calm)
        self._start_s = _wait_for_a_change(process, calm)
        began = time.monotonic()
        self._finish(process)
        self._work_s = time.monotonic() - began
        self._calm = _files(calm)

    def run(self, kills):
        """Kill until there were so many kills, and complain."""
        number = 0
        while self.kills < kills and number < 5 * kills:
            number += 1
            folder = self._folder / f"killed{number}"
            if self._killed.containers > 1:
                self._round_of_containers(folder)
            else:
                self._round(folder, min(MOST_KILLS_A_RUN, kills - self.kills))

    def _round(self, folder, kills):
        written = []
        for _ in range(kills):
            process = self._start(folder)
            is_at_work = not self._killed.writes_last and self._random.random() < 0.9
            if is_at_work:
                _wait_for_a_change(process, folder)
            try:
                process.wait(self._random.uniform(0, 0.9 * self._work_s if is_at_work else self._start_s))
            except subprocess.TimeoutExpired:
                self.kills += 1
                self.kills_at_work += is_at_work
                self._kill(process)
            written += _written(process.communicate()[0])
            self._check(f"after kill {self.kills}", folder)
            if process.returncode == 0:
                self._work_s *= 0.8  # the machine is quicker than it was
                break
        else:
            written += self._finish(self._start(folder))
        if len(written) != len(set(written)):
            self.complaints.append(f"written twice: {sorted(f for f in set(written) if written.count(f) > 1)}")
        self._compare(folder)

    def _round_of_containers(self, folder):
        processes = [self._start(folder, f"container {number}") for number in range(self._killed.containers)]
        _wait_for_a_change(processes[0], folder)
        time.sleep(self._random.uniform(0, 0.8 * self._work_s))
        victim = processes.pop(self._random.randrange(len(processes)))
        is_stopped = self._random.random() < 0.5
        if victim.poll() is None:
            self.kills += 1
            self.kills_at_work += 1
            victim.send_signal(signal.SIGSTOP if is_stopped else signal.SIGKILL)
        try:
            written = [frame for process in processes for frame in self._finish(process)]
        except subprocess.TimeoutExpired:
            for process in (victim, *processes):
                process.kill()
            raise
        self._check(f"after kill {self.kills}", folder)
        images = {name for name in self._calm if Path(name).suffix in (".exr", ".png")}
        if missing := images - _files(folder).keys():
            self.complaints.append(f"ended with 0, and these are missing: {sorted(missing)[:9]}")
        if is_stopped:
            time.sleep(STALE_S)
            victim.send_signal(signal.SIGCONT)
            written += self._finish(victim)
        else:
            written += _written(victim.communicate()[0])
        if len(written) != len(set(written)):
            self.complaints.append(f"written twice: {sorted(f for f in set(written) if written.count(f) > 1)}")
        time.sleep(STALE_S)
        self._finish(self._start(folder, "another container"))  # it removes what the killed one left
        self._compare(folder)

    def _start(self, folder, place=None):
        folder.mkdir(exist_ok=True)
        command = [*self._command, "-o", folder / self._killed.output]
        return subprocess.Popen(
            [str(part) for part in command],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
            env=os.environ | {"TQDM_DISABLE": "1"} | ({"KILLS_PLACE": place} if place else {}),
        )

    def _kill(self, process):
        """The process, one of its children, or all of them."""
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        workers = [int(pid) for pid in children.read_text().split()] if children.exists() else []
        choice = self._random.choice(["one", "all", "parent"]) if workers else "parent"
        if choice == "all":
            os.killpg(process.pid, signal.SIGKILL)
        else:
            os.kill(self._random.choice(workers) if choice == "one" else process.pid, signal.SIGKILL)

    def _finish(self, process):
        out, err = process.communicate(timeout=END_S)
        if process.returncode and not (self._killed.is_done and self._killed.is_done in err):
            self.complaints.append(f"exit code {process.returncode}: {err[-500:]}")
        return _written(out)

    def _check(self, when, folder):
        for path in _files(folder).values():
            if path.name.startswith(".") or path.suffix in _UNFINISHED:
                continue
            try:
                content(path)
            except FileNotFoundError:  # a worker that has lost its parent still works
                continue
            except Exception as error:
                self.complaints.append(f"{when}, {path} is not whole: {error}")

    def _compare(self, folder):
        found = _files(folder)
        if found.keys() != self._calm.keys():
            self.complaints.append(f"other files: {sorted(found.keys() ^ self._calm.keys())[:9]}")
        for name in found.keys() & self._calm.keys():
            if not is_same(content(found[name]), content(self._calm[name])):
                self.complaints.append(f"{found[name]} differs")


def _wait_for_a_change(process, folder):
    """Until the process writes into the folder, or ends; returns the time, s."""
    before, began = _stamps(folder), time.monotonic()
    while process.poll() is None and _stamps(folder) == before:
        time.sleep(0.01)
    return time.monotonic() - began


def _stamps(folder):
    stamps = {}
    with contextlib.suppress(FileNotFoundError):  # a temporary file that is gone again
        for root in (folder, *folder.glob("*/")):
            stamps |= {entry.path: entry.stat().st_mtime_ns for entry in os.scandir(root)}
    return stamps


def _files(folder):
    return {str(path.relative_to(folder)): path for path in folder.rglob("*") if path.is_file()}


def _written(out):
    """The frames that a run of `livehand render --json` has reported as written."""
    lines = [line for line in out.splitlines() if line.startswith('{"event": "frame"') and line.endswith("}")]
    return [event["frame"] for event in map(json.loads, lines) if event["state"] == "written"]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--kills", type=int, default=200, help="of all commands together")
    parser.add_argument("--commands", nargs="+", choices=COMMANDS, default=list(COMMANDS))
    parser.add_argument("--seed", type=int, default=0)
    args = parser.parse_args()
    complaints = 0
    for number, name in enumerate(args.commands):
        share = args.kills * (number + 1) // len(args.commands) - args.kills * number // len(args.commands)
        with tempfile.TemporaryDirectory(prefix="livehand-kills-") as folder:
            survivor = Survivor(name, Path(folder), random.Random(f"{args.seed} {name}"))
            survivor.run(share)
        at_work = f"{survivor.kills_at_work} of them at work"
        sys.stdout.write(f"{name:8s} {survivor.kills:4d} kills, {at_work}; {len(survivor.complaints)} complaints\n")
        for complaint in survivor.complaints:
            sys.stdout.write(f"    {complaint}\n")
        sys.stdout.flush()
        complaints += len(survivor.complaints)
    sys.exit(1 if complaints else 0)


if __name__ == "__main__":
    main()

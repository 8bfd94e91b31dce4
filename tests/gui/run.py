"""LiveHand in a real Blender window: `python3 tests/gui/run.py [--blender PROGRAM] [--out DIR] [STORY ...]`.

With `--zip ZIP` it plays what a new user does with a release's zip, in an empty user folder. Otherwise it builds the
extension's zip, installs it into a user folder of its own (kept in DIR from run to run), installs the Python packages
that are missing by the command that the preferences offer, and starts Blender in a virtual X screen once for each
story, a script beside this one that drives it. Needs Blender, with torch in its Python if the zip has none, Xvfb,
xdotool and ImageMagick; Tk and tkdnd to drop a file on the window.
"""

import argparse
import contextlib
import json
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
STORIES = ("viewport", "first_hour", "toggle")
OF_A_NEW_USER = "first_picture"
SCREEN = (1280, 800)
BLENDER_SECONDS = 1500

PRINT_INSTALL_COMMAND = """
import importlib, json
def of_livehand(name):
    return importlib.import_module("bl_ext.user_default.livehand." + name)
missing = of_livehand("backend.system.packages").missing_requirements()
folder = of_livehand("livehand_blender.render.package_folder").packages_folder()
command = of_livehand("backend.system.package_install").install_command(missing, folder)
print("MISSING " + json.dumps([[each.module for each in missing], command]))
"""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--blender", default="blender", help="the program (default: the one on the path)")
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "gui", help="zip, user folder; DIR/STORY: pictures")
    parser.add_argument("--zip", type=Path, help=f"play {OF_A_NEW_USER} with this zip, and nothing else")
    parser.add_argument("stories", nargs="*", metavar="STORY", help=f"which of {', '.join(STORIES)} (default: all)")
    args = parser.parse_args()
    out = args.out.resolve()
    environment = os.environ | {"BLENDER_USER_RESOURCES": str(out / "user"), "LIBGL_ALWAYS_SOFTWARE": "1"}
    if args.zip:
        failures = play_new_user(args.zip.resolve(), args.blender, out, environment)
    else:
        (out / "user").mkdir(parents=True, exist_ok=True)
        install_extension(args.blender, out, environment)
        install_packages(args.blender, environment)
        stories = args.stories or STORIES
        failures = [failure for story in stories for failure in play(story, args.blender, out, environment)]
    return say("failed: " + "; ".join(failures)) if failures else 0


def play_new_user(zip_path: Path, blender: str, out: Path, environment: dict[str, str]) -> list[str]:
    """Play what a new user does with a zip, whose settings, add-ons and caches are empty; returns the failures."""
    with tempfile.TemporaryDirectory() as folder:
        here = {"BLENDER_USER_RESOURCES": f"{folder}/user", "XDG_CACHE_HOME": f"{folder}/cache"}
        Path(folder, "user").mkdir()
        return play(OF_A_NEW_USER, blender, out, environment | here, str(zip_path))


def play(story: str, blender: str, out: Path, environment: dict[str, str], *arguments: str) -> list[str]:
    """Run one story and print its report; returns its failures."""
    folder = out / story
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    geometry = ["--window-geometry", "0", "0", *map(str, SCREEN)]
    script = ["--python", str(Path(__file__).with_name(f"{story}.py")), "--", str(folder), *arguments]
    with virtual_screen() as display:
        here = environment | {"DISPLAY": display}
        try:
            done = subprocess.run([blender, *geometry, *script], env=here, timeout=BLENDER_SECONDS, check=False)
        except subprocess.TimeoutExpired:
            return [f"{story}: Blender has not ended after {BLENDER_SECONDS} s"]
    report = folder / "report.json"
    if not report.is_file():
        return [f"{story}: Blender ended with {done.returncode} and no report; its messages are above"]
    result = json.loads(report.read_text())
    say(f"{story}: {json.dumps(result, indent=2)}")
    ended = [f"Blender ended with {done.returncode}"] if done.returncode else []
    return [f"{story}: {failure}" for failure in result["failures"] + ended]


def install_extension(blender: str, out: Path, environment: dict[str, str]) -> None:
    """Build the zip and install it."""
    for old in out.glob("livehand-*.zip"):
        old.unlink()
    extension = [blender, "--command", "extension"]
    subprocess.run(
        [*extension, "build", "--source-dir", str(ROOT), "--output-dir", str(out)], env=environment, check=True
    )
    (zip_path,) = out.glob("livehand-*.zip")
    install = ["install-file", "--repo", "user_default", "--enable", str(zip_path)]
    subprocess.run([*extension, *install], env=environment, check=True)


def install_packages(blender: str, environment: dict[str, str]) -> None:
    """Run the command that LiveHand's preferences offer as a line, if anything but torch is missing."""
    command = [blender, "--background", "--python-expr", PRINT_INSTALL_COMMAND]
    output = subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout
    (line,) = (line for line in output.splitlines() if line.startswith("MISSING "))
    missing, command = json.loads(line.removeprefix("MISSING "))
    if "torch" in missing:
        sys.exit("failed: this Blender's Python must have torch; install it, or name another with BLENDER=")
    if missing:
        say(f"installing {', '.join(missing)}: {command}")
        subprocess.run(command, env=environment, check=True)


@contextlib.contextmanager
def virtual_screen():
    """A virtual X screen without key repeat (for busy machines); yields the name for DISPLAY."""
    read_end, write_end = os.pipe()
    screen = [
        "Xvfb",
        "-displayfd",
        str(write_end),
        "-screen",
        "0",
        "{}x{}x24".format(*SCREEN),
        "-nolisten",
        "tcp",
        "-r",
    ]
    server = subprocess.Popen(screen, pass_fds=[write_end], stderr=subprocess.DEVNULL)
    os.close(write_end)
    try:
        with os.fdopen(read_end) as pipe:
            yield f":{pipe.readline().strip()}"
    finally:
        server.terminate()
        server.wait()


def say(text: str) -> int:
    """Print a line; returns the exit code of a failure."""
    sys.stdout.write(text + "\n")
    sys.stdout.flush()
    return 1


if __name__ == "__main__":
    sys.exit(main())

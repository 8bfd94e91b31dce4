"""Build a release: `python -m livehand.tools.release.build [--out DIR]`.

Makes the slim zip, one zip with wheels for each target, and a static extension repository of the latter: `index.json`
and a page, by Blender's own tool. A target whose wheels cannot be had is left out and said at the end, with the exit
code 1. `make release` calls it.
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
import urllib.parse
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...backend.commands.warm_up import chips
from ...backend.records.errors import LiveHandError
from .check import faults_of
from .targets import TARGETS, Target
from .wheels import Wheel, collect_wheels

ROOT = Path(__file__).parents[2]
PAGE = Path(__file__).with_name("page.html")
MANIFEST = "blender_manifest.toml"
INDEX_FILE = "package_index.txt"
GPU_ROOM = Path("backend/compute/gpu")
_BUILD_SECONDS = 900


@dataclass(frozen=True)
class Release:
    """How a release is made.

    Attributes:
        tool: the command of Blender's extension tool.
        out: folder of what is made.
        website: of the extension, for its manifest; empty: none.
        gpu_chips: for which kernels are compiled ahead, by Warp; as `COMMON_CHIPS` in `compute.gpu.ahead`.
        zips_url, page_url: where zips and repository will lie, if not in one place; empty: they do.
        cpu_index: address of PyTorch's index for CPUs; empty: pip's own has those.
        pip_options: more of pip's.
    """

    tool: tuple[str, ...]
    out: Path
    website: str = ""
    cpu_index: str = ""
    pip_options: tuple[str, ...] = ()
    zips_url: str = ""
    page_url: str = ""
    gpu_chips: tuple[int, ...] = ()


def blender_tool(blender: str | None) -> tuple[str, ...]:
    """Return the command of Blender's extension tool: of a Blender program, or of Blender as a module (not imported).

    Raises:
        LiveHandError: there is neither.
    """
    if blender:
        return (blender, "--command", "extension")
    found = importlib.util.find_spec("bpy")
    folders = found.submodule_search_locations or [] if found else []
    tools = [
        tool for folder in folders for tool in Path(folder).glob("*/scripts/addons_core/bl_pkg/cli/blender_ext.py")
    ]
    if not tools:
        raise LiveHandError(
            "Blender's extension tool must be there, got none; pip install bpy, or name --blender PROGRAM"
        )
    return (sys.executable, str(tools[0]))


def build_release(release: Release, targets: Sequence[Target]) -> list[str]:
    """Build the zips and the repository; returns what could not be built, in words."""
    missing = []
    with tempfile.TemporaryDirectory(dir=release.out) as temporary:
        slim = build_slim(release, Path(temporary))
        for target in targets:
            wheels = Path(temporary) / target.name
            try:
                path = build_full(release, slim, target, wheels)
            except LiveHandError as error:
                missing.append(str(error))
            else:
                say(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB")
            shutil.rmtree(wheels, ignore_errors=True)
    if targets:
        repository = release.out / "repository"
        run(release, "server-generate", "--repo-dir", repository, "--html", "--html-template", PAGE)
        if release.zips_url:
            part_from_zips(repository, release.zips_url.rstrip("/"), release.page_url.rstrip("/"))
    return missing


def part_from_zips(repository: Path, zips_url: str, page_url: str) -> None:
    """Let the index and the page of a repository name zips that lie elsewhere, as on a site with room for pages alone.

    Args:
        repository: its folder, as Blender's tool has made it.
        zips_url: of the folder of the zips.
        page_url: of the folder of the page.
    """
    index, page = repository / "index.json", repository / "index.html"
    listed = json.loads(index.read_text(encoding="utf-8"))
    for entry in listed["data"]:
        entry["archive_url"] = f"{zips_url}/{entry['archive_url'].removeprefix('./')}"
    index.write_text(json.dumps(listed, indent=2), encoding="utf-8")
    links = page.read_text(encoding="utf-8").replace('href="./', f'href="{zips_url}/')
    own = urllib.parse.urlencode({"repository": "./index.json"})
    links = links.replace(own, urllib.parse.urlencode({"repository": f"{page_url}/index.json"}))
    page.write_text(links, encoding="utf-8")


def build_slim(release: Release, temporary: Path) -> Path:
    """Build the zip without wheels, which a user can complete in Blender; returns it."""
    run(release, "build", "--source-dir", ROOT, "--output-dir", temporary)
    (built,) = temporary.glob("*.zip")
    stage = temporary / "slim"
    unpack(built, stage)
    edit_manifest(stage / MANIFEST, with_website(release.website))
    if release.gpu_chips:
        from ...backend.compute.gpu.ahead import SHIPPED, compile_kernels

        done = compile_kernels(release.gpu_chips, stage / GPU_ROOM / SHIPPED.name)
        say(f"kernels of GPUs: {done.size_bytes / 1e6:.1f} MB before the zip, {done.seconds:.0f} s")
    if release.cpu_index:
        (stage / INDEX_FILE).write_text(f"{release.cpu_index}\n", encoding="utf-8")
    path = release.out / f"{built.stem}-slim.zip"
    run(release, "build", "--source-dir", stage, "--output-filepath", path)
    shutil.rmtree(stage)
    say(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB")
    return path


def build_full(release: Release, slim: Path, target: Target, wheels: Path) -> Path:
    """Build the zip of one target, with its wheels and their licences; returns it.

    Raises:
        LiveHandError: pip finds no set of wheels, or the zip has a fault.
    """
    options = [*release.pip_options, *(["--extra-index-url", release.cpu_index] if release.cpu_index else [])]
    collected = collect_wheels(target, wheels / "wheels", options)
    stage = wheels / "stage"
    unpack(slim, stage)
    (stage / "wheels").mkdir()
    (stage / "licenses").mkdir()
    for wheel in collected:
        os.link(wheel.path, stage / "wheels" / wheel.path.name)
        text = stage / "licenses" / f"{wheel.name}-{wheel.version.public}.txt"
        text.write_text(wheel.licence_text(), encoding="utf-8")
    edit_manifest(stage / MANIFEST, with_wheels(target, collected))
    (release.out / "repository").mkdir(exist_ok=True)
    path = release.out / "repository" / f"{slim.stem.removesuffix('-slim')}-{target.name}.zip"
    run(release, "build", "--source-dir", stage, "--output-filepath", path)
    run(release, "validate", path)
    if faults := faults_of(path, target):
        path.unlink()
        raise LiveHandError(f"{path.name}: {'; '.join(faults)}")
    return path


def with_website(website: str) -> dict[str, object]:
    """Return the keys that the slim zip's manifest has beside the repository's."""
    return {"website": website} if website else {}


def with_wheels(target: Target, wheels: Sequence[Wheel]) -> dict[str, object]:
    """Return the keys that a target's manifest has in place of, or beside, the slim zip's."""
    first, end = target.blender
    return {
        "blender_version_min": first,
        **({"blender_version_max": end} if end else {}),
        "platforms": [target.system.platform],
        "wheels": [f"./wheels/{wheel.path.name}" for wheel in wheels],
    }


def edit_manifest(path: Path, keys: dict[str, object]) -> None:
    """Set keys below a manifest's first line, and take out what tells how to build it from the repository."""
    text = path.read_text(encoding="utf-8")
    for key in keys:
        text = re.sub(rf"^{key} = .*\n", "", text, flags=re.MULTILINE)
    text = re.sub(r"^(?:#.*\n)*\[build\]\n.*?(?=^\[|\Z)", "", text, flags=re.MULTILINE | re.DOTALL)
    lines = "".join(f"{key} = {json.dumps(value, ensure_ascii=False)}\n" for key, value in keys.items())
    first, _, others = text.partition("\n")
    text = f"{first}\n{lines}{others.rstrip()}\n"
    assert tomllib.loads(text).items() >= keys.items()
    path.write_text(text, encoding="utf-8")


def unpack(path: Path, folder: Path) -> None:
    """Unpack a zip of our own."""
    with zipfile.ZipFile(path) as archive:
        archive.extractall(folder)


def run(release: Release, *arguments: object) -> None:
    """Run Blender's extension tool.

    Raises:
        LiveHandError: it has failed.
    """
    command = [*release.tool, *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=_BUILD_SECONDS, check=False)
    if done.returncode:
        raise LiveHandError(
            f"Blender's tool must {arguments[0]} the extension, got: {(done.stdout + done.stderr)[-500:]}"
        )


def say(text: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{text}\n")
    sys.stdout.flush()


def main(arguments: Sequence[str] | None = None) -> int:
    """Build what the command line asks for; return the exit code."""
    parser = argparse.ArgumentParser(description="build the zips of a release")
    parser.add_argument("--out", type=Path, default=ROOT / "dist" / "release", help="folder (default: dist/release)")
    parser.add_argument("--blender", help="a Blender program, in place of Blender as a module")
    parser.add_argument("--website", default="", help="the extension's, for its manifest")
    parser.add_argument("--cpu-torch", default="", metavar="ADDRESS", help="PyTorch's index of torch for CPUs")
    parser.add_argument("--zips-url", default="", help="where the zips will lie, if not beside the page")
    parser.add_argument("--page-url", default="", help="where the page will lie then")
    parser.add_argument("--gpu", type=chips, default=(), metavar="CHIPS", help="as of livehand warm-up; needs Warp")
    parser.add_argument("--only", nargs="*", metavar="TARGET", help=f"of {', '.join(one.name for one in TARGETS)}")
    parser.add_argument("--pip", action="append", default=[], metavar="OPTION", help="for pip, as --pip=--no-index")
    args = parser.parse_args(arguments)
    targets = [one for one in TARGETS if args.only is None or one.name in args.only]
    args.out.mkdir(parents=True, exist_ok=True)
    shutil.rmtree(args.out / "repository", ignore_errors=True)
    where = (args.zips_url, args.page_url)
    try:
        options = args.website, args.cpu_torch, tuple(args.pip), *where, args.gpu
        release = Release(blender_tool(args.blender), args.out, *options)
        missing = build_release(release, targets)
    except LiveHandError as error:
        missing = [str(error)]
    for line in missing:
        sys.stderr.write(f"not built: {line}\n")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())

"""Check a zip of a release without running it: `python -m livehand.tools.release.check ZIP ...`.

Everything that Blender's side and the renderer import must be in the zip, in its wheels, in Python or in Blender; the
wheels must fit the system and each other; and every name must be one that the system takes. `try_zip` beside it
installs one of this system and renders a frame.
"""

from __future__ import annotations

import re
import sys
import tempfile
import tomllib
import zipfile
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from .imports import AT_ONCE, imports_of, sources_of_zip
from .targets import TARGETS, System, Target
from .wheels import Wheel, fits, unmet_requirements

MOST_MB = 330
OF_BLENDER = frozenset("addon_utils aud bl_ui blf bmesh bpy bpy_extras cycles gpu gpu_extras mathutils numpy".split())
OPTIONAL = {
    "av": ("backend/tracking/",),
    "c2pa": ("backend/batch/content_credentials.py",),
    "cryptography": ("backend/batch/content_credentials.py",),
    "cv2": ("backend/capture/masks/",),
    "matplotlib": ("backend/system/figure.py",),
    "warp": ("backend/compute/gpu/",),
    "scipy": (
        "backend/person/",
        "backend/rigs/model_transfer/",
        "backend/surface/atlas_masks.py",
        "backend/surface/atlas_texels.py",
        "backend/surface/skin_patches.py",
        "backend/hand/penetration.py",
    ),
}
"""What only some features need, which ask for it, and the modules that may import it."""
_RESERVED = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_FORBIDDEN = re.compile(r'[<>:"|?*\\\x00-\x1f]|[. ]$')
_LONGEST_USER = "u" * 20


def faults_of(path: Path, target: Target) -> list[str]:
    """Return what is wrong with a target's zip, in words."""
    with tempfile.TemporaryDirectory(dir=path.parent) as temporary, zipfile.ZipFile(path) as archive:
        names = [name for name in archive.namelist() if not name.endswith("/")]
        manifest = tomllib.loads(archive.read("blender_manifest.toml").decode("utf-8"))
        inside = [name for name in names if name.startswith("wheels/")]
        wheels = [Wheel(Path(archive.extract(name, temporary))) for name in inside]
        licences = {Path(name).name: archive.getinfo(name).file_size for name in names if name.startswith("licenses/")}
        faults = [*_manifest_faults(manifest, target, sorted(inside)), *_licence_faults(wheels, licences)]
        faults += [f"{wheel.path.name} is not for {target.name}" for wheel in wheels if not fits(wheel, target)]
        faults += ["numpy is in it, beside Blender's own"] if any(wheel.name == "numpy" for wheel in wheels) else []
        faults += unmet_requirements(wheels, target)
        faults += import_faults(path, set().union(*(wheel.import_names for wheel in wheels)))
        faults += name_faults([name for wheel in wheels for name in wheel.members], target.system, target)
    faults += name_faults(names, target.system, None)
    size_mb = path.stat().st_size / 1e6
    return faults + ([f"it has {size_mb:.0f} MB, at most {MOST_MB} are good"] if size_mb > MOST_MB else [])


def _manifest_faults(manifest: dict, target: Target, wheels: Sequence[str]) -> Iterator[str]:
    first, end = target.blender
    wanted = {
        "platforms": [target.system.platform],
        "blender_version_min": first,
        "blender_version_max": end,
        "wheels": [f"./{name}" for name in wheels],
    }
    found = manifest | {"wheels": sorted(manifest.get("wheels", []))}
    yield from (
        f"its {key} must be {value}, got {found.get(key)}" for key, value in wanted.items() if found.get(key) != value
    )


def _licence_faults(wheels: Iterable[Wheel], licences: dict[str, int]) -> Iterator[str]:
    for wheel in wheels:
        if not licences.get(f"{wheel.name}-{wheel.version.public}.txt"):
            yield f"the licence of {wheel.name} is not in it"
        if not wheel.licence and not wheel.licence_files:
            yield f"{wheel.name} does not state its licence"


def import_faults(path: Path, of_wheels: set[str]) -> list[str]:
    """List the imports that nothing answers: modules of the zip that are not there, and packages that no wheel has."""
    sources = sources_of_zip(path)
    imports = imports_of(sources)
    faults = [f"{module} is imported and not in it" for module in sorted(imports.modules - sources.keys())]
    at_once = imports_of(sources, AT_ONCE, only_at_once=True).foreign
    faults += [
        f"{name} is imported by {min(at_once[name])} before a feature asks for it"
        for name in OPTIONAL
        if name in at_once and name not in of_wheels
    ]
    given = of_wheels | OF_BLENDER | set(sys.stdlib_module_names)
    for name, by in sorted(imports.foreign.items()):
        allowed = OPTIONAL.get(name, ())
        asking = sorted(str(module) for module in by if not str(module).startswith(tuple(allowed) or "/"))
        if name not in given and asking:
            faults.append(f"{name} is imported by {asking[0]} and in no wheel")
    return faults


def name_faults(names: Sequence[str], system: System, target: Target | None) -> list[str]:
    """List the files that a system cannot write: reserved, too long, or equal but for their case.

    Args:
        names: of files, relative, with slashes.
        system: that writes them.
        target: they are unpacked from its wheels, so that their whole paths are known; None: they are not.
    """
    faults = []
    if system.ignores_case:
        twice = [name for name, count in Counter(name.lower() for name in set(names)).items() if count > 1]
        faults += [f"{name} is there twice but for its case" for name in twice]
    if system.most_path is not None and target is not None:
        folder = system.folder.format(user=_LONGEST_USER, blender=target.blender[0][:3], python=target.python)
        room = system.most_path - len(folder) - 1
        faults += [f"{name} has {len(name)} letters, there is room for {room}" for name in names if len(name) > room]
    if system.platform.startswith("windows"):
        parts = {part for name in names for part in name.split("/")}
        faults += [
            f"{part} is no name in Windows" for part in parts if _RESERVED.fullmatch(part) or _FORBIDDEN.search(part)
        ]
    return faults


def target_of(path: Path) -> Target | None:
    """Return the target of a zip, by its name."""
    return next((target for target in TARGETS if path.stem.endswith(target.name)), None)


def main(arguments: Sequence[str]) -> int:
    """Check zips; return the exit code."""
    code = 0
    for path in map(Path, arguments):
        target = target_of(path)
        faults = faults_of(path, target) if target else ["its name must end with a target's"]
        sys.stdout.write(f"{path.name}: {'; '.join(faults) or 'good'}\n")
        code |= bool(faults)
    return code


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))

"""The extension's zip: built and checked by Blender's own tool, installed into an empty user folder, and rendering."""

import os
import subprocess
import sys
import zipfile
from pathlib import Path, PurePosixPath

import bpy
import pytest
from livehand.backend.system.packages import REQUIREMENTS
from livehand.tools.release.check import import_faults
from livehand.tools.release.imports import imports_of
from PIL import Image

ROOT = Path(__file__).parents[2]
WANTED_AT_TOP = {"__init__.py", "blender_manifest.toml", "LICENSE", "README.md", "backend", "livehand_blender"}
WANTED_DATA = {
    path.relative_to(ROOT).as_posix() for kind in ("*.npz", "*.safetensors") for path in (ROOT / "backend").rglob(kind)
}
# What serves the pip package's commands only.
LEFT_OUT = {
    "backend/commands",
    "backend/evaluation",
    "backend/research",
    "backend/teacher",
    "backend/training",
    "livehand_blender/cli.py",
    "livehand_blender/__main__.py",
    "livehand_blender/research",
}
WANTED_KINDS = {"", ".py", ".toml", ".md", ".npz", ".safetensors", ".blend", ".txt"}


def blender_ext(*arguments):
    """Run Blender's extension tool."""
    scripts = Path(bpy.utils.system_resource("SCRIPTS"))
    tool = scripts / "addons_core" / "bl_pkg" / "cli" / "blender_ext.py"
    command = [sys.executable, tool, *arguments]
    return subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=60, check=False)


@pytest.fixture(scope="module")
def zip_path(tmp_path_factory):
    folder = tmp_path_factory.mktemp("zip")
    built = blender_ext("build", "--source-dir", ROOT, "--output-dir", folder)
    assert built.returncode == 0, built.stdout + built.stderr
    (path,) = folder.glob("livehand-*.zip")
    return path


def test_blender_accepts_the_zip_and_the_sources(zip_path):
    for path in (zip_path, ROOT):
        checked = blender_ext("validate", path)
        assert checked.returncode == 0, checked.stdout + checked.stderr


def test_the_zip_holds_what_a_user_needs_and_nothing_else(zip_path):
    names = names_in(zip_path)
    assert {name.parts[0] for name in names} <= WANTED_AT_TOP
    assert {name.suffix for name in names} <= WANTED_KINDS
    assert not [name for name in names if {"tests", "docs", "examples", "__pycache__"} & set(name.parts)]
    assert not [name for name in names if any(part.startswith((".", "test_")) for part in name.parts)]
    in_tree = {
        path.relative_to(ROOT) for room in ("backend", "livehand_blender") for path in (ROOT / room).rglob("*.py")
    }
    wanted = {str(path) for path in in_tree if not LEFT_OUT & {str(part) for part in (path, *path.parents)}}
    assert {str(name) for name in names if name.suffix == ".py" and len(name.parts) > 1} == wanted
    assert WANTED_DATA <= {str(name) for name in names}


def test_nothing_in_the_zip_trains_or_downloads(zip_path):
    forbidden = ("torch.optim", "torch.hub", "urllib", "http.client", "requests.get", "load_state_dict_from_url")
    with zipfile.ZipFile(zip_path) as archive:
        sources = {name: archive.read(name).decode() for name in archive.namelist() if name.endswith(".py")}
    found = [(name, word) for name, text in sources.items() for word in forbidden if word in text]
    # Poses of a person's pictures are fitted by gradients; no network is.
    assert [
        (name, word) for name, word in found if not (name.startswith("backend/person/") and word == "torch.optim")
    ] == []


def test_everything_that_blender_imports_is_in_the_zip(zip_path):
    """Also what is imported only when it is needed: the imports are read from the source, inside functions too."""
    in_tree = {
        path.relative_to(ROOT): path for room in ("backend", "livehand_blender") for path in (ROOT / room).rglob("*.py")
    }
    sources = {PurePosixPath(*name.parts): path.read_text(encoding="utf-8") for name, path in in_tree.items()}
    sources[PurePosixPath("__init__.py")] = (ROOT / "__init__.py").read_text(encoding="utf-8")
    imported = imports_of(sources).modules
    assert PurePosixPath("backend/render/renderer.py") in imported
    assert sorted(imported - names_in(zip_path)) == []


def test_a_package_that_livehand_asks_for_brings_each_import(zip_path):
    """And nothing that only a feature needs is imported before the feature asks for it."""
    brought = {requirement.module for requirement in REQUIREMENTS} | {"llvmlite"}  # numba's own
    assert import_faults(zip_path, brought) == []
    assert any(fault.startswith("torch is imported by") for fault in import_faults(zip_path, brought - {"torch"}))


def names_in(zip_path):
    with zipfile.ZipFile(zip_path) as archive:
        return {PurePosixPath(name) for name in archive.namelist()}


INSTALL_AND_RENDER = """
import sys
import bpy
import addon_utils

zip_path, image_path, *missing = sys.argv[1:]
for name in missing:
    sys.modules[name] = None

bpy.ops.extensions.package_install_files(filepath=zip_path, repo="user_default", enable_on_install=True)
try:
    bpy.ops.wm.read_homefile(use_empty=True)
    assert bpy.ops.livehand.add_hand() == {"FINISHED"}
    scene = bpy.context.scene
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.camera.location = (-0.08, 0, 0.5)
    scene.collection.objects.link(scene.camera)
    scene.render.engine = "LIVEHAND"
    scene.render.resolution_x, scene.render.resolution_y = 48, 64
    scene.render.filepath = image_path
    scene.render.image_settings.color_mode = "RGBA"
    bpy.ops.render.render(write_still=True)
    assert "livehand" not in sys.modules, "the pip package was used instead of the extension"
finally:
    addon_utils.disable("bl_ext.user_default.livehand")
"""


def install_and_render(zip_path, image_path, *missing):
    """In a process with an empty user folder, away from the checkout; `missing` packages cannot be imported there."""
    return subprocess.run(
        [sys.executable, "-c", INSTALL_AND_RENDER, str(zip_path), str(image_path), *missing],
        env=os.environ | {"BLENDER_USER_RESOURCES": str(image_path.parent / "user")},
        cwd=image_path.parent,
        capture_output=True,
        text=True,
        timeout=1800,
        check=False,
    )


@pytest.mark.nightly
def test_the_installed_zip_renders_a_frame(zip_path, tmp_path):
    done = install_and_render(zip_path, tmp_path / "frame.png")
    assert done.returncode == 0, done.stdout + done.stderr
    alpha = Image.open(tmp_path / "frame.png").getchannel("A")
    assert alpha.getextrema() == (0, 255)


def test_without_torch_it_installs_and_says_what_to_install(zip_path, tmp_path):
    done = install_and_render(zip_path, tmp_path / "frame.png", "torch")
    assert "rendering needs Python packages that Blender's Python lacks: torch; install them with:" in done.stderr
    assert "pip install" in done.stderr
    assert not (tmp_path / "frame.png").exists()

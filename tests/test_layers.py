"""Folders are layers: imports point from upper rows to lower rows, and no folder imports from a cycle of folders.

Read from the source (AST), imports inside functions included. The last tests plant faults and see them found.
"""

import ast
import re
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
HALVES = ("backend", "livehand_blender")
# Beside the product, and never imported by it: the program finds their commands by name, if they are installed.
BESIDE = ("tools", "backend.research", "livehand_blender.research")
BLENDER_MODULES = {
    "bpy",
    "bpy_extras",
    "mathutils",
    "gpu",
    "gpu_extras",
    "bl_ui",
    "addon_utils",
    "cycles",
    "aud",
    "bmesh",
}

# Rooms by row, from the bottom. A room is a folder with all that lies in it; it imports from itself and from rows below
# its own. The modules at the top of `livehand_blender`, which register and start everything, are a room of their own.
ROWS = (
    ("backend.records",),
    ("backend.system", "backend.geometry", "livehand_blender.scene"),
    ("backend.hand", "backend.light", "backend.batch", "livehand_blender.compositing"),
    ("backend.field", "backend.capture", "livehand_blender.rig"),
    ("backend.image", "backend.motion", "livehand_blender.hands"),
    ("backend.surface", "backend.rigs", "backend.tracking", "livehand_blender.light"),
    ("backend.compute", "backend.avatars", "backend.teacher", "livehand_blender.motion"),
    ("backend.render", "backend.contact", "livehand_blender.capture"),
    (
        "backend.evaluation",
        "backend.commands",
        "backend.person",
        "livehand_blender.render",
        "livehand_blender.rigs",
        "livehand_blender.contact",
    ),
    ("backend.training", "livehand_blender.ui"),
    ("backend.research", "livehand_blender"),
    ("livehand_blender.research", "tools"),
)
ROW_OF = {room: row for row, rooms in enumerate(ROWS) for room in rooms}
# One road: training takes the stages of frames, which `render` gives it, and adds a loss. The one exception is no
# stage: the command warns of captures that show another version of the built-in skin.
ONE_ROAD, ITS_STAGES = "backend.training", ("backend.light", "backend.surface")
OFF_THE_ROAD = {("backend.training.command", "backend.surface.skin_version")}
# numba may be missing: only these folders import it, and no other imports their modules but inside a function.
NUMBA_ROOMS = ("backend.compute.cpu", "backend.compute.kernels")
# What differs between systems is in one module each of this room; beside it, who owns a temporary folder, and reports.
SYSTEM_ROOM = "backend.system"
ASKS_THE_SYSTEM = re.compile(r"os\.name|sys\.platform|platform\.system|hasattr\((os|signal)\b|getattr\(signal\b")
SYSTEM_MODULES = {"backend.compute.kernels.cache_folder", "backend.research.benchmark.machine"}
# Warp is an extra: only this folder imports it, and no other imports its modules but inside a function.
WARP_ROOM = "backend.compute.gpu"
# The kernels stand alone: beside these and the interpreter's own modules, only numbers that they share with torch.
# llvmlite is numba's own LLVM.
KERNELS, KERNEL_NUMBERS = "backend.compute.kernels", "backend.geometry.tolerances"
KERNEL_PACKAGES = {"llvmlite", "numba", "numpy"}


def modules(root):
    """Dotted name below the root -> file; the root package itself is ''."""
    files = [root / "__init__.py", *(path for half in (*HALVES, "tools") for path in (root / half).rglob("*.py"))]
    return {name_of(path.relative_to(root)): path for path in files if path.is_file()}


def name_of(path):
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(name, path, known, only_at_once=False):
    """(our modules, foreign top-level packages) that a file imports; `only_at_once`: not inside functions."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    tree = ast.parse(path.read_text(encoding="utf-8"))
    ours, foreign = set(), set()
    for node in run_at_once(tree) if only_at_once else ast.walk(tree):
        if isinstance(node, ast.Import):
            foreign |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            foreign.add(str(node.module).partition(".")[0])
        elif isinstance(node, ast.ImportFrom):
            parents = package.split(".") if package else []
            base = ".".join(parents[: len(parents) - node.level + 1] + ([node.module] if node.module else []))
            names = (f"{base}.{alias.name}".strip(".") for alias in node.names)
            ours |= {one if one in known else base for one in names}
    return ours, foreign


def run_at_once(node):
    """The nodes of a module that run when it is imported."""
    yield node
    is_typing = isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    if not (is_typing or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)):
        for child in ast.iter_child_nodes(node):
            yield from run_at_once(child)


def folder_of(name, path):
    return name if path.name == "__init__.py" else name.rpartition(".")[0]


def room_of(name, path):
    """The folder at the top of a half that holds a module; a half itself for the modules at its top; all of tools."""
    return "tools" if is_in(name, "tools") else ".".join(folder_of(name, path).split(".")[:2])


def is_in(name, room):
    return name == room or name.startswith(f"{room}.")


def faults(root):
    """Every broken rule, in words."""
    known = modules(root)
    found, folders, graph = [], {}, {}
    for name, path in known.items():
        ours, foreign = imports(name, path, known)
        at_once = imports(name, path, known, only_at_once=True)
        found += foreign_faults(name, foreign) + numba_faults(name, *at_once) + warp_faults(name, *at_once)
        room = room_of(name, path)
        if not is_package_root(name) and room not in ROW_OF:
            found.append(f"{name} is in no room; move it into one, or add its folder to ROWS")
        graph[name] = ours & known.keys()
        for imported in sorted(graph[name]):
            found += arrow_faults(name, room, imported, room_of(imported, known[imported]))
            pair = folder_of(name, path), folder_of(imported, known[imported])
            if pair[0] != pair[1] and not is_package_root(name) and not is_package_root(imported):
                folders.setdefault(pair[0], set()).add(pair[1])
                folders.setdefault(pair[1], set())
    found += [f"cycle: {' -> '.join(cycle)}" for cycle in cycles(graph)]
    return found + [f"cycle of folders: {' -> '.join(cycle)}" for cycle in cycles(folders)]


def is_package_root(name):
    """The root package `livehand` and the two halves' docstrings lie in no room."""
    return name in ("", "backend")


def foreign_faults(name, foreign):
    blender = sorted(foreign & BLENDER_MODULES) if is_in(name, "backend") else []
    absolute = sorted(foreign & {"livehand", "tools", *HALVES})
    heavy = sorted(foreign - KERNEL_PACKAGES - sys.stdlib_module_names) if is_in(name, KERNELS) else []
    return [f"{name} imports {module}" for module in sorted({*blender, *absolute, *heavy})]


def numba_faults(name, ours, foreign):
    if any(is_in(name, room) for room in NUMBA_ROOMS):
        outside = {module for module in ours if not is_in(module, KERNELS) and module != KERNEL_NUMBERS}
        return [f"{name} imports {module}" for module in sorted(outside)] if is_in(name, KERNELS) else []
    theirs = {module for module in ours for room in NUMBA_ROOMS if is_in(module, room)}
    return [f"{name} imports {module} outside a function" for module in sorted(theirs | (foreign & {"numba"}))]


def warp_faults(name, ours, foreign):
    if is_in(name, WARP_ROOM):
        return []
    theirs = {module for module in ours if is_in(module, WARP_ROOM)} | (foreign & {"warp"})
    return [f"{name} imports {module} outside a function" for module in sorted(theirs)]


def arrow_faults(name, room, imported, imported_room):
    if is_in(name, "backend") and is_in(imported, "livehand_blender"):
        return [f"{name} imports {imported}: the backend knows nothing of Blender"]
    if imported_room in BESIDE and room not in BESIDE:
        return [f"{name} imports {imported}: what ships imports nothing that lies beside it"]
    if room == ONE_ROAD and imported_room in ITS_STAGES and (name, imported) not in OFF_THE_ROAD:
        return [f"{name} imports {imported}: training takes the renderer's road, through backend.render"]
    rows = ROW_OF.get(room), ROW_OF.get(imported_room)
    if None in rows or room == imported_room or rows[1] < rows[0]:
        return []
    return [f"{name} imports {imported}, whose room does not lie below"]


def cycles(graph):
    """One cycle per strongly connected knot, found by depth-first search."""
    state, found = {}, []

    def visit(node, path):
        state[node] = "open"
        for target in sorted(graph[node]):
            if state.get(target) == "open":
                found.append([*path[path.index(target) :], target])
            elif target not in state:
                visit(target, [*path, target])
        state[node] = "done"

    for node in sorted(graph):
        if node not in state:
            visit(node, [node])
    return found


@pytest.mark.slow
def test_imports_point_one_way():
    assert faults(ROOT) == []


def test_every_folder_has_a_row_and_every_row_its_folders():
    folders = {
        f"{half}.{path.name}" for half in HALVES for path in (ROOT / half).iterdir() if (path / "__init__.py").is_file()
    }
    assert folders | {"livehand_blender", "tools"} == set(ROW_OF)
    assert len(ROWS) <= 12


def test_systems_are_told_apart_in_one_room():
    asking = {name for name, path in modules(ROOT).items() if ASKS_THE_SYSTEM.search(path.read_text(encoding="utf-8"))}
    assert {name for name in asking if not name.startswith(SYSTEM_ROOM)} == SYSTEM_MODULES
    assert {f"{SYSTEM_ROOM}.{name}" for name in ("files", "processes")} <= asking


@pytest.mark.slow
def test_no_class_name_exists_twice():
    points = {}
    for name, path in modules(ROOT).items():
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                points.setdefault(node.name, []).append(name)
    assert {name: where for name, where in points.items() if len(where) > 1} == {}


def plant(root, files):
    for name, source in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source)
    return root


SOUND = {
    "__init__.py": "def register():\n    from . import livehand_blender\n",
    "backend/__init__.py": "",
    "backend/records/__init__.py": "",
    "backend/records/errors.py": "import numpy",
    "backend/records/shot.py": "from .errors import LiveHandError",
    "backend/geometry/__init__.py": "",
    "backend/geometry/tolerances.py": "",
    "backend/hand/__init__.py": "",
    "backend/hand/model.py": "from ..records.shot import Side",
    "backend/hand/files/__init__.py": "",
    "backend/hand/files/reading.py": "from ..model import HandModel",
    "backend/light/__init__.py": "",
    "backend/light/lighting.py": "",
    "backend/surface/__init__.py": "",
    "backend/surface/skin_version.py": "",
    "backend/field/__init__.py": "",
    "backend/field/field.py": "import torch",
    "backend/compute/__init__.py": "",
    "backend/compute/cpu/__init__.py": "",
    "backend/compute/cpu/backend.py": "from ...field.field import Field\nfrom ..kernels.planes import read_plane",
    "backend/compute/gpu/__init__.py": "",
    "backend/compute/gpu/launches.py": "import warp",
    "backend/compute/kernels/__init__.py": "",
    "backend/compute/kernels/planes.py": "import numba\nimport numpy\nfrom functools import cache\n"
    "from ...geometry.tolerances import NEAR_M",
    "backend/render/__init__.py": "",
    "backend/render/backends.py": "def choose():\n    from ..compute.cpu.backend import NumbaBackend\n"
    "if TYPE_CHECKING:\n    from ..compute.cpu import backend",
    "backend/training/__init__.py": "",
    "backend/training/command.py": "from ..surface.skin_version import is_current_skin",
    "backend/training/step.py": "from ..render.backends import choose",
    "livehand_blender/__init__.py": "",
    "livehand_blender/cli.py": "from .rig.hand import read",
    "livehand_blender/rig/__init__.py": "",
    "livehand_blender/rig/pose.py": "import bpy\nfrom ...backend.records.shot import HandPose",
    "livehand_blender/rig/hand.py": "from .pose import read",
    "livehand_blender/ui/__init__.py": "",
    "livehand_blender/ui/panels.py": "",
    "backend/research/__init__.py": "",
    "backend/research/rows.py": "",
    "tools/__init__.py": "",
    "tools/commands.py": "from ..backend.research.rows import ROWS",
}


def test_a_sound_tree_has_no_faults(tmp_path):
    assert faults(plant(tmp_path, SOUND)) == []


@pytest.mark.parametrize(
    ("file", "source", "fault"),
    [
        ("backend/records/shot.py", "import bpy", "backend.records.shot imports bpy"),
        ("backend/records/shot.py", "def f():\n    from mathutils import Matrix", "imports mathutils"),
        ("backend/records/shot.py", "from ...livehand_blender.rig import pose", "the backend knows nothing of Blender"),
        ("backend/field/field.py", "from ...livehand_blender.rig import pose", "the backend knows nothing of Blender"),
        (
            "backend/records/shot.py",
            "from livehand.backend.records import errors",
            "backend.records.shot imports livehand",
        ),
        ("backend/records/errors.py", "from ..hand.model import HandModel", "imports backend.hand.model, whose room"),
        ("backend/records/errors.py", "from . import shot", "cycle: backend.records.shot -> backend.records.errors"),
        (
            "backend/hand/model.py",
            "from .files import reading",
            "cycle of folders: backend.hand",
        ),
        (
            "backend/field/field.py",
            "def f():\n    from ..compute.cpu import backend",
            "imports backend.compute.cpu.backend, whose room",
        ),
        ("livehand_blender/rig/pose.py", "from . import hand", "cycle: livehand_blender.rig.hand"),
        ("livehand_blender/rig/pose.py", "from ..ui.panels import draw", "imports livehand_blender.ui.panels"),
        (
            "livehand_blender/rig/pose.py",
            "from ...backend.compute.cpu.backend import f",
            "imports backend.compute.cpu.backend, whose room",
        ),
        ("livehand_blender/rig/pose.py", "from .. import cli", "imports livehand_blender.cli, whose room"),
        ("backend/render/backends.py", "from ..research import rows", "what ships imports nothing that lies beside it"),
        ("livehand_blender/cli.py", "from ..tools import commands", "what ships imports nothing that lies beside it"),
        ("backend/training/step.py", "from ..light.lighting import openness", "takes the renderer's road"),
        ("backend/training/step.py", "def f():\n    from ..surface import skin_version", "takes the renderer's road"),
        ("backend/surprise.py", "", "backend.surprise is in no room"),
        ("backend/surprise/thing.py", "", "backend.surprise.thing is in no room"),
        ("backend/compute/kernels/planes.py", "from ...records.errors import E", "imports backend.records.errors"),
        ("backend/compute/kernels/planes.py", "import torch", "backend.compute.kernels.planes imports torch"),
        (
            "backend/render/backends.py",
            "from ..compute.cpu.backend import f",
            "imports backend.compute.cpu.backend outside a",
        ),
        (
            "backend/render/backends.py",
            "from ..compute.gpu.launches import f",
            "imports backend.compute.gpu.launches outside a",
        ),
        ("backend/compute/cpu/backend.py", "import warp as wp", "backend.compute.cpu.backend imports warp outside a"),
        ("backend/hand/model.py", "if True:\n    from numba import njit", "imports numba outside a function"),
    ],
)
def test_planted_faults_are_found(tmp_path, file, source, fault):
    found = faults(plant(tmp_path, {**SOUND, file: source}))
    assert any(fault in line for line in found), found

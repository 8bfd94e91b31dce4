"""Imports point one way: Blender side -> backend, and upper rows -> lower rows, without cycles.

Read from the source (AST), imports inside functions included. The last tests plant faults and see them found.
"""

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
ROOMS = ("backend", "livehand_blender")
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

# Rows from the bottom. The longest matching name counts; a module imports from rows below its own, or from its own
# folder. Whoever adds a module at the top of a room, or a folder, gives it a row here.
ROWS = [
    (
        "backend.avatars",
        "backend.errors",
        "backend.idle_threads",
        "backend.kernels",
        "backend.profile",
        "backend.rotation",
    ),
    (
        "backend.avatar_card",
        "backend.camera",
        "backend.colour",
        "backend.device",
        "backend.picture",
        "backend.command",
        "backend.geometry.rotation",
        "backend.hand.atlas",
        "backend.hand.gestures",
        "backend.hand.mano_pickle",
        "backend.perceptual",
        "backend.volume",
    ),
    ("backend.shot", "backend.framing"),
    ("backend.hand",),
    ("backend.hand.lbs", "backend.geometry", "backend.composition"),
    ("backend.hand.builtin", "backend.field", "backend.rays", "backend.window"),
    ("backend.superres", "backend.sampler", "backend.surface_maps"),
    ("backend.cpu", "backend.image", "backend.develop"),
    ("backend.tracing", "backend.shading"),
    ("backend.avatar", "backend.capture"),
    ("backend.renderer", "backend.capture_check", "backend.importing"),
    ("backend.training", "backend.evaluation.metrics", "backend.pose_files", "backend.portrait"),
    ("backend.pose_files.formats", "backend.pose_files.landmarks"),
    ("backend.pose_files.opening", "backend.pose_files.describe", "backend.foreign_rig"),
    ("backend.training.pose_fit",),
    ("backend.evaluation", "backend.benchmark"),
    ("backend.training.preview",),
    ("backend.training.loop",),
    (
        "backend.training.command",
        "backend.evaluation.command",
        "backend.benchmark.command",
        "backend.inspect_command",
        "backend.portrait_command",
        "backend.importing.interhand_command",
        "backend.importing.mask_command",
        "backend.importing.transforms_command",
        "backend.pose_files.render_command",
    ),
    ("backend.cli",),
    ("backend",),
    ("livehand_blender.foreign_rig.properties",),
    ("livehand_blender.dependencies", "livehand_blender.properties", "livehand_blender.stdout", "livehand_blender.rig"),
    ("livehand_blender.scene", "livehand_blender.preferences", "livehand_blender.rig.mocap"),
    ("livehand_blender.render.task", "livehand_blender.render.frame_queue", "livehand_blender.gallery"),
    ("livehand_blender.render.session",),
    ("livehand_blender.viewport",),
    (
        "livehand_blender.render",
        "livehand_blender.capture",
        "livehand_blender.compositing",
        "livehand_blender.motion",
    ),
    ("livehand_blender.foreign_rig",),
    ("livehand_blender.ui", "livehand_blender.benchmark", "livehand_blender.blender_command"),
    ("livehand_blender.registration",),
    ("livehand_blender",),
    ("",),  # the repository's root, the package `livehand`
    ("livehand_blender.capture.command", "livehand_blender.benchmark.command", "livehand_blender.foreign_rig.command"),
    ("livehand_blender.cli",),
]
ROW_OF = {name: row for row, names in enumerate(ROWS) for name in names}
# numba may be missing: only these rooms import it, and nobody else imports their modules but inside a function.
NUMBA_ROOMS = ("backend.kernels", "backend.cpu")
WITHOUT_NUMBA = {"backend.kernels", "backend.kernels.tolerances"}
# Beside the interpreter's own modules.
FOREIGN_OF_KERNELS = {"numba", "numpy"}
# Names that stand for themselves only, not for all that lies below them.
EXACT = {"", "backend", "livehand_blender"}

# Where the Blender side may enter the backend, and who may go further.
DOORS = (
    "avatars",
    "errors",
    "idle_threads",
    "rotation",
    "composition",
    "surface_maps",
    "shot",
    "camera",
    "capture",
    "hand.model",
    "hand.model_file",
    "avatar",
    "avatar_card",
    "renderer",
)
MORE_DOORS = {
    # Finger controls are gestures.
    "livehand_blender.rig": ("hand.gestures", "hand.poses"),
    "livehand_blender.ui.shape": ("hand.measurements",),
    # Captures are rendered from the built-in hand's detailed surface, not from what an avatar sees.
    "livehand_blender.capture": ("hand.builtin", "hand.gestures", "hand.lbs", "geometry.rotation"),
    # Cycles on the benchmark's own frames, timed by its stopwatch.
    "livehand_blender.benchmark": ("benchmark", "hand.builtin", "command"),
    # Motions from and to files.
    "livehand_blender.motion": ("pose_files",),
    "livehand_blender.ui.motion": ("pose_files",),
    "livehand_blender.ui.motion_export": ("pose_files",),
    # Their bones, their motion, their mesh as a hand model.
    "livehand_blender.foreign_rig": ("foreign_rig", "pose_files"),
    "livehand_blender.ui.foreign_rig": ("foreign_rig",),
    "livehand_blender.ui.hand_model": ("foreign_rig",),
    # One command line for both halves.
    "livehand_blender.cli": ("cli", "command", "pose_files.render_command", "pose_files.document"),
    "livehand_blender.capture.command": ("command",),
    "livehand_blender.render.command": ("command",),
    "livehand_blender.render.report": ("command",),
    "livehand_blender.render.workers": ("command",),
    "livehand_blender.blender_command": ("command",),
}


def modules(root):
    """Dotted name below the root -> file; the root package itself is ''."""
    files = [root / "__init__.py", *(path for room in ROOMS for path in (root / room).rglob("*.py"))]
    return {name_of(path.relative_to(root)): path for path in files if path.is_file()}


def name_of(path):
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def imports(name, path, known, only_at_once=False):
    """(names of our modules, names of foreign top-level modules) that a module imports, or imports when imported."""
    ours, foreign = set(), set()
    parts = [part for part in name.split(".") if part]
    package = parts if path.name == "__init__.py" else parts[:-1]
    tree = ast.parse(path.read_text())
    for node in run_at_once(tree) if only_at_once else ast.walk(tree):
        if isinstance(node, ast.Import):
            foreign |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and not node.level:
            foreign.add((node.module or "").partition(".")[0])
        elif isinstance(node, ast.ImportFrom):
            above = package[: len(package) - (node.level - 1)]
            base = ".".join([*above, *([node.module] if node.module else [])])
            members = {f"{base}.{alias.name}".lstrip(".") for alias in node.names}
            found = {member for member in members if member in known}
            ours |= found | ({base} if len(found) < len(members) else set())
    return ours, foreign


def run_at_once(node):
    """All nodes but those in functions and behind `if TYPE_CHECKING`."""
    yield node
    is_typing = isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    if not (is_typing or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)):
        for child in ast.iter_child_nodes(node):
            yield from run_at_once(child)


def is_in(name, rooms):
    return any(name == room or name.startswith(f"{room}.") for room in rooms)


def row_of(name):
    parts = name.split(".")
    prefixes = [".".join(parts[:n]) for n in range(len(parts), 0, -1)] if name else [""]
    allowed = [prefix for prefix in prefixes if prefix in ROW_OF and (prefix == name or prefix not in EXACT)]
    return ROW_OF[allowed[0]] if allowed else None


def same_folder(a, b):
    folder_a, folder_b = a.rpartition(".")[0], b.rpartition(".")[0]
    return folder_a == folder_b and folder_a.count(".") >= 1


def may_enter(importer, imported):
    doors = list(DOORS)
    for room, more in MORE_DOORS.items():
        if importer == room or importer.startswith(room + "."):
            doors += more
    inside = imported.removeprefix("backend.")
    return any(inside == door or inside.startswith(door + ".") for door in doors)


def faults(root):
    """Every broken rule, in words."""
    known = modules(root)
    graph, found = {}, []
    for name, path in known.items():
        ours, foreign = imports(name, path, known)
        graph[name] = ours & known.keys()
        found += foreign_faults(name, foreign)
        found += numba_faults(name, *imports(name, path, known, only_at_once=True))
        found += [fault for imported in sorted(graph[name]) for fault in arrow_faults(name, imported)]
        found += [f"{name} has no row; add it to ROWS"] * (row_of(name) is None)
    return found + [f"cycle: {' -> '.join(cycle)}" for cycle in cycles(graph)]


def foreign_faults(name, foreign):
    is_backend = name.partition(".")[0] == "backend"
    blender = sorted(foreign & BLENDER_MODULES) if is_backend else []
    absolute = sorted(foreign & {"livehand", *ROOMS})
    heavy = sorted(foreign - FOREIGN_OF_KERNELS - sys.stdlib_module_names) if is_in(name, NUMBA_ROOMS[:1]) else []
    return [f"{name} imports {module}" for module in sorted({*blender, *absolute, *heavy})]


def numba_faults(name, ours, foreign):
    if is_in(name, NUMBA_ROOMS):
        return []
    theirs = {module for module in ours - WITHOUT_NUMBA if is_in(module, NUMBA_ROOMS)}
    return [f"{name} imports {module} outside a function" for module in sorted(theirs | (foreign & {"numba"}))]


def arrow_faults(name, imported):
    rows = row_of(name), row_of(imported)
    if None in rows:
        return []
    if imported.startswith("backend.") and name.startswith("livehand_blender") and not may_enter(name, imported):
        return [f"{name} enters the backend by {imported}, which is no door"]
    if rows[1] >= rows[0] and not same_folder(name, imported):
        return [f"{name} imports {imported}, which does not lie below it"]
    return []


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


def test_imports_point_one_way():
    assert faults(ROOT) == []


def plant(root, files):
    for name, source in files.items():
        path = root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(source)
    return root


SOUND = {
    "__init__.py": "def register():\n    from . import livehand_blender\n",
    "backend/__init__.py": "",
    "backend/errors.py": "import numpy",
    "backend/kernels/__init__.py": "",
    "backend/kernels/planes.py": "import numba\nimport numpy\nfrom functools import cache",
    "backend/kernels/tolerances.py": "",
    "backend/shot.py": "from .errors import LiveHandError\nfrom .kernels.tolerances import NEAR_M\n"
    "def draw():\n    from .kernels.planes import read_plane\n"
    "if TYPE_CHECKING:\n    from .kernels import planes",
    "backend/hand/__init__.py": "",
    "backend/hand/model.py": "from ..shot import Side",
    "livehand_blender/__init__.py": "",
    "livehand_blender/rig/__init__.py": "",
    "livehand_blender/rig/pose.py": "import bpy\nfrom ...backend.shot import HandPose",
    "livehand_blender/rig/hand.py": "from .pose import read",
}


def test_a_sound_tree_has_no_faults(tmp_path):
    assert faults(plant(tmp_path, SOUND)) == []


@pytest.mark.parametrize(
    ("file", "source", "fault"),
    [
        ("backend/shot.py", "import bpy", "backend.shot imports bpy"),
        ("backend/shot.py", "def f():\n    from mathutils import Matrix", "backend.shot imports mathutils"),
        (
            "backend/shot.py",
            "from ..livehand_blender.rig import pose",
            "backend.shot imports livehand_blender.rig.pose",
        ),
        ("backend/shot.py", "from livehand.backend import errors", "backend.shot imports livehand"),
        ("backend/errors.py", "from .hand.model import HandModel", "backend.errors imports backend.hand.model"),
        ("backend/errors.py", "from . import shot", "cycle: backend.errors -> backend.shot -> backend.errors"),
        ("livehand_blender/rig/pose.py", "from . import hand", "cycle: livehand_blender.rig.hand"),
        ("livehand_blender/rig/pose.py", "from ..ui.panels import draw", "imports livehand_blender.ui.panels"),
        ("livehand_blender/rig/pose.py", "from ...backend.volume import render", "backend.volume, which is no door"),
        ("backend/surprise.py", "", "backend.surprise has no row"),
        ("backend/kernels/march.py", "from ..errors import LiveHandError", "backend.kernels.march imports backend.err"),
        ("backend/kernels/march.py", "import torch", "backend.kernels.march imports torch"),
        ("backend/shot.py", "from .kernels.march import march", "imports backend.kernels.march outside a function"),
        ("backend/hand/model.py", "if True:\n    from numba import njit", "imports numba outside a function"),
    ],
)
def test_planted_faults_are_found(tmp_path, file, source, fault):
    also = ["backend/volume.py", "backend/kernels/march.py"]
    also = dict.fromkeys([*also, "livehand_blender/ui/__init__.py", "livehand_blender/ui/panels.py"], "")
    found = faults(plant(tmp_path, {**SOUND, **also, file: source}))
    assert any(fault in line for line in found), found

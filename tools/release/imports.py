"""What a zip's modules import: read from their sources, inside functions too, so that nothing has to run."""

from __future__ import annotations

import ast
import zipfile
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

ENTRIES = ("__init__.py", "livehand_blender/registration.py", "backend/render/session.py")
"""Where Blender begins, and the road on which a frame is rendered."""
AT_ONCE = (*ENTRIES, "backend/render/renderer.py", "backend/render/relightable.py", "backend/render/baked.py")
"""What must import without any feature's own packages."""


@dataclass(frozen=True)
class Imports:
    """The imports of modules that are reached from the entries.

    Attributes:
        modules: files of the modules that are reached, also those that are not there.
        foreign: name at the top of Python's path -> files that import it.
    """

    modules: frozenset[PurePosixPath]
    foreign: Mapping[str, frozenset[PurePosixPath]]


def sources_of_zip(path: Path) -> dict[PurePosixPath, str]:
    """Read the Python files of a zip."""
    with zipfile.ZipFile(path) as archive:
        names = (name for name in archive.namelist() if name.endswith(".py"))
        return {PurePosixPath(name): archive.read(name).decode("utf-8") for name in names}


def imports_of(
    sources: Mapping[PurePosixPath, str], entries: Iterable[str] = ENTRIES, only_at_once: bool = False
) -> Imports:
    """Follow the imports from the entries; `only_at_once`: those that run when a module is imported, not later."""
    waiting = [PurePosixPath(entry) for entry in entries]
    reached: set[PurePosixPath] = set()
    foreign: dict[str, set[PurePosixPath]] = {}
    while waiting:
        module = waiting.pop()
        if module in reached:
            continue
        reached.add(module)
        waiting += [init for folder in module.parents if (init := folder / "__init__.py") in sources]
        tree = ast.parse(sources.get(module, ""))
        for node in _run_at_once(tree) if only_at_once else ast.walk(tree):
            if isinstance(node, ast.Import):
                for alias in node.names:
                    foreign.setdefault(alias.name.partition(".")[0], set()).add(module)
            elif isinstance(node, ast.ImportFrom) and not node.level:
                foreign.setdefault(str(node.module).partition(".")[0], set()).add(module)
            elif isinstance(node, ast.ImportFrom):
                waiting += _relative(module, node, sources)
    return Imports(frozenset(reached), {name: frozenset(by) for name, by in foreign.items()})


def _run_at_once(node: ast.AST) -> Iterator[ast.AST]:
    yield node
    is_typing = isinstance(node, ast.If) and isinstance(node.test, ast.Name) and node.test.id == "TYPE_CHECKING"
    if not (is_typing or isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)):
        for child in ast.iter_child_nodes(node):
            yield from _run_at_once(child)


def _relative(
    module: PurePosixPath, node: ast.ImportFrom, sources: Mapping[PurePosixPath, str]
) -> Iterator[PurePosixPath]:
    """List the files that `from .a import b` takes: a module `a` with a name `b`, or a package with a module `b`."""
    base = module.parents[node.level - 1].joinpath(*(node.module or "").split("."))
    itself = base.with_name(f"{base.name}.py") if base.name else base / "__init__.py"
    if itself in sources:
        yield itself
        return
    if base.name and base / "__init__.py" not in sources:
        yield itself  # it is not there, which a check tells
        return
    for alias in node.names:
        inner = (base / f"{alias.name}.py", base / alias.name / "__init__.py")
        yield from (file for file in inner if file in sources)

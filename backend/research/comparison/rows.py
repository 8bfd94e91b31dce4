"""The rows of the tables: which there are, what they cost, and a researcher's own."""

from __future__ import annotations

import importlib
import os
import re
import sys
from collections.abc import Sequence
from dataclasses import dataclass

from ...capture.capture import Capture
from ...records.errors import LiveHandError
from ..baselines.a_nerf import A_NERF
from ..baselines.avatar_rows import AVATAR_ROWS, PATCH_PX, REFINED, SAMPLES, AvatarRow
from ..baselines.hierarchical import HIERARCHICAL
from ..baselines.lisa import LISA
from ..baselines.mesh_wrapping import MESH_TEXTURE, MESH_WRAPPING
from ..baselines.method import Budget, Method
from ..baselines.smplpix import SMPLPIX
from . import misfit
from .misfit import Misfit
from .published import TITLES

_AVATARS = {row.name: row for row in (*AVATAR_ROWS, REFINED)}
METHODS: tuple[Method, ...] = (
    *(MESH_WRAPPING, MESH_TEXTURE, SMPLPIX, A_NERF, LISA),
    *(_AVATARS[name] for name in ("xyz", "bones", "no_pose")),
    HIERARCHICAL,
    *(_AVATARS[name] for name in ("no_sr", "no_sr_patch", "no_sr_full", "bilinear")),
    *(_AVATARS[name] for name in ("paper", "default", "default_refined")),
)
"""In the tables' order."""
TABLES = tuple(TITLES)

# Core-minutes of 2,000 steps on images of 167 x 256, evaluation included: estimates from counts of operations, and for
# A-NeRF and LISA from a few steps on a busy machine.
_CORE_MINUTES = {
    "mesh_wrapping": 3.0,
    "mesh_texture": 3.0,
    "smplpix": 31.0,
    "a_nerf": 52.0,
    "lisa": 100.0,
    "paper": 26.0,
    "no_pose": 26.0,
    "xyz": 53.0,
    "bones": 26.0,
    "hierarchical": 54.0,
    "no_sr": 22.0,
    "no_sr_full": 30.0,
    "no_sr_patch": 12.0,
    "bilinear": 19.0,
    "default": 10.0,
    "default_refined": 20.0,
}
_UNKNOWN = 30.0
_REFERENCE_STEPS, _REFERENCE_PX = 2000, 167 * 256
_NOT_TRAINED = ("mesh_wrapping", "mesh_texture")


@dataclass(frozen=True)
class Row:
    """A method in the tables; with a misfit, at one level of it.

    Attributes:
        method: what is fitted.
        tables: in which it stands.
        misfit: None: the capture as it is.
    """

    method: Method
    tables: tuple[str, ...]
    misfit: Misfit | None = None

    @property
    def name(self) -> str:
        """Of the row, and of its folder."""
        return self.method.name if self.misfit is None else f"{self.method.name}@{self.misfit.name}"

    @property
    def label(self) -> str:
        """In the tables."""
        return self.method.label if self.misfit is None else f"{self.method.label}, {self.misfit.name}"

    def core_minutes(self, budget: Budget, capture: Capture) -> float:
        """Estimate the cost on this capture."""
        known = _CORE_MINUTES.get(self.method.name, _UNKNOWN)
        if budget.core_minutes is not None and self.method.name not in _NOT_TRAINED:
            return budget.core_minutes
        views = capture.of_split("train") or capture.views
        width, height = views[0].camera.size_px
        steps = 1.0 if self.method.name in _NOT_TRAINED else budget.steps / _REFERENCE_STEPS
        return known * steps * width * height / _REFERENCE_PX


@dataclass(frozen=True)
class AvatarSettings:
    """What holds for every avatar's row.

    Attributes:
        samples: a ray.
        has_loss_of_paper: squared error and LPIPS 1 : 1 instead of the rows' own loss.
        patch_px: side of the patch that the row of patches sees.
    """

    samples: int = SAMPLES
    has_loss_of_paper: bool = False
    patch_px: int = PATCH_PX

    def applied(self, method: Method) -> Method:
        """Return an avatar's row with these settings; other methods have none of them."""
        if not isinstance(method, AvatarRow):
            return method
        row = method if self.samples == SAMPLES else method.with_samples(self.samples)
        return row.with_loss_of_paper(self.patch_px) if self.has_loss_of_paper else row


def chosen_rows(
    tables: Sequence[str],
    names: Sequence[str] | None,
    own: Sequence[Method] = (),
    avatars: AvatarSettings | None = None,
) -> list[Row]:
    """Select the rows of these tables, or those of these names among them.

    Args:
        tables: names of tables.
        names: of rows; a misfit's method names all its levels.
        own: methods of the user's, which stand in the tables that they name.
        avatars: of every avatar's row.

    Raises:
        LiveHandError: a table or row is not known, or two rows have one name.
    """
    unknown = [table for table in tables if table not in TABLES]
    if unknown:
        raise LiveHandError(f"tables must be of {', '.join(TABLES)}, got {unknown[0]!r}")
    settings = avatars or AvatarSettings()
    methods = [settings.applied(method) for method in METHODS] + list(own)
    repeated = [m.name for k, m in enumerate(methods) if m.name in {other.name for other in methods[:k]}]
    if repeated:
        raise LiveHandError(f"every row must have a name of its own, got two of '{repeated[0]}'; rename yours")
    rows = [Row(method, shown) for method in methods if (shown := _shown(method, tables))]
    if "misfit" in tables:
        levels = [Misfit(level) for level in (*misfit.SIGMAS_MM, *misfit.SHAPES)]
        stands = [method for method in methods if "misfit" in method.tables or method.name in misfit.ROWS]
        rows += [Row(method, ("misfit",), level) for method in stands for level in levels]
    if names is None:
        return rows
    known = {row.name for row in rows} | {row.method.name for row in rows}
    missing = [name for name in names if name not in known]
    if missing:
        raise LiveHandError(f"rows must be of {', '.join(sorted(known))}, got {missing[0]!r}")
    return [row for row in rows if row.name in names or row.method.name in names]


def _shown(method: Method, tables: Sequence[str]) -> tuple[str, ...]:
    """List the tables in which a method stands as it is."""
    return tuple(table for table in method.tables if table in tables and table != "misfit")


def load_own_method(text: str) -> Method:
    """Load a method by `MODULE:NAME`; modules in the current folder are found.

    Raises:
        LiveHandError: there is none, or it is no method.
    """
    module_name, _, name = text.partition(":")
    sys.path.insert(0, os.getcwd())
    try:
        method = getattr(importlib.import_module(module_name), name)
    except (ImportError, AttributeError, ValueError) as error:
        raise LiveHandError(
            f"--method must be MODULE:NAME of an object that can be imported, got {text!r}: {error}"
        ) from error
    finally:
        sys.path.remove(os.getcwd())
    if not isinstance(method, Method):
        needed = "name, label, tables, version, notes, fit and load"
        raise LiveHandError(f"a method must have {needed}, {text} is {type(method).__name__} without all of them")
    if not re.fullmatch(r"[\w-]+", method.name):
        raise LiveHandError(f"a row's name must be of letters, digits, _ and -, got {method.name!r}")
    unknown = [table for table in method.tables if table not in TABLES]
    if unknown or not method.tables:
        raise LiveHandError(f"a row must stand in tables of {', '.join(TABLES)}, got {list(method.tables)}")
    return method

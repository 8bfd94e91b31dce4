"""Makes the file of the built-in hand's detail surface (`surface/detail_surface.py`) from the detailed surface.

python -m livehand.tools.builtin_hand.fine_offsets FOLDER
"""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path

import numpy as np

from ...backend.hand.model import HandModel
from ...backend.hand.model_file import load_default_hand
from ...backend.surface.base_surface import SURFACE_FILE, file_arrays
from ...backend.surface.detail_surface import LEVELS, DetailSurface, PoseDisplacement, surface_arrays
from ...backend.system.readers import npz_bytes
from ...backend.teacher.detailed_surface import DetailedSurface, detailed_surface
from ...backend.teacher.loop import neighbour_mean, subdivide

OUT_OF_CHORDS = 1 / 6
"""Of a vertex's height over its neighbours' mean, by which it is raised: its triangles, chords of the surface, then lie
inside as much as outside of it (on a sphere, edges' middles are 1/4 of that height below it, their ends on it)."""


def fine_surface(model: HandModel, detail: DetailedSurface) -> DetailSurface:
    """Sample every vertex of the detailed surface that a subdivision of fewer levels has, too."""
    coarse = subdivide(model.f, model.vt[model.ft], len(model.v_template), LEVELS)
    count = int(coarse.faces.max()) + 1
    vertices = detail.vertices_m[:count]  # every level's vertices begin with those of the level before
    raised = vertices + OUT_OF_CHORDS * (vertices - neighbour_mean(coarse.faces, count) @ vertices)
    forms = tuple(replace(form, height_mm=form.height_mm[:count]) for form in detail.forms)
    return DetailSurface(
        offset_m=raised - coarse.matrix @ model.v_template,
        raised=PoseDisplacement(forms, detail.masks["vein"][:count], detail.flex_axis, np.zeros(count)),
    )


def main() -> None:
    """Write the file."""
    parser = argparse.ArgumentParser(description="Make the file of the built-in hand's fine surface.")
    parser.add_argument("folder", type=Path, help="where to write it")
    folder, model = parser.parse_args().folder, load_default_hand()
    arrays = surface_arrays(fine_surface(model, detailed_surface(model)))
    (folder / SURFACE_FILE).write_bytes(npz_bytes(file_arrays(SURFACE_FILE, arrays)))


if __name__ == "__main__":
    main()

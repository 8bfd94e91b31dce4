"""The materials of a hand model: a .blend file with its mesh and its look."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...backend.hand.model import HandModel
from ...backend.records.errors import LiveHandError

MODEL_KEY = "livehand_model_sha256"
"""Custom property of a look's mesh with the sha256 of its hand model."""


def materials_path(model_path: Path) -> Path:
    """Return the path of a hand model's look, beside the model."""
    return model_path.with_suffix(".blend")


def append_materials(model: HandModel, path: Path) -> bpy.types.Object:
    """Append the mesh of a look's .blend to the current scene.

    Raises:
        LiveHandError: the file cannot be read, or does not contain exactly one mesh with this model's vertices.
    """
    if not path.is_file():
        raise LiveHandError(f"no look at {path}; pass the .blend that livehand make-hand wrote")
    try:
        with bpy.data.libraries.load(str(path)) as (source, loaded):
            loaded.objects = list(source.objects)
    except (OSError, RuntimeError) as error:
        raise LiveHandError(f"{path} must be a .blend with the hand's look ({error})") from error
    count = len(model.v_template)
    fitting = [found for found in loaded.objects if found.type == "MESH" and len(found.data.vertices) == count]
    if len(fitting) != 1:
        raise LiveHandError(
            f"{path} must hold one mesh of the {count} vertices of '{model.name}', got {len(fitting)}; "
            "make the hand and its look again with livehand make-hand"
        )
    (mesh,) = fitting
    if mesh.get(MODEL_KEY, model.sha256) != model.sha256:
        raise LiveHandError(f"{path} must be the look of '{model.name}', got that of another hand; make both again")
    bpy.context.scene.collection.objects.link(mesh)
    mesh.parent = None
    mesh.matrix_world.identity()
    return mesh

"""The file of a hand model's look: where it lies, and its mesh."""

from __future__ import annotations

from pathlib import Path

import bpy

from ...backend.hand.model import HandModel
from ...backend.records.errors import LiveHandError

MODEL_KEY = "livehand_model_sha256"
"""The property of a look's mesh that says which hand model it is the look of."""


def look_path(model_path: Path) -> Path:
    """Where a hand model's look lies: beside it."""
    return model_path.with_suffix(".blend")


def append_look(model: HandModel, path: Path) -> bpy.types.Object:
    """The mesh of a look's .blend, appended to the current scene.

    Raises:
        LiveHandError: the file cannot be read, or does not hold one mesh of this model's vertices.
    """
    if not path.is_file():
        raise LiveHandError(f"no look at {path}; give the .blend that livehand make-hand has written")
    try:
        with bpy.data.libraries.load(str(path)) as (there, wanted):
            wanted.objects = list(there.objects)
    except (OSError, RuntimeError) as error:
        raise LiveHandError(f"{path} must be a .blend with the hand's look ({error})") from error
    fitting = [
        thing for thing in wanted.objects if thing.type == "MESH" and len(thing.data.vertices) == len(model.v_template)
    ]
    if len(fitting) != 1:
        raise LiveHandError(
            f"{path} must hold one mesh of the {len(model.v_template)} vertices of '{model.name}', got {len(fitting)}; "
            "make the hand and its look again by livehand make-hand"
        )
    (look,) = fitting
    if look.get(MODEL_KEY, model.sha256) != model.sha256:
        raise LiveHandError(f"{path} must be the look of '{model.name}', it is another hand's; make both again")
    bpy.context.scene.collection.objects.link(look)
    look.parent = None
    look.matrix_world.identity()
    return look

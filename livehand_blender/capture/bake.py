"""Bakes the pose-independent skin to three float maps; the procedural bump would triple the render time."""

from __future__ import annotations

import contextlib
import hashlib
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

from ...backend.system.files import replacing
from ..scene.file_paths import operator_path
from .node_graph import NodeGraph, Socket, enable_nodes
from .skin import MASKS, SkinChannels, SkinTone, procedural_channels

MAPS = ("albedo", "height", "mask")

_MASK_PX = 2048
_MADE_OF = "maps.sha256"  # beside the maps: of what they show


def bake_skin(surface: bpy.types.Object, folder: Path, tone: SkinTone, size_px: int = 2048) -> dict[str, Path]:
    """Write `albedo.exr`, `height.exr` and `mask.exr` (linear) to the folder; returns their paths.

    Maps that are there are kept if they are of this tone, size and surface, and written anew if not.
    """
    paths = {name: folder / f"{name}.exr" for name in MAPS}
    record, made_of = folder / _MADE_OF, _sha256_of_maps(surface, tone, size_px)
    if all(path.is_file() for path in (record, *paths.values())) and record.read_text("ascii", "replace") == made_of:
        return paths
    folder.mkdir(parents=True, exist_ok=True)
    record.unlink(missing_ok=True)
    material = bpy.data.materials.new("bake")
    surface.data.materials.clear()
    surface.data.materials.append(material)
    graph, emission = _emissive(material)
    with _bake_sampling(bpy.context.scene.cycles):
        for name, socket in _map_sockets(graph, procedural_channels(graph, tone)).items():
            graph.connect(socket, emission.inputs[0])
            _bake_emission(surface, graph, paths[name], size_px)
    surface.data.materials.clear()
    bpy.data.materials.remove(material)
    with replacing(record) as temporary:
        temporary.write_text(made_of, "ascii")
    return paths


def bake_mask(surface: bpy.types.Object, name: str, path: Path) -> None:
    """Write one of the surface's masks as a map (linear)."""
    material = bpy.data.materials.new("bake")
    surface.data.materials.clear()
    surface.data.materials.append(material)
    graph, emission = _emissive(material)
    with _bake_sampling(bpy.context.scene.cycles):
        graph.connect(graph.attribute(name), emission.inputs[0])
        _bake_emission(surface, graph, path, _MASK_PX)
    surface.data.materials.clear()
    bpy.data.materials.remove(material)


def _sha256_of_maps(surface: bpy.types.Object, tone: SkinTone, size_px: int) -> str:
    """Digest all that the maps are made of: the tone, their size, and the surface's masks."""
    digest = hashlib.sha256(repr((tone, size_px)).encode())
    for name in MASKS:
        data = surface.data.attributes[name].data
        values = np.empty(len(data), np.float32)
        data.foreach_get("value", values)
        digest.update(values.tobytes())
    return digest.hexdigest()


@contextlib.contextmanager
def _bake_sampling(cycles: bpy.types.PropertyGroup) -> Iterator[None]:
    """Bake noise-free emission: within, a few samples filter the texture, and nothing is denoised."""
    before = cycles.samples, cycles.use_denoising
    cycles.samples, cycles.use_denoising = 4, False
    try:
        yield
    finally:
        cycles.samples, cycles.use_denoising = before


def _emissive(material: bpy.types.Material) -> tuple[NodeGraph, bpy.types.Node]:
    tree = enable_nodes(material)
    tree.nodes.remove(tree.nodes["Principled BSDF"])
    graph = NodeGraph(tree)
    emission = graph.node("ShaderNodeEmission")
    graph.connect(emission.outputs[0], tree.nodes["Material Output"].inputs[0])
    return graph, emission


def _map_sockets(graph: NodeGraph, channels: SkinChannels) -> dict[str, Socket]:
    return {
        "albedo": channels.albedo,
        "height": graph.combine(channels.relief, channels.fold_dorsal, channels.fold_palmar),
        "mask": graph.combine(channels.roughness, channels.subsurface, channels.knuckle),
    }


def _bake_emission(surface: bpy.types.Object, graph: NodeGraph, path: Path, size_px: int) -> None:
    image = bpy.data.images.new(path.stem, size_px, size_px, float_buffer=True, alpha=False)
    image.colorspace_settings.name = "Non-Color"
    target = graph.node("ShaderNodeTexImage")
    target.image = image
    graph.tree.nodes.active = target
    bpy.context.view_layer.objects.active = surface
    surface.select_set(True)
    bpy.ops.object.bake(type="EMIT", margin=12, use_clear=True, target="IMAGE_TEXTURES")
    image.file_format = "OPEN_EXR"
    with replacing(path) as temporary:
        image.filepath_raw = operator_path(temporary)
        image.save()
    graph.tree.nodes.remove(target)
    bpy.data.images.remove(image)

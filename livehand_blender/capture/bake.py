"""Bakes the pose-independent skin to three float maps; the procedural bump would triple the render time."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path

import bpy

from ...backend.system.files import replacing
from ..scene.file_paths import operator_path
from .node_graph import NodeGraph, Socket, enable_nodes
from .skin import SkinChannels, SkinTone, procedural_channels

MAPS = ("albedo", "height", "mask")

_MASK_PX = 2048


def bake_skin(surface: bpy.types.Object, folder: Path, tone: SkinTone, size_px: int = 2048) -> dict[str, Path]:
    """Write `albedo.exr`, `height.exr` and `mask.exr` (linear) to the folder unless all exist; returns their paths."""
    paths = {name: folder / f"{name}.exr" for name in MAPS}
    if all(path.is_file() for path in paths.values()):
        return paths
    folder.mkdir(parents=True, exist_ok=True)
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

"""The skin of captures: a procedural Cycles material that is baked once; its folds and blanching follow the pose.

Its inputs are vertex attributes: the masks of the detailed surface (`backend/hand/builtin/skin_masks.py`), `rest` (rest
position, mm) and `flex` (bend of the nearest joint, 1 = 65 degrees). Colours are linear Rec.709.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from pathlib import Path

import bpy

from .node_graph import NodeGraph, Socket, enable_nodes

MASKS = (
    "palm", "nail", "naily", "nailedge", "tfold", "foldd", "foldp", "red", "tip", "vein", "crease", "knuck",
)  # fmt: skip
UV_LAYER = "uv"


@dataclass(frozen=True)
class SkinTone:
    """The colours of a skin, linear Rec.709."""

    dorsal: tuple[float, float, float] = (0.62, 0.355, 0.25)
    palm: tuple[float, float, float] = (0.77, 0.465, 0.385)
    warm_patch: tuple[float, float, float] = (0.64, 0.31, 0.22)
    pale_patch: tuple[float, float, float] = (0.74, 0.485, 0.375)
    dark_patch: tuple[float, float, float] = (0.49, 0.25, 0.18)
    redness: tuple[float, float, float] = (0.74, 0.30, 0.24)
    vein: tuple[float, float, float] = (0.42, 0.30, 0.28)
    freckle: tuple[float, float, float] = (0.36, 0.17, 0.10)
    pore: tuple[float, float, float] = (0.50, 0.25, 0.175)
    fold: tuple[float, float, float] = (0.45, 0.185, 0.125)
    blanch: tuple[float, float, float] = (0.76, 0.53, 0.41)
    nail_bed: tuple[float, float, float] = (0.72, 0.42, 0.345)
    lunula: tuple[float, float, float] = (0.82, 0.61, 0.53)
    nail_flush: tuple[float, float, float] = (0.74, 0.34, 0.27)
    nail_free_edge: tuple[float, float, float] = (0.80, 0.71, 0.60)
    nail_border: tuple[float, float, float] = (0.46, 0.19, 0.13)


SKIN_TONES = {
    "light": SkinTone(),
    # Dark back and light palm; creases are more visible than veins and redness.
    "deep": SkinTone(
        dorsal=(0.185, 0.080, 0.042),
        palm=(0.50, 0.255, 0.165),
        warm_patch=(0.20, 0.075, 0.036),
        pale_patch=(0.24, 0.115, 0.065),
        dark_patch=(0.115, 0.046, 0.024),
        redness=(0.26, 0.085, 0.050),
        vein=(0.125, 0.058, 0.040),
        freckle=(0.075, 0.028, 0.015),
        pore=(0.125, 0.052, 0.028),
        fold=(0.095, 0.036, 0.019),
        blanch=(0.27, 0.130, 0.072),
        nail_bed=(0.47, 0.245, 0.175),
        lunula=(0.58, 0.40, 0.32),
        nail_flush=(0.42, 0.18, 0.125),
        nail_free_edge=(0.72, 0.62, 0.50),
        nail_border=(0.095, 0.036, 0.021),
    ),
}


@dataclass(frozen=True)
class SkinChannels:
    """The pose-independent properties of the skin, as sockets of one graph.

    Attributes:
        albedo: base colour.
        roughness: of the specular lobe.
        subsurface: weight of the subsurface lobe.
        relief: height of pores, cells and veins, mm.
        fold_dorsal: depth of the wrinkles on the back of the joints, which flatten when the joint bends.
        fold_palmar: depth of the creases, which deepen when the joint bends.
        knuckle: where bending blanches the skin.
    """

    albedo: Socket
    roughness: Socket
    subsurface: Socket
    relief: Socket
    fold_dorsal: Socket
    fold_palmar: Socket
    knuckle: Socket


@dataclass(frozen=True)
class _Noises:
    """Noise of three feature sizes, shared by the channels."""

    position: Socket
    low: Socket
    mid: Socket
    high: Socket

    @classmethod
    def of(cls, graph: NodeGraph) -> _Noises:
        rest_mm = graph.attribute("rest", "Vector")
        sizes = ((0.045, 3, 0.55), (0.16, 4, 0.6), (0.9, 3, 0.6))
        return cls(rest_mm, *(graph.noise(rest_mm, *size) for size in sizes))


def procedural_channels(graph: NodeGraph, tone: SkinTone) -> SkinChannels:
    """The skin from masks and noise; it is baked, because shading it is slow."""
    masks = {name: graph.attribute(name) for name in MASKS}
    noises = _Noises.of(graph)
    fold_dorsal, fold_palmar = _folds(graph, masks, noises)
    albedo = _nail_colour(graph, _skin_colour(graph, masks, noises, tone), masks, tone)
    not_nail = graph.one_minus(masks["nail"])
    roughness = graph.total(0.44, graph.product(noises.high, 0.18), graph.product(masks["palm"], -0.04))
    return SkinChannels(
        albedo=albedo,
        roughness=graph.total(graph.product(roughness, not_nail), graph.product(masks["nail"], 0.24)),
        subsurface=graph.one_minus(graph.product(masks["nail"], 0.6)),
        relief=_relief(graph, masks, noises, not_nail),
        fold_dorsal=fold_dorsal,
        fold_palmar=fold_palmar,
        knuckle=masks["knuck"],
    )


def _skin_colour(graph: NodeGraph, masks: dict[str, Socket], noises: _Noises, tone: SkinTone) -> Socket:
    """From back to palm, with warm and pale patches, redness at tips and knuckles, veins, freckles and pores."""
    colour = graph.mix(masks["palm"], tone.dorsal, tone.palm)
    colour = graph.mix(graph.smooth(noises.low, 0.35, 0.65, 0, 0.26), colour, tone.warm_patch)
    colour = graph.mix(graph.smooth(noises.mid, 0.42, 0.68, 0, 0.24), colour, tone.pale_patch)
    colour = graph.mix(graph.smooth(noises.mid, 0.50, 0.30, 0, 0.17), colour, tone.dark_patch)
    redness = graph.product(masks["red"], graph.remap(noises.mid, 0.25, 0.7, 0.45, 1.1))
    colour = graph.mix(graph.math("MULTIPLY", redness, 0.60, clamp=True), colour, tone.redness)
    colour = graph.mix(graph.product(masks["vein"], graph.remap(noises.low, 0.3, 0.7, 0.12, 0.30)), colour, tone.vein)
    spots = graph.smooth(graph.voronoi(noises.position, 0.16, "F1"), 0.13, 0.05, 0, 0.40)
    freckles = graph.product(spots, graph.one_minus(masks["palm"]), graph.remap(noises.low, 0.47, 0.62, 0, 1))
    colour = graph.mix(freckles, colour, tone.freckle)
    return graph.mix(graph.product(noises.high, 0.26), colour, tone.pore)


def _nail_colour(graph: NodeGraph, skin: Socket, masks: dict[str, Socket], tone: SkinTone) -> Socket:
    """Lunula, bed and free edge along `naily` (0 root to 1 tip), with a darker border in the skin."""
    along = masks["naily"]
    lunula = graph.product(graph.smooth(along, 0.24, 0.12, 0, 1), 0.5)
    nail = graph.mix(lunula, tone.nail_bed, tone.lunula)
    nail = graph.mix(graph.smooth(along, 0.72, 0.86, 0, 0.35), nail, tone.nail_flush)
    nail = graph.mix(graph.smooth(along, 0.87, 0.93, 0, 1), nail, tone.nail_free_edge)
    bordered = graph.mix(graph.product(masks["nailedge"], 0.40), skin, tone.nail_border)
    return graph.mix(masks["nail"], bordered, nail)


def _folds(graph: NodeGraph, masks: dict[str, Socket], noises: _Noises) -> tuple[Socket, Socket]:
    """(dorsal, palmar): two interfering families of waves across each joint, broken up by noise."""
    coarse = graph.noise(noises.position, 0.20, 3, 0.6)
    fine = graph.noise(noises.position, 0.33, 2, 0.5)

    def lines(wavelength_mm: float, wander: float, noise: Socket, sharpness: float) -> Socket:
        phase = graph.total(
            graph.product(masks["tfold"], 2 * pi / wavelength_mm),
            graph.product(graph.math("SUBTRACT", noise, 0.5), wander),
        )
        wave = graph.total(graph.product(graph.math("SINE", phase), 0.5), 0.5)
        return graph.math("POWER", wave, sharpness)

    wide = graph.product(lines(2.5, 15.0, coarse, 4.0), graph.remap(fine, 0.36, 0.56, 0.25, 1))
    narrow = graph.product(lines(1.55, 19.0, fine, 3.0), graph.remap(coarse, 0.62, 0.42, 0.1, 0.6))
    line = graph.math("MAXIMUM", wide, narrow)
    crease = graph.product(masks["crease"], graph.remap(fine, 0.3, 0.6, 0.55, 1.0))
    return graph.product(line, masks["foldd"]), graph.total(graph.product(line, masks["foldp"], 0.22), crease)


def _relief(graph: NodeGraph, masks: dict[str, Socket], noises: _Noises, not_nail: Socket) -> Socket:
    """Pores, cell pattern and veins, mm."""
    small = graph.smooth(graph.voronoi(noises.position, 0.80, "DISTANCE_TO_EDGE"), 0, 0.22, 0, 0.10)
    large = graph.smooth(graph.voronoi(noises.position, 0.34, "DISTANCE_TO_EDGE"), 0, 0.14, 0, 0.13)
    texture = graph.product(graph.total(small, large, graph.product(noises.high, 0.14)), not_nail)
    return graph.total(texture, graph.product(masks["vein"], 0.32), graph.product(noises.mid, 0.26))


def shade(graph: NodeGraph, shader: bpy.types.Node, channels: SkinChannels, tone: SkinTone) -> None:
    """Drive a Principled BSDF: the pose (`flex`) fades dorsal folds, deepens palmar creases and blanches knuckles."""
    flex = graph.attribute("flex")
    blanch = graph.product(graph.math("MULTIPLY", channels.knuckle, flex, clamp=True), 0.42)
    dorsal = graph.product(channels.fold_dorsal, graph.one_minus(graph.product(flex, 0.85), clamp=True))
    palmar = graph.product(channels.fold_palmar, graph.total(0.62, graph.product(flex, 0.55)))
    in_fold = graph.math("ADD", graph.product(dorsal, 0.42), graph.product(palmar, 0.50), clamp=True)
    colour = graph.mix(in_fold, graph.mix(blanch, channels.albedo, tone.blanch), tone.fold)
    depth = graph.total(graph.product(dorsal, 0.34), graph.product(palmar, 0.45))
    bump = graph.node("ShaderNodeBump")
    bump.inputs["Strength"].default_value = 0.85
    bump.inputs["Distance"].default_value = 0.001
    graph.connect(graph.math("SUBTRACT", channels.relief, depth), bump.inputs["Height"])
    inputs = {
        "Base Color": colour,
        "Roughness": channels.roughness,
        "Subsurface Weight": channels.subsurface,
        "Normal": bump.outputs[0],
        "IOR": 1.44,
        "Specular IOR Level": 0.42,
        "Subsurface Radius": (1.0, 0.36, 0.19),
        "Subsurface Scale": 0.0024,
        "Subsurface Anisotropy": 0.7,
    }
    shader.subsurface_method = "RANDOM_WALK"
    for name, value in inputs.items():
        graph.connect(value, shader.inputs[name])


def baked_material(maps: dict[str, Path], tone: SkinTone) -> bpy.types.Material:
    """The skin from its three baked maps (`bake.MAPS`)."""
    material = bpy.data.materials.new("skin")
    graph = NodeGraph(enable_nodes(material))
    uv = graph.node("ShaderNodeUVMap", uv_map=UV_LAYER).outputs[0]

    def texture(name: str) -> Socket:
        node = graph.node("ShaderNodeTexImage", interpolation="Linear")
        node.image = bpy.data.images.load(str(maps[name]))
        node.image.colorspace_settings.name = "Non-Color"
        graph.connect(uv, node.inputs[0])
        return node.outputs["Color"]

    albedo = texture("albedo")
    relief, fold_dorsal, fold_palmar = graph.separate(texture("height"))
    roughness, subsurface, knuckle = graph.separate(texture("mask"))
    channels = SkinChannels(albedo, roughness, subsurface, relief, fold_dorsal, fold_palmar, knuckle)
    shade(graph, graph.tree.nodes["Principled BSDF"], channels, tone)
    return material

"""The skin of captures: a procedural Cycles material that is baked once; its folds and blanching follow the pose.

Its inputs are vertex attributes: the masks of the detailed surface (`backend/teacher/skin_masks.py`), `rest` (rest
position, mm), `flex` (bend of the nearest joint, 1 = 65 degrees) and `crossing` (1 where parts of the hand run into
each other). Colours are linear Rec.709.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from math import pi
from pathlib import Path
from typing import ClassVar

import bpy
import numpy as np

from ...backend.avatars.worn_textures import SCATTERED_IN_NAILS
from ...backend.capture.person import Person
from ...backend.surface.detail_maps import DORSAL_MM, PALMAR_MM
from ...backend.surface.detail_maps_file import DEEPENED_BY, DEEPENED_FROM, FLATTENED
from .node_graph import NodeGraph, Socket, enable_nodes

MASKS = (
    "palm", "nailrim", "naily", "lunula", "tfold", "foldd", "foldp", "ridge", "red", "tip", "vein", "crease", "knuck",
    "arm",
)  # fmt: skip
UV_LAYER = "uv"
EDGE = "DISTANCE_TO_EDGE"
RIDGE_SPACING_MM = 0.48
_FEATURES = ("nail_polish", "folds", "freckles")  # of a tone, beside its colours
# What the blood of a usual skin absorbs, as the exponent of a colour: of green most.
_BLOOD = np.array([0.03, 0.38, 0.58])
NAIL_ROUGHNESS, _POLISH_ROUGHNESS = 0.22, 0.08
_MOST_ALBEDO = 0.95
_LINES_MM = 0.079  # how deep the fine lines of the back are where they are strongest
# Their nets: cells per mm along and across the digits, strength where they are weak and strong, half a width in cells.
_NETS = (((0.62, 0.38, 0.38), (0.45, 0.8), 0.2), ((1.25, 0.8, 0.8), (0.15, 0.45), 0.25))
_INNER_ARM_PALM = 0.36  # of the mask `palm` on the forearm, which has no ridges
MINOR_CREASES = ((0.13, 0.035, 0.035), (0.03, 0.05, 0.12))


@dataclass(frozen=True)
class SkinTone:
    """The colours of a skin, linear Rec.709, and how strongly its folds and freckles show."""

    dorsal: tuple[float, float, float] = (0.625, 0.350, 0.236)
    forearm: tuple[float, float, float] = (0.355, 0.190, 0.121)
    palm: tuple[float, float, float] = (0.769, 0.542, 0.463)
    warm_patch: tuple[float, float, float] = (0.64, 0.31, 0.22)
    pale_patch: tuple[float, float, float] = (0.74, 0.485, 0.375)
    dark_patch: tuple[float, float, float] = (0.49, 0.25, 0.18)
    redness: tuple[float, float, float] = (0.681, 0.303, 0.247)
    knuckle: tuple[float, float, float] = (0.494, 0.286, 0.261)
    vein: tuple[float, float, float] = (0.42, 0.30, 0.28)
    freckle: tuple[float, float, float] = (0.36, 0.17, 0.10)
    pore: tuple[float, float, float] = (0.50, 0.25, 0.175)
    furrow: tuple[float, float, float] = (0.59, 0.318, 0.215)
    fold: tuple[float, float, float] = (0.45, 0.185, 0.125)
    blanch: tuple[float, float, float] = (0.76, 0.53, 0.41)
    nail_bed: tuple[float, float, float] = (0.697, 0.473, 0.404)
    lunula: tuple[float, float, float] = (0.787, 0.657, 0.591)
    nail_flush: tuple[float, float, float] = (0.575, 0.306, 0.259)
    nail_free_edge: tuple[float, float, float] = (0.703, 0.586, 0.477)
    nail_border: tuple[float, float, float] = (0.524, 0.236, 0.171)
    nail_polish: tuple[float, float, float] | None = None
    folds: float = 1.0
    freckles: float = 1.0
    blanched: ClassVar[float] = 0.42
    """Share of `blanch` in the skin of knuckles that are bent."""

    @classmethod
    def of(cls, person: Person) -> SkinTone:
        """Mix a person's skin: pigments absorb light exponentially, so tones are mixed by their logarithms."""
        colours = {}
        for name in _COLOURS:
            light, deep = np.log(getattr(_LIGHT, name)), np.log(getattr(_DEEP, name))
            absorbed = (1 - person.melanin) * light + person.melanin * deep - (person.blood - 1) * _BLOOD
            colours[name] = tuple(float(channel) for channel in np.minimum(np.exp(absorbed), _MOST_ALBEDO))
        return cls(**colours, nail_polish=person.nail_polish, folds=person.folds, freckles=person.freckles)


_LIGHT = SkinTone()
# Dark back and light palm; creases are more visible than veins and redness.
_DEEP = SkinTone(
    dorsal=(0.140, 0.0498, 0.0223),
    forearm=(0.127, 0.045, 0.020),
    palm=(0.493, 0.248, 0.141),
    warm_patch=(0.141, 0.045, 0.019),
    pale_patch=(0.174, 0.071, 0.035),
    dark_patch=(0.092, 0.032, 0.016),
    redness=(0.203, 0.069, 0.037),
    knuckle=(0.058, 0.018, 0.008),
    vein=(0.103, 0.046, 0.030),
    freckle=(0.063, 0.024, 0.012),
    pore=(0.106, 0.040, 0.020),
    furrow=(0.066, 0.0235, 0.0112),
    fold=(0.062, 0.022, 0.011),
    blanch=(0.190, 0.081, 0.040),
    nail_bed=(0.326, 0.181, 0.127),
    lunula=(0.479, 0.346, 0.281),
    nail_flush=(0.263, 0.122, 0.081),
    nail_free_edge=(0.508, 0.412, 0.319),
    nail_border=(0.083, 0.031, 0.018),
)
_COLOURS = tuple(field.name for field in fields(SkinTone) if field.name not in _FEATURES)


@dataclass(frozen=True)
class SkinChannels:
    """The pose-independent properties of the skin, as sockets of one graph.

    Attributes:
        albedo: base colour.
        roughness: of the specular lobe.
        subsurface: weight of the subsurface lobe.
        relief: height of the fine lines, ridges, veins and rims of nails, mm.
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
class PosedRelief:
    """The skin of a pose but for its colour, as sockets of one graph.

    Attributes:
        relief: height of the fine lines, ridges, veins and rims of nails, mm.
        dorsal: depth of the wrinkles on the back of the joints, 1 at the deepest.
        palmar: depth of the creases.
        roughness: of the specular lobe.
        subsurface: weight of the subsurface lobe.
    """

    relief: Socket
    dorsal: Socket
    palmar: Socket
    roughness: Socket
    subsurface: Socket


@dataclass(frozen=True)
class _Noises:
    """Noise of three feature sizes, and how far skin of the back is from its fine lines; shared by the channels."""

    position: Socket
    low: Socket
    mid: Socket
    high: Socket
    lines: Socket

    @classmethod
    def of(cls, graph: NodeGraph) -> _Noises:
        rest_mm = graph.attribute("rest", "Vector")
        sizes = ((0.045, 3, 0.55), (0.16, 3, 0.5), (0.9, 3, 0.6))
        low, mid, high = (graph.noise(rest_mm, *size) for size in sizes)
        return cls(rest_mm, low, mid, high, _fine_lines(graph, rest_mm))


def procedural_channels(graph: NodeGraph, tone: SkinTone) -> SkinChannels:
    """Build the skin from masks and noise; it is baked, because shading it is slow."""
    masks = {name: graph.attribute(name) for name in MASKS}
    nail = graph.smooth(masks["nailrim"], 1.01, 0.97, 0, 1)
    nail_roughness = NAIL_ROUGHNESS if tone.nail_polish is None else _POLISH_ROUGHNESS
    noises = _Noises.of(graph)
    fold_dorsal, fold_palmar = _folds(graph, masks, noises)
    not_nail = graph.one_minus(nail)
    roughness = graph.total(0.44, graph.product(noises.high, 0.18), graph.product(masks["palm"], -0.04))
    return SkinChannels(
        albedo=graph.mix(nail, _skin_colour(graph, masks, noises, tone), _nail_colour(graph, masks, noises, tone)),
        roughness=graph.total(graph.product(roughness, not_nail), graph.product(nail, nail_roughness)),
        subsurface=nail_subsurface(graph, nail, masks["naily"]),
        relief=graph.total(graph.product(_relief(graph, masks, noises), not_nail), _nail_rim(graph, masks)),
        fold_dorsal=graph.product(fold_dorsal, not_nail),
        fold_palmar=fold_palmar,
        knuckle=masks["knuck"],
    )


def _skin_colour(graph: NodeGraph, masks: dict[str, Socket], noises: _Noises, tone: SkinTone) -> Socket:
    """Colour from back to palm and forearm: patches, red tips and knuckles, veins, freckles, fine lines and pores."""
    outer = graph.mix(masks["arm"], tone.dorsal, tone.forearm)
    colour = graph.mix(masks["palm"], outer, tone.palm)
    on_back = graph.one_minus(graph.product(masks["palm"], 0.55))
    colour = graph.mix(graph.product(graph.smooth(noises.low, 0.35, 0.65, 0, 0.42), on_back), colour, tone.warm_patch)
    colour = graph.mix(graph.product(graph.smooth(noises.mid, 0.46, 0.66, 0, 0.40), on_back), colour, tone.pale_patch)
    colour = graph.mix(graph.product(graph.smooth(noises.mid, 0.50, 0.32, 0, 0.34), on_back), colour, tone.dark_patch)
    redness = graph.product(masks["red"], graph.remap(noises.mid, 0.25, 0.7, 0.45, 1.1))
    colour = graph.mix(graph.math("MULTIPLY", redness, 0.50, clamp=True), colour, tone.redness)
    blood = graph.noise(noises.position, 0.38, 2, 0.55)
    blotches = graph.product(graph.smooth(blood, 0.42, 0.66, 0, 1), graph.remap(masks["palm"], 0, 1, 0.12, 0.40))
    colour = graph.mix(blotches, colour, tone.redness)
    over_joints = graph.product(masks["knuck"], masks["knuck"], graph.one_minus(masks["palm"]), 0.55)
    colour = graph.mix(over_joints, colour, tone.knuckle)
    colour = graph.mix(graph.product(masks["vein"], graph.remap(noises.low, 0.3, 0.7, 0.15, 0.36)), colour, tone.vein)
    spots = graph.smooth(graph.voronoi(noises.position, 0.16, "F1"), 0.13, 0.05, 0, min(0.40 * tone.freckles, 0.9))
    freckles = graph.product(spots, graph.one_minus(masks["palm"]), graph.remap(noises.low, 0.47, 0.62, 0, 1))
    colour = graph.mix(freckles, colour, tone.freckle)
    lines = graph.product(graph.one_minus(noises.lines), graph.remap(masks["arm"], 0, 1, 1, 0.55))
    darker = tuple(furrow / back for furrow, back in zip(tone.furrow, tone.dorsal, strict=True))
    colour = graph.mix(graph.product(lines, graph.one_minus(masks["palm"])), colour, darker, "MULTIPLY")
    pores = graph.product(noises.high, graph.remap(masks["palm"], 0, 1, 0.20, 0.05))
    colour = graph.mix(pores, colour, tone.pore)
    root = graph.smooth(masks["naily"], 0.95, 0.7, 0, 0.5)
    return graph.mix(graph.product(graph.smooth(masks["nailrim"], 1.20, 1.0, 0, 0.7), root), colour, tone.nail_border)


def _nail_colour(graph: NodeGraph, masks: dict[str, Socket], noises: _Noises, tone: SkinTone) -> Socket:
    """Colour bed, half-moon, flush and free edge along `naily` (0 root to 1 tip), cuticle and red sides; or polish."""
    if tone.nail_polish is not None:
        return graph.mix(0.0, tone.nail_polish, tone.nail_polish)
    along, rim = masks["naily"], masks["nailrim"]
    streaks = graph.noise(graph.scaled(noises.position, (0.05, 0.9, 0.9)), 1.0, 2, 0.5)
    nail = graph.mix(graph.smooth(streaks, 0.35, 0.65, 0, 0.35), tone.nail_bed, tone.nail_flush)
    nail = graph.mix(graph.smooth(rim, 0.6, 0.97, 0, 0.45), nail, tone.nail_flush)
    nail = graph.mix(graph.smooth(noises.mid, 0.45, 0.60, 0, 0.22), nail, tone.lunula)
    nail = graph.mix(graph.product(masks["lunula"], 0.75), nail, tone.lunula)
    nail = graph.mix(graph.smooth(along, 0.74, 0.87, 0, 0.55), nail, tone.nail_flush)
    edge = graph.total(along, graph.product(graph.math("SUBTRACT", streaks, 0.5), 0.06))
    nail = graph.mix(graph.smooth(edge, 0.89, 0.92, 0, 0.75), nail, tone.nail_free_edge)
    cuticle = graph.product(graph.smooth(rim, 0.92, 0.97, 0, 0.25), graph.smooth(along, 0.45, 0.25, 0, 1))
    return graph.mix(cuticle, nail, tone.pale_patch)


def _folds(graph: NodeGraph, masks: dict[str, Socket], noises: _Noises) -> tuple[Socket, Socket]:
    """Build (dorsal, palmar): lines across each joint that break up into finer ones, and the creases of the palm."""
    across = graph.scaled(noises.position, (0.25, 0.11, 0.11))  # features are drawn out across the digit
    coarse, fine = graph.noise(across, 1.0, 2, 0.5), graph.noise(across, 2.3, 2, 0.5)

    def lines(spacing_mm: float, wander: float, noise: Socket, sharpness: float) -> Socket:
        """Draw furrows, 1 at the bottom of each; the skin between two furrows is round."""
        phase = graph.total(
            graph.product(masks["tfold"], pi / spacing_mm),
            graph.product(graph.math("SUBTRACT", noise, 0.5), wander),
        )
        crown = graph.math("ABSOLUTE", graph.math("SINE", phase))
        return graph.math("POWER", graph.one_minus(crown, clamp=True), sharpness)

    wide = graph.product(lines(2.3, 5.0, coarse, 1.6), graph.remap(fine, 0.34, 0.52, 0.3, 1))
    narrow = graph.product(lines(1.1, 6.0, fine, 1.8), graph.remap(coarse, 0.62, 0.42, 0.1, 0.4))
    line = graph.math("MAXIMUM", wide, narrow)
    minor = graph.total(*(_open_lines(graph, noises, factors) for factors in MINOR_CREASES))
    minor = graph.product(minor, graph.smooth(masks["palm"], 0.5, 0.9, 0, 0.2))
    main = graph.product(masks["crease"], graph.remap(fine, 0.3, 0.6, 0.65, 1.0))
    crease = graph.total(graph.product(main, 0.75), graph.product(graph.math("POWER", main, 5.0), 1.1), minor)
    return graph.product(line, masks["foldd"]), graph.total(graph.product(line, masks["foldp"], 0.3), crease)


def _open_lines(graph: NodeGraph, noises: _Noises, factors: tuple[float, float, float]) -> Socket:
    """Thin lines with open ends: pieces of the level lines of a noise that is stretched by the factors."""
    height = graph.noise(graph.scaled(noises.position, factors), 1.0, 0, 0.5)
    line = graph.smooth(graph.math("ABSOLUTE", graph.math("SUBTRACT", height, 0.5)), 0.013, 0, 0, 1)
    return graph.product(line, graph.smooth(noises.mid, 0.46, 0.58, 0, 1))


def _fine_lines(graph: NodeGraph, position: Socket) -> Socket:
    """Draw the back's fine lines, low in them and 1 between: borders of two nets of cells that wander, come and go."""
    wandering = graph.moved(position, graph.vector_noise(position, 0.8, 1), 0.9)
    strength = graph.noise(position, 0.35, 2, 0.5)

    def net(cells_per_mm: tuple[float, float, float], strengths: tuple[float, float], half_width: float) -> Socket:
        border = graph.voronoi(graph.scaled(wandering, cells_per_mm), 1.0, EDGE)
        return graph.product(graph.smooth(border, 0, half_width, 1, 0), graph.remap(strength, 0.35, 0.6, *strengths))

    return graph.one_minus(graph.math("MAXIMUM", *(net(*one) for one in _NETS)))


def _relief(graph: NodeGraph, masks: dict[str, Socket], noises: _Noises) -> Socket:
    """Build the relief, mm: fine diamonds across the digits on the back, in the palm ridges; veins, soft forms."""
    cells = graph.voronoi(graph.scaled(noises.position, (1.8, 0.85, 0.85)), 1.0, EDGE)
    diamonds = graph.product(graph.smooth(cells, 0, 0.22, 0, 0.06), graph.remap(noises.mid, 0.35, 0.6, 0.6, 1))
    lines = graph.product(noises.lines, _LINES_MM)
    on_back = graph.product(graph.total(diamonds, lines), graph.one_minus(masks["palm"]))
    bend = graph.product(graph.noise(noises.position, 0.035, 0, 0.5), 14.0)
    ridges = graph.math("SINE", graph.product(graph.total(masks["ridge"], bend), 2 * pi / RIDGE_SPACING_MM))
    on_palm = graph.product(ridges, graph.smooth(masks["palm"], _INNER_ARM_PALM, 1.0, 0, 1), 0.012)
    on_back = graph.product(on_back, graph.remap(masks["arm"], 0, 1, 1, 0.6))
    return graph.total(on_back, on_palm, graph.product(masks["vein"], 0.1), graph.product(noises.mid, 0.35))


def _nail_rim(graph: NodeGraph, masks: dict[str, Socket]) -> Socket:
    """Build a furrow around the plate, the skin that overlaps its root and sides, and the step at its free edge, mm."""
    rim, along = masks["nailrim"], masks["naily"]
    beside = graph.product(graph.smooth(rim, 0.98, 1.05, 0, 1), graph.smooth(rim, 1.6, 1.1, 0, 1))
    outline = graph.product(graph.smooth(rim, 0.94, 1.0, 0, 1), graph.smooth(rim, 1.06, 1.0, 0, 1))
    furrow = graph.product(outline, graph.smooth(along, 0.5, 0.0, -0.08, -0.2))
    step = graph.total(graph.smooth(along, 0.5, 0.1, 0.12, 0.28), graph.smooth(along, 0.84, 0.96, 0, -0.4))
    return graph.total(graph.product(beside, step), furrow)


def shade(
    graph: NodeGraph, shader: bpy.types.Node, channels: SkinChannels, tone: SkinTone, factor: Socket | None = None
) -> None:
    """Drive a Principled BSDF: the pose (`flex`) fades dorsal folds, deepens palmar creases and blanches knuckles.

    A factor multiplies the colour.
    """
    flex = graph.attribute("flex")
    blanch = graph.product(graph.math("MULTIPLY", channels.knuckle, flex, clamp=True), tone.blanched)
    dorsal = graph.product(channels.fold_dorsal, graph.one_minus(graph.product(flex, FLATTENED), clamp=True))
    palmar = graph.product(channels.fold_palmar, graph.total(DEEPENED_FROM, graph.product(flex, DEEPENED_BY)))
    in_fold = graph.math("ADD", graph.product(dorsal, 0.42), graph.product(palmar, 0.45), clamp=True)
    colour = graph.mix(in_fold, graph.mix(blanch, channels.albedo, tone.blanch), tone.fold)
    if factor is not None:
        colour = graph.mix(1.0, graph.mix(1.0, colour, factor, "MULTIPLY"), (_MOST_ALBEDO,) * 3, "DARKEN")
    shape = PosedRelief(channels.relief, dorsal, palmar, channels.roughness, channels.subsurface)
    connect_skin(graph, shader, colour, shape, tone)


def connect_skin(graph: NodeGraph, shader: bpy.types.Node, colour: Socket, shape: PosedRelief, tone: SkinTone) -> None:
    """Drive a Principled BSDF by a colour and all else.

    Light is scattered less where parts run into each other (`crossing`): it would end inside the other part, and red,
    which goes farthest, would leave a teal line.
    """
    depth = graph.total(
        graph.product(shape.dorsal, DORSAL_MM * tone.folds), graph.product(shape.palmar, PALMAR_MM * tone.folds)
    )
    bump = graph.node("ShaderNodeBump")
    bump.inputs["Strength"].default_value = 1.0
    bump.inputs["Distance"].default_value = 0.001
    graph.connect(graph.math("SUBTRACT", shape.relief, depth), bump.inputs["Height"])
    inputs = {
        "Base Color": colour,
        "Roughness": shape.roughness,
        "Subsurface Weight": shape.subsurface,
        "Normal": bump.outputs[0],
        "IOR": 1.44,
        "Specular IOR Level": 0.42,
        "Subsurface Radius": (1.0, 0.36, 0.19),
        "Subsurface Scale": graph.product(graph.one_minus(graph.attribute("crossing")), 0.0024),
        "Subsurface Anisotropy": 0.7,
    }
    shader.subsurface_method = "RANDOM_WALK"
    for name, value in inputs.items():
        graph.connect(value, shader.inputs[name])


def nail_subsurface(graph: NodeGraph, nail: Socket, along: Socket) -> Socket:
    """Return the weight of the subsurface lobe: less in nails, and more again at their free edge."""
    return graph.one_minus(graph.product(nail, graph.smooth(along, 0.86, 0.94, 1 - SCATTERED_IN_NAILS, 0.2)))


def baked_material(maps: dict[str, Path], tone: SkinTone, factor: bpy.types.Image | None = None) -> bpy.types.Material:
    """Make the skin from its three baked maps (`bake.MAPS`); an image over the atlas may multiply its albedo."""
    material = bpy.data.materials.new("skin")
    graph = NodeGraph(enable_nodes(material))
    uv = graph.node("ShaderNodeUVMap", uv_map=UV_LAYER).outputs[0]

    def texture(image: bpy.types.Image) -> Socket:
        node = graph.node("ShaderNodeTexImage", interpolation="Linear")
        node.image = image
        node.image.colorspace_settings.name = "Non-Color"
        graph.connect(uv, node.inputs[0])
        return node.outputs["Color"]

    albedo, height, mask = (texture(bpy.data.images.load(str(maps[name]))) for name in ("albedo", "height", "mask"))
    relief, fold_dorsal, fold_palmar = graph.separate(height)
    roughness, subsurface, knuckle = graph.separate(mask)
    channels = SkinChannels(albedo, roughness, subsurface, relief, fold_dorsal, fold_palmar, knuckle)
    own = None if factor is None else texture(factor)
    shade(graph, graph.tree.nodes["Principled BSDF"], channels, tone, own)
    return material

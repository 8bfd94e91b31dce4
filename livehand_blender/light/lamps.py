"""Reads the lamps of an evaluated frame as Cycles takes them, with the meshes that each one lights.

Energies are Blender's; object scale counts for area lamps and for the cone of spots, as in Cycles.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, replace
from math import atan, pi, sin, tan

import bpy
import numpy as np

from ...backend.records.errors import LiveHandError
from ...backend.records.light import Lamp
from ..scene.colour import in_rec709
from ..scene.node_values import used_nodes
from .light_linking import LinkRule

LOGGER = logging.getLogger(__name__)

_ELLIPTIC = {"DISK", "ELLIPSE"}
_ONE_SIZE = {"SQUARE", "DISK"}
# Cycles' own factor between the power and the "radiance" of a point without a radius.
_UNNORMALIZED_POINT = 4.0
_SMALLEST_SCALE = 1e-9


@dataclass(frozen=True)
class LinkedLamp:
    """A lamp, and the meshes that it is limited to.

    Attributes:
        lamp: for meshes that shadow themselves.
        receivers: the meshes that it lights.
        blockers: the meshes that shadow it.
        has_soft_falloff: whether it is a disk that turns to what it lights, in place of a sphere.
    """

    lamp: Lamp
    receivers: LinkRule
    blockers: LinkRule
    has_soft_falloff: bool

    def for_mesh(self, name: str, middle: np.ndarray) -> Lamp | None:
        """Return the lamp as a mesh object meets it, by its full name and middle [3]; None if it does not light it."""
        if not self.receivers.holds(name):
            return None
        lamp = self.lamp if self.blockers.holds(name) else replace(self.lamp, casts_shadow=False)
        if not self.has_soft_falloff:
            return lamp
        # A disk of radius r, seen from the distance d, shines like the sphere of that radius times d^2 / (d^2 + r^2).
        square = float(np.sum((lamp.position - middle) ** 2))
        return replace(lamp, rgb=lamp.rgb * square / max(square + lamp.radius_m**2, 1e-12))


def read_lamps(depsgraph: bpy.types.Depsgraph) -> tuple[LinkedLamp, ...]:
    """Read all lamps that give diffuse light in the evaluated frame, instances included; one scaled to 0 gives none.

    Raises:
        LiveHandError: a lamp's place, size or strength is not finite.
    """
    groups = {group.name for group in depsgraph.view_layer.lightgroups}
    lamps = []
    for instance in depsgraph.object_instances:
        thing = instance.object
        if thing.type == "LIGHT" and instance.show_self and _is_lit(thing):
            lamp = _named_lamp(thing, np.array(instance.matrix_world, np.float64), groups)
            if lamp is not None and lamp.rgb.any():
                linking = thing.light_linking
                receivers, blockers = LinkRule.of(linking.receiver_collection), LinkRule.of(linking.blocker_collection)
                lamps.append(LinkedLamp(lamp, receivers, blockers, getattr(thing.data, "use_soft_falloff", False)))
    return tuple(lamps)


def _is_lit(thing: bpy.types.Object) -> bool:
    """Return whether a lamp gives light to diffuse surfaces; a portal only guides Cycles' sampling."""
    settings = getattr(thing.data, "cycles", None)
    return thing.visible_diffuse and not (thing.data.type == "AREA" and settings and settings.is_portal)


def _named_lamp(thing: bpy.types.Object, matrix: np.ndarray, groups: set[str]) -> Lamp | None:
    """Read the lamp; None if it is scaled to 0. An error names it."""
    if np.linalg.norm(matrix[:3, :3], axis=0).min() < _SMALLEST_SCALE:
        LOGGER.warning("Light '%s' is scaled to 0; it gives none", thing.name)
        return None
    try:
        return _lamp(thing, matrix, groups)
    except LiveHandError as error:
        raise LiveHandError(
            f"light '{thing.name}': {error}; look at its transform, its settings and their drivers"
        ) from error


def _lamp(thing: bpy.types.Object, matrix: np.ndarray, groups: set[str]) -> Lamp:
    data = thing.data
    axes, scale = _axes(matrix)
    shared = Lamp(
        kind=data.type.lower(),
        rgb=_strength(thing),
        position=matrix[:3, 3],
        rotation=axes,
        group=thing.lightgroup if thing.lightgroup in groups else "",
        casts_shadow=data.use_shadow,
    )
    return _KINDS[data.type](shared, data, scale)


def _sun(lamp: Lamp, data: bpy.types.Light, _) -> Lamp:
    power = 1.0 if _is_normalized(data) else pi * sin(data.angle / 2) ** 2
    return replace(lamp, rgb=lamp.rgb * power, angle_rad=data.angle)


def _point(lamp: Lamp, data: bpy.types.Light, _) -> Lamp:
    radius = data.shadow_soft_size
    power = 1.0 if _is_normalized(data) else (4 * pi * radius**2 if radius else _UNNORMALIZED_POINT)
    return replace(lamp, rgb=lamp.rgb * power, radius_m=radius)


def _spot(lamp: Lamp, data: bpy.types.Light, scale: np.ndarray) -> Lamp:
    widened = np.sqrt(scale[0] * scale[1]) / scale[2]
    cone = data.spot_size if np.isclose(widened, 1) else 2 * atan(widened * tan(min(data.spot_size, 3.14) / 2))
    return replace(_point(lamp, data, scale), cone_rad=cone, blend=data.spot_blend)


def _area(lamp: Lamp, data: bpy.types.Light, scale: np.ndarray) -> Lamp:
    along_y = data.size if data.shape in _ONE_SIZE else data.size_y
    size, is_ellipse = (data.size * scale[0], along_y * scale[1]), data.shape in _ELLIPTIC
    power = 1.0 if _is_normalized(data) else size[0] * size[1] * (pi / 4 if is_ellipse else 1.0)
    return replace(
        lamp,
        rgb=lamp.rgb * power,
        size_m=(float(size[0]), float(size[1])),
        is_ellipse=is_ellipse,
        spread_rad=data.spread,
    )


_KINDS = {"SUN": _sun, "POINT": _point, "SPOT": _spot, "AREA": _area}


def _is_normalized(data: bpy.types.Light) -> bool:
    return getattr(data, "normalize", True)  # since Blender 4.5


def _strength(thing: bpy.types.Object) -> np.ndarray:
    """Compute energy times colour [3], linear Rec.709; negative channels count as none."""
    data = thing.data
    rgb = np.array(data.color, np.float64) * data.energy * 2.0 ** getattr(data, "exposure", 0.0)
    if getattr(data, "use_temperature", False):
        rgb = rgb * np.array(data.temperature_color)
    rgb = in_rec709(rgb * _emission(thing))
    if rgb.max() < 0:
        LOGGER.warning("Light '%s' takes light away; the hand is lit without it", thing.name)
    return np.maximum(rgb, 0.0)


def _emission(thing: bpy.types.Object) -> np.ndarray:
    """Read the factor [3] of the lamp's own nodes: an emission of one colour and strength; others count as 1."""
    tree = used_nodes(thing.data)
    output = tree and tree.get_output_node("CYCLES")
    if not output or not output.inputs["Surface"].is_linked:
        return np.zeros(3) if output else np.ones(3)
    node = output.inputs["Surface"].links[0].from_node
    if node.type == "EMISSION" and not any(one.is_linked for one in node.inputs):
        return np.array(node.inputs["Color"].default_value[:3]) * node.inputs["Strength"].default_value
    LOGGER.warning("The nodes of light '%s' are not read: its light falls on the hand without them", thing.name)
    return np.ones(3)


def _axes(matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Split the lamp's axes [3, 3] without scale and shear, Z kept, from the scale [3] along them."""
    scale = np.maximum(np.linalg.norm(matrix[:3, :3], axis=0), 1e-12)
    z = matrix[:3, 2] / scale[2]
    x = matrix[:3, 0] - z * (matrix[:3, 0] @ z)
    x /= max(np.linalg.norm(x), 1e-12)
    return np.stack([x, np.cross(z, x), z], 1), scale

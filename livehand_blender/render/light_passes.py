"""The scene's light on the bare hands, measured by Cycles: light passes in which the camera sees a hand's mesh alone.

Everything else still lights, shadows and reflects the hand. A copy of the scene is rendered by a render operator of
its own in the middle of the frame's render. A second Cycles session within that render would not do: its passes and
film are the frame's, and it frees the depsgraph. The operator needs the main thread; so it works in Blender 4.5 as
a module and in 4.3's window, for stills, animations and beside a view in Rendered shading.

The hand keeps its material: the passes are divided by its diffuse colour, so that they show a white surface, whereas
the light that the hand reflects on itself has been reflected by skin.
"""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial

import bpy
import numpy as np

from ...backend.records.camera import Camera
from ...backend.records.errors import LiveHandError
from ...backend.records.light import MeasuredLight
from ...backend.records.shot import Shot, SurfaceMesh
from ...backend.render.frame_task import FrameTask
from ..hands.proxy import SCENE_RAYS, hide_from_scene, show_alone, use_albedo
from ..light.light_linking import LinkRule
from ..scene.camera import Region, image_size_px, render_region
from ..scene.colour import in_rec709
from ..scene.main_thread import call_in_main_thread
from ..scene.removal import remove_scene
from ..scene.settings import ENGINE
from .frame_setup import FrameSetup, ViewSetup
from .render_result import read_scene

# Samples of each pixel of the frame: a share of the scene's, within limits; noise of fewer shows as blotches in shade.
# Each map pixel is the mean of 2 x 2.
_SHARE, _LEAST, _MOST = 0.25, 4, 32
# Pixels around the hand's box in which it may be at times near the frame.
_MARGIN_PX = 8
# Cycles' passes by their names before Blender 5.2, and since.
_PASSES = {"DiffDir": "Diffuse Direct", "DiffInd": "Diffuse Indirect", "DiffCol": "Diffuse Color"}
_HANDLERS = ("render_init", "render_pre", "render_post", "render_complete", "render_cancel", "render_stats")

_NAME = "LiveHand Surface"


@dataclass(frozen=True)
class Measurement:
    """What an engine is to do in place of a frame.

    Attributes:
        mesh_name: full name of the hand's mesh object.
        proxy_name: full name of the object that the camera sees: the mesh, or its proxy.
        region: of the image.
        albedo: name of each hand's mesh object -> [3] that of its skin.
        views: names of the stereo views; one empty name without stereo.
        maps: filled by the engine: name of each view -> its passes.
    """

    mesh_name: str
    proxy_name: str
    region: Region
    albedo: Mapping[str, np.ndarray]
    views: tuple[str, ...]
    maps: dict[str, Mapping[str, np.ndarray]]

    def prepare(self, depsgraph: bpy.types.Depsgraph) -> None:
        """Show the hand alone to the camera; all hands reflect as in the frame."""
        show_alone(depsgraph, self.proxy_name)
        use_albedo(depsgraph, {**self.albedo, self.proxy_name: self.albedo[self.mesh_name]})
        if self.proxy_name != self.mesh_name:
            hide_from_scene(depsgraph, self.mesh_name)

    def read(self, result: bpy.types.RenderResult, layer: str) -> None:
        """Keep Cycles' passes."""
        for view in self.views:
            passes = read_scene(result, layer, view, self.region.size_px)
            light = {name: passes[name if name in passes else new] for name, new in _PASSES.items()}
            self.maps[view] = {"Combined": passes["Combined"], **light}


def with_measured_light(frame: FrameSetup, engine: type, rendering: threading.Lock) -> FrameSetup:
    """Measure the frame's light on every hand that the scene lights, once for all samples of an exposure.

    It is measured on the avatar's surface, where it has one, for frames show that. Hands whose avatars have no albedo
    cannot make use of it.

    Args:
        frame: in its scene.
        engine: LiveHand's; its `measurement` is set meanwhile.
        rendering: the session's.

    Raises:
        LiveHandError: Cycles does not render the passes.
    """
    views, surface_vertices = frame.views, {}
    for number, hand in enumerate(frame.hands):
        is_lit = any(task[number].shot.light is not None for task in frame.views[0].task.samples)
        if is_lit and hand.name in frame.meshes:
            shots = [sample[number].shot for view in views for sample in view.task.samples]
            region = box_of(shots, frame.size_px)
            if region is not None:
                mesh_name, surface = frame.meshes[hand.name], None
                if not is_light_linked(mesh_name):
                    with rendering:
                        surface = hand.renderer.posed_surface(shots[0])
                if surface is not None:
                    surface_vertices[mesh_name] = surface.vertices[: len(shots[0].vertices)]  # the finer ones follow
                measured = measure(frame, engine, mesh_name, region, surface)
                views = tuple(_with_light(view, number, measured[view.name]) for view in views)
    return replace(frame, views=views, surface_vertices=surface_vertices)


def is_measured(frame: FrameSetup) -> bool:
    """Return whether the light on a hand was measured, which cannot be done ahead of its frame."""
    tasks = (task for view in frame.views for sample in view.task.samples for task in sample)
    return any(task.shot.light is not None and task.shot.light.measured is not None for task in tasks)


def box_of(shots: list[Shot], size_px: tuple[int, int]) -> Region | None:
    """Find the part of the image that may show the hand, in whole map pixels; None if it is outside."""
    corners = [corner for shot in shots if (corner := _corners(shot.camera, shot.vertices))]
    if len(corners) < len(shots):  # it reaches behind the camera
        return Region(0, 0, size_px)
    low = np.floor(np.min([low for low, _ in corners], axis=0)).astype(int) - _MARGIN_PX
    high = np.ceil(np.max([high for _, high in corners], axis=0)).astype(int) + _MARGIN_PX
    step = np.array(binning(size_px))
    low = np.clip(low, 0, size_px) // step * step
    high = np.minimum(-(-np.clip(high, 0, size_px) // step) * step, size_px)
    width, height = (int(n) for n in high - low)
    return Region(int(low[0]), int(low[1]), (width, height)) if min(width, height) > 0 else None


def _corners(camera: Camera, vertices: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    pixels, depth = camera.project(vertices)
    return None if depth.min() <= 1e-6 else (pixels.min(0), pixels.max(0))


def binning(size_px: tuple[int, int]) -> tuple[int, int]:
    """Count the pixels of the image along the sides of a map pixel; odd sides, which have no half, keep theirs."""
    width, height = (2 if n % 2 == 0 else 1 for n in size_px)
    return width, height


def measure(
    frame: FrameSetup, engine: type, mesh_name: str, box: Region, surface: SurfaceMesh | None
) -> Mapping[str, MeasuredLight | None]:
    """Measure the light on one hand in every view.

    Args:
        frame: whose scene, view layer and image it is.
        engine: as in `with_measured_light`.
        mesh_name: full name of the hand's mesh object.
        box: of the image to measure.
        surface: of the skin; None: that of the mesh.

    Raises:
        LiveHandError: Cycles does not render the passes.
    """
    views = tuple(view.name for view in frame.views)
    measurement = Measurement(mesh_name, mesh_name, box, frame.albedo, views, {})
    call_in_main_thread(partial(_render, frame, engine, measurement, surface))
    if set(measurement.maps) != set(views):
        raise LiveHandError(
            "Cycles must measure the light on the hand before it renders the scene, that render did not finish; "
            "render again, or set the hands' light to Capture's Own"
        )
    on_surface = surface is not None
    return {view: measured_light(maps, box, frame.size_px, on_surface) for view, maps in measurement.maps.items()}


def measured_light(
    maps: Mapping[str, np.ndarray], box: Region, size_px: tuple[int, int], on_surface: bool = False
) -> MeasuredLight | None:
    """Make the record of an image from Cycles' passes of its box; None if they show no diffuse surface.

    `on_surface` as in `MeasuredLight`.
    """
    light = {name: in_rec709(maps[name]) for name in ("DiffDir", "DiffInd")}
    alpha = np.clip(maps["Combined"][..., 3], 0, 1) * (maps["DiffCol"] > 0).all(-1)
    maps_of_box = [np.maximum(one, 0) * alpha[..., None] for one in light.values()]
    step_x, step_y = binning(size_px)
    direct, indirect, share = (_binned(one, step_x, step_y) for one in (*maps_of_box, alpha[..., None]))
    if not share.any():
        return None
    straight = [np.divide(one, share, out=np.zeros_like(one), where=share > 0) for one in (direct, indirect)]
    x, y, (width, height) = box.x0_px // step_x, box.y0_px // step_y, size_px
    whole = [np.zeros((height // step_y, width // step_x, one.shape[-1]), np.float32) for one in (*straight, share)]
    for target, one in zip(whole, (*straight, share), strict=True):
        target[y : y + one.shape[0], x : x + one.shape[1]] = one
    return MeasuredLight(whole[0], whole[1], whole[2][..., 0], on_surface)


def _binned(image: np.ndarray, step_x: int, step_y: int) -> np.ndarray:
    height, width, channels = image.shape
    return image.reshape(height // step_y, step_y, width // step_x, step_x, channels).mean((1, 3))


def _with_light(view: ViewSetup, number: int, measured: MeasuredLight | None) -> ViewSetup:
    """Add the measured light of one of its hands to the view."""
    samples = []
    for sample in view.task.samples:
        task = sample[number]
        assert task.shot.light is not None
        lit = replace(task, shot=replace(task.shot, light=replace(task.shot.light, measured=measured)))
        samples.append((*sample[:number], lit, *sample[number + 1 :]))
    return replace(view, task=FrameTask(tuple(samples)))


def _render(frame: FrameSetup, engine: type, measurement: Measurement, surface: SurfaceMesh | None) -> None:
    """Render the passes, in the main thread, of the surface in place of the mesh; the measurement's `maps` get them."""
    try:
        with contextlib.ExitStack() as stack:
            stack.enter_context(_silenced_handlers())
            scene = stack.enter_context(_copied(frame, measurement.region))
            if surface is not None:
                name = stack.enter_context(measurement_proxy(scene, measurement.mesh_name, surface))
                measurement = replace(measurement, proxy_name=name)
            engine.measurement = measurement
            bpy.ops.render.render(scene=scene.name)
    except RuntimeError as error:
        raise LiveHandError(f"Cycles cannot measure the light on the hand: {error}") from error
    finally:
        engine.measurement = None


@contextlib.contextmanager
def _silenced_handlers() -> Iterator[None]:
    """Keep handlers from being called within, which would take the render for the user's."""
    lists = [getattr(bpy.app.handlers, name) for name in _HANDLERS]
    before = [list(handlers) for handlers in lists]
    for handlers in lists:
        handlers.clear()
    try:
        yield
    finally:
        for handlers, functions in zip(lists, before, strict=True):
            handlers[:] = functions


@contextlib.contextmanager
def _copied(frame: FrameSetup, box: Region) -> Iterator[bpy.types.Scene]:
    """Copy the scene, sharing its objects, set to render the passes; the copy is removed again."""
    scene = frame.scene.copy()
    camera = scene.camera.copy()
    camera.data = lens = camera.data.copy()
    try:
        scene.collection.objects.link(camera)
        scene.timeline_markers.clear()  # they could bind other cameras
        scene.camera, lens.dof.use_dof = camera, False
        _set_up(scene, frame.layer)
        _limit(scene, frame.scene, box)
        yield scene
    finally:
        remove_scene(scene, (camera, lens))


def _set_up(scene: bpy.types.Scene, layer_name: str) -> None:
    render, cycles = scene.render, scene.cycles
    render.engine = ENGINE
    render.film_transparent = True
    render.use_compositing = render.use_sequencer = render.use_persistent_data = render.use_motion_blur = False
    render.use_freestyle = render.use_single_layer = False
    cycles.samples, cycles.time_limit = samples_of(cycles.samples), 0.0
    cycles.use_adaptive_sampling = cycles.use_denoising = cycles.use_auto_tile = False
    for layer in scene.view_layers:
        layer.use = layer.name == layer_name
    layer = scene.view_layers[layer_name]
    layer.samples = 0
    layer.use_pass_diffuse_direct = layer.use_pass_diffuse_indirect = layer.use_pass_diffuse_color = True
    layer.use_pass_cryptomatte_object = False


def samples_of(samples: int) -> int:
    """Return with how many samples a pixel's light is measured in a scene that is rendered with so many."""
    return min(max(round(_SHARE * samples), _LEAST), _MOST)


def _limit(scene: bpy.types.Scene, original: bpy.types.Scene, box: Region) -> None:
    """Render only a box of the original's region."""
    (width, height), region = image_size_px(original.render), render_region(original.render)
    left, top = region.x0_px + box.x0_px, region.y0_px + box.y0_px
    # Blender rounds down.
    render = scene.render
    render.use_border, render.use_crop_to_border = True, False
    render.border_min_x, render.border_max_x = (left + 0.5) / width, (left + box.size_px[0] + 0.5) / width
    bottom = height - top - box.size_px[1]
    render.border_min_y, render.border_max_y = (bottom + 0.5) / height, (bottom + box.size_px[1] + 0.5) / height


@contextlib.contextmanager
def measurement_proxy(scene: bpy.types.Scene, mesh_name: str, surface: SurfaceMesh) -> Iterator[str]:
    """Add the surface to a scene, within, besides the mesh object of this full name; yields its full name.

    Where light grazes or shadows end, the mesh's few faces do not tell what the skin receives that frames show. It has
    the mesh's first material, and rays meet it as they meet the mesh.
    """
    (mesh,) = (item for item in bpy.data.objects if item.name_full == mesh_name)  # the scene's, or its set's
    data = bpy.data.meshes.new(_NAME)
    data.from_pydata(surface.vertices.tolist(), [], surface.faces.tolist())
    data.polygons.foreach_set("use_smooth", np.ones(len(surface.faces), bool))
    data.materials.append(next((slot.material for slot in mesh.material_slots), None))
    item = bpy.data.objects.new(_NAME, data)
    for name in SCENE_RAYS:
        setattr(item, name, getattr(mesh, name))
    try:
        scene.collection.objects.link(item)
        yield item.name_full
    finally:
        bpy.data.objects.remove(item)
        bpy.data.meshes.remove(data)


def is_light_linked(mesh_name: str) -> bool:
    """Return whether lamps are linked to the object of this full name, or kept off it; they would miss its stand-in."""
    linking = (item.light_linking for item in bpy.data.objects)
    rules = (LinkRule.of(side) for one in linking for side in (one.receiver_collection, one.blocker_collection))
    return any(mesh_name in rule.excluded or mesh_name in (rule.included or ()) for rule in rules)

"""Renders the world of a .blend by Cycles to an equirectangular map; a script that a Blender process of its own runs.

It stands alone, so that it runs in a Blender without LiveHand: `world_render.py REQUEST.json OUT.npz`.
`world_map.py` starts it. Rendering in the running Blender is not possible in the middle of its own render.
"""

import json
import os
import sys
import traceback
from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector

# Texels of the map, and samples of each. A sun of 0.5 degrees covers about half a texel.
_SIZE_PX, _SAMPLES = (512, 256), 8
# Views of the brightest spots, so that a sun's energy and angle are exact.
_CLOSE_UPS, _CLOSE_UP_PX, _CLOSE_UP_SAMPLES = 4, 192, 4
_CLOSE_UP_RAD = np.deg2rad(9.0)
# A place is bright if it outshines the mean of the sky by this factor; the next one is this far from it.
_PEAK_FACTOR, _PEAK_DISTANCE_RAD = 12.0, np.deg2rad(6.0)
# What a Light Path node says to a diffuse ray, which is how a surface meets the world.
_DIFFUSE_RAY = {
    "Is Diffuse Ray": 1.0,
    "Is Reflection Ray": 1.0,
    "Ray Depth": 1.0,
    "Diffuse Depth": 1.0,
    "Ray Length": 1e5,
}


def main(request_path: Path, out: Path) -> None:
    """Render the map and the close-ups of its brightest spots."""
    request = json.loads(request_path.read_text(encoding="utf-8"))
    with bpy.data.libraries.load(request["blend"], link=False) as (_, wanted):
        wanted.worlds = [request["world"]]
    (world,) = wanted.worlds
    for thing in list(bpy.context.scene.objects):
        bpy.data.objects.remove(thing)
    for name, file in request["pixels"].items():
        bpy.data.images[name].pixels.foreach_set(np.load(request_path.with_name(file)))
    prepare(world.node_tree, request["matrices"], set())
    scene = make_scene(world, request["threads"])
    scene.frame_set(int(request["frame"] // 1), subframe=request["frame"] % 1)
    picture = out.with_suffix(".exr")
    radiance = render_panorama(scene, picture)
    peaks = find_peaks(radiance)
    close_ups = [render_close_up(scene, picture, peak) for peak in peaks]
    np.savez(
        out,
        radiance=radiance,
        close_ups=np.reshape([pixels for pixels, _ in close_ups], (-1, _CLOSE_UP_PX, _CLOSE_UP_PX, 3)),
        axes=np.reshape([axes for _, axes in close_ups], (-1, 3, 3)),
        angle_rad=_CLOSE_UP_RAD,
    )


def prepare(tree: bpy.types.NodeTree, matrices: dict, seen: set[str]) -> None:
    """Give the tree, and the groups inside it, the values of a diffuse ray, and the matrices of the scene's objects."""
    seen.add(tree.name)
    for node in list(tree.nodes):
        if node.type == "LIGHT_PATH":
            replace_light_path(tree, node)
        if getattr(node, "object", None):
            node.object = empty_at(Matrix(matrices[node.object.name]))
        inner = getattr(node, "node_tree", None)
        if inner is not None and inner.name not in seen:
            prepare(inner, matrices, seen)


def empty_at(matrix: Matrix) -> bpy.types.Object:
    """Make an object with this matrix that no camera sees, for one outside the scene, which is not evaluated."""
    empty = bpy.data.objects.new("Coordinates", None)
    bpy.context.scene.collection.objects.link(empty)
    empty.matrix_world = matrix
    return empty


def replace_light_path(tree: bpy.types.NodeTree, node: bpy.types.Node) -> None:
    """Link value nodes in its place."""
    for output in node.outputs:
        targets = [link.to_socket for link in output.links]
        if targets:
            value = tree.nodes.new("ShaderNodeValue")
            value.outputs[0].default_value = _DIFFUSE_RAY.get(output.name, 0.0)
            for target in targets:
                tree.links.new(value.outputs[0], target)


def make_scene(world: bpy.types.World, threads: int) -> bpy.types.Scene:
    """Make the scene of the world alone, with a camera at the origin; radiance comes out as it is."""
    scene = bpy.context.scene
    scene.world = world
    world.cycles_visibility.camera = True
    world.cycles.sampling_method = "NONE"  # nothing is lit, so no importance map is needed
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0.0
    cycles.pixel_filter_type, cycles.film_exposure = "BOX", 1.0
    scene.render.film_transparent = False
    scene.render.use_compositing = scene.render.use_sequencer = False
    scene.render.resolution_percentage = 100
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    if threads:
        scene.render.threads_mode, scene.render.threads = "FIXED", threads
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    return scene


def render_panorama(scene: bpy.types.Scene, picture: Path) -> np.ndarray:
    """Render [H, W, 3] of all directions: the top row is up, the centre +X, columns run clockwise seen from above."""
    lens = scene.camera.data
    lens.type = "PANO"
    panorama = lens if hasattr(lens, "panorama_type") else lens.cycles
    panorama.panorama_type = "EQUIRECTANGULAR"
    scene.camera.matrix_world = looking(Vector((1, 0, 0)))
    return render(scene, picture, _SIZE_PX, _SAMPLES)


def render_close_up(scene: bpy.types.Scene, picture: Path, towards: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Render [N, N, 3] seen by a pinhole camera that looks `towards`; also the camera's axes [3, 3] in the world."""
    lens = scene.camera.data
    lens.type, lens.lens_unit, lens.angle = "PERSP", "FOV", float(_CLOSE_UP_RAD)
    scene.camera.matrix_world = looking(Vector(towards))
    pixels = render(scene, picture, (_CLOSE_UP_PX, _CLOSE_UP_PX), _CLOSE_UP_SAMPLES)
    return pixels, np.array(scene.camera.matrix_world)[:3, :3]


def looking(towards: Vector) -> Matrix:
    """Compute a camera's matrix with its -Z along `towards`."""
    return towards.to_track_quat("-Z", "Y").to_matrix().to_4x4()


def render(scene: bpy.types.Scene, picture: Path, size_px: tuple, samples: int) -> np.ndarray:
    """Render the linear pixels of the scene, top row first."""
    scene.render.resolution_x, scene.render.resolution_y = size_px
    scene.cycles.samples = samples
    scene.render.filepath = str(picture)
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(str(picture), check_existing=False)
    pixels = np.empty(4 * size_px[0] * size_px[1], np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    return pixels.reshape(size_px[1], size_px[0], 4)[::-1, :, :3]


def find_peaks(radiance: np.ndarray) -> list[np.ndarray]:
    """Find unit directions of the brightest spots, at most `_CLOSE_UPS`."""
    height, width, _ = radiance.shape
    elevation = np.pi / 2 - (np.arange(height) + 0.5) * np.pi / height
    azimuth = np.pi - (np.arange(width) + 0.5) * 2 * np.pi / width
    brightness = np.where(np.isfinite(radiance), radiance, 0).sum(-1)
    mean = (brightness * np.cos(elevation)[:, None]).sum() / (np.cos(elevation).sum() * width)
    peaks = []
    for index in np.argsort(brightness, axis=None)[::-1][:20000]:
        row, column = divmod(int(index), width)
        if brightness[row, column] <= _PEAK_FACTOR * mean or len(peaks) == _CLOSE_UPS:
            break
        across = np.cos(elevation[row])
        towards = np.array([across * np.cos(azimuth[column]), across * np.sin(azimuth[column]), np.sin(elevation[row])])
        if all(np.dot(towards, other) < np.cos(_PEAK_DISTANCE_RAD) for other in peaks):
            peaks.append(towards)
    return peaks


if __name__ == "__main__":
    try:
        main(*(Path(argument) for argument in sys.argv[-2:]))
        status = 0
    except BaseException:
        traceback.print_exc()
        status = 1
    # Blender as a module may hang or crash when its process ends in the usual way.
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(status)

"""A white patch in Cycles, and the same patch lit by a `Light` record, slowly and simply, in numpy."""

import bpy
import numpy as np
from livehand.livehand_blender.light.light import read_light
from mathutils import Vector

SIZE_PX = 8
SIDE_M = 0.2


def white_patch():
    """An empty scene whose camera sees a white diffuse square of SIDE_M at the origin, facing +Z; direct light only."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.samples, cycles.max_bounces, cycles.pixel_filter_type = 256, 0, "BOX"
    cycles.use_adaptive_sampling = cycles.use_denoising = False
    scene.render.resolution_x = scene.render.resolution_y = SIZE_PX
    scene.render.threads_mode, scene.render.threads = "FIXED", 1
    settings = scene.render.image_settings
    settings.file_format, settings.color_mode, settings.color_depth = "OPEN_EXR", "RGB", "32"
    patch = square("Patch", SIDE_M)
    patch.data.materials.append(white())
    camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    camera.data.type, camera.data.ortho_scale, camera.data.clip_start = "ORTHO", SIDE_M, 0.001
    camera.parent, camera.location = patch, (0, 0, 0.01)
    scene.collection.objects.link(camera)
    scene.camera = camera
    return scene


def square(name, side_m, location=(0, 0, 0)):
    """A square object in the XY plane."""
    half = side_m / 2
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata([(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0)], [], [(0, 1, 2, 3)])
    thing = bpy.data.objects.new(name, mesh)
    thing.location = location
    bpy.context.scene.collection.objects.link(thing)
    return thing


def white():
    """A material of albedo 1."""
    material = bpy.data.materials.new("White")
    if bpy.app.version < (5, 0, 0):
        material.use_nodes = True
    tree = material.node_tree
    tree.nodes.clear()
    diffuse, output = tree.nodes.new("ShaderNodeBsdfDiffuse"), tree.nodes.new("ShaderNodeOutputMaterial")
    diffuse.inputs["Color"].default_value = (1, 1, 1, 1)
    tree.links.new(diffuse.outputs[0], output.inputs[0])
    return material


def add_lamp(kind, energy, location, towards=(0, 0, 0), **settings):
    """A lamp that shines from one place towards another; `scale` is the object's."""
    data = bpy.data.lights.new(kind.title(), kind)
    data.energy = energy
    lamp = bpy.data.objects.new(kind.title(), data)
    lamp.location, lamp.scale = location, settings.pop("scale", (1, 1, 1))
    lamp.rotation_euler = (Vector(towards) - Vector(location)).to_track_quat("-Z", "Y").to_euler()
    for name, value in settings.items():
        setattr(data, name, value)
    bpy.context.scene.collection.objects.link(lamp)
    return lamp


def cycles_pixels(folder):
    """[SIZE_PX, SIZE_PX, 3] linear, top row first."""
    scene = bpy.context.scene
    scene.render.filepath = str(folder / "patch.exr")
    bpy.ops.render.render(write_still=True)
    image = bpy.data.images.load(scene.render.filepath, check_existing=False)
    pixels = np.array(image.pixels[:]).reshape(SIZE_PX, SIZE_PX, 4)[::-1, :, :3]
    bpy.data.images.remove(image)
    return pixels


def light_now(mesh_name="Patch"):
    """The record of the open scene's light on the patch."""
    depsgraph = bpy.context.evaluated_depsgraph_get()
    patch = bpy.data.objects[mesh_name].evaluated_get(depsgraph)
    matrix = np.array(patch.matrix_world)
    vertices = np.array([vertex.co for vertex in patch.data.vertices]) @ matrix[:3, :3].T + matrix[:3, 3]
    return read_light(depsgraph, mesh_name, vertices)


def expected_pixels(light):
    """[SIZE_PX, SIZE_PX, 3] the patch's irradiance / pi in the light; nothing shadows it."""
    positions = (np.arange(SIZE_PX) + 0.5) / SIZE_PX * SIDE_M - SIDE_M / 2
    x, y = np.meshgrid(positions, -positions)
    matrix = np.array(bpy.data.objects["Patch"].matrix_world)
    points = np.stack([x, y, np.zeros_like(x)], -1).reshape(-1, 3) @ matrix[:3, :3].T + matrix[:3, 3]
    normal = matrix[:3, 2]
    total = sum(lamp_irradiance(lamp, points, normal) for lamp in light.lamps) + np.zeros((len(points), 3))
    if light.sky is not None:
        cosine = np.maximum(light.sky.directions @ normal, 0)
        total = total + (light.sky.radiance * (light.sky.solid_angles * cosine)[..., None]).sum((0, 1))
    return total.reshape(SIZE_PX, SIZE_PX, 3) / np.pi


def lamp_irradiance(lamp, points, normal, count=4000):
    """[N, 3] at points [N, 3] that face `normal`, by samples of the lamp's surface."""
    u, v = (np.arange(count) + 0.5) / count, (np.arange(count) * 0.6180339887) % 1.0
    if lamp.kind == "sun":
        directions = sun_directions(lamp, u, v)
        return lamp.rgb * np.maximum(directions @ normal, 0).mean() / (directions @ -lamp.direction).mean()
    positions, normals, area = surface_samples(lamp, u, v)
    towards = positions[None] - points[:, None]
    distance = np.linalg.norm(towards, axis=-1)
    towards /= distance[..., None]
    leaving = -np.einsum("npk,pk->np", towards, normals)
    arriving = np.maximum(towards @ normal, 0)
    share = np.maximum(leaving, 0) * arriving / distance**2 * beam(lamp, -towards, leaving)
    return lamp.rgb * (share.mean(1) * area * radiance_of_one_watt(lamp))[:, None]


def sun_directions(lamp, u, v):
    """[P, 3] towards the points of a sun's disc, uniform in solid angle."""
    z, turn = 1 - u * (1 - np.cos(lamp.angle_rad / 2)), 2 * np.pi * v
    across = np.sqrt(1 - z**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], -1) @ lamp.rotation.T


def surface_samples(lamp, u, v):
    """Places and normals [P, 3] on a lamp, uniform in its area, m^2; a point becomes a sphere of 0.1 mm."""
    if lamp.kind == "area":
        if lamp.is_ellipse:
            radius, turn = np.sqrt(u) / 2, 2 * np.pi * v
            local = np.stack([radius * np.cos(turn), radius * np.sin(turn), 0 * u], -1)
        else:
            local = np.stack([u - 0.5, v - 0.5, 0 * u], -1)
        local[:, :2] *= lamp.size_m
        return local @ lamp.rotation.T + lamp.position, np.broadcast_to(lamp.direction, local.shape), area_m2(lamp)
    z, turn = 2 * u - 1, 2 * np.pi * v
    across = np.sqrt(1 - z**2)
    normals = np.stack([across * np.cos(turn), across * np.sin(turn), z], -1)
    return lamp.position + radius_m(lamp) * normals, normals, 4 * np.pi * radius_m(lamp) ** 2


def radius_m(lamp):
    return max(lamp.radius_m, 1e-4)


def area_m2(lamp):
    return lamp.size_m[0] * lamp.size_m[1] * (np.pi / 4 if lamp.is_ellipse else 1)


def radiance_of_one_watt(lamp):
    return 1 / (np.pi * area_m2(lamp)) if lamp.kind == "area" else 1 / (4 * np.pi**2 * radius_m(lamp) ** 2)


def beam(lamp, leaving_direction, leaving_cosine):
    """[N, P] the share of the radiance that spread or cone let through in a direction from the lamp."""
    if lamp.kind == "spot":
        cosine, edge = leaving_direction @ lamp.direction, np.cos(lamp.cone_rad / 2)
        t = np.clip((cosine - edge) / max((1 - edge) * lamp.blend, 1e-9), 0, 1)
        return t * t * (3 - 2 * t)
    if lamp.kind == "area" and lamp.spread_rad < np.pi - 1e-3:
        half = lamp.spread_rad / 2
        cosine = np.clip(leaving_cosine, 1e-6, 1)
        return np.maximum(np.tan(half) - np.sqrt(1 - cosine**2) / cosine, 0) / (np.tan(half) - half)
    return 1.0


NORMALS = ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1), (0.6, -0.6, 0.53), (-0.5, 0.4, 0.77))


def face(normal):
    """Turn the patch, and the camera that it carries."""
    patch = bpy.data.objects["Patch"]
    patch.rotation_euler = Vector(normal).to_track_quat("Z", "Y").to_euler()
    bpy.context.view_layer.update()


def add_world():
    """A world with nodes; returns its tree, with a Background of strength 1."""
    world = bpy.data.worlds.new("Sphere of Light")
    bpy.context.scene.world = world
    if bpy.app.version < (5, 0, 0):
        world.use_nodes = True
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 256
    return world.node_tree


def link(tree, output, target):
    tree.links.new(output, target)
    return target.node


def environment(tree, pixels, rotation=(0, 0, 0)):
    """An environment texture of linear pixels [H, W, 3], top row first, behind a mapping."""
    height, width, _ = pixels.shape
    image = bpy.data.images.new("Surroundings", width, height, float_buffer=True)
    image.colorspace_settings.name = "Linear Rec.709"
    rgba = np.concatenate([pixels, np.ones((height, width, 1))], -1)[::-1]
    image.pixels.foreach_set(rgba.astype(np.float32).ravel())
    texture, mapping = tree.nodes.new("ShaderNodeTexEnvironment"), tree.nodes.new("ShaderNodeMapping")
    coordinates = tree.nodes.new("ShaderNodeTexCoord")
    texture.image = image
    mapping.inputs["Rotation"].default_value = rotation
    tree.links.new(coordinates.outputs["Generated"], mapping.inputs["Vector"])
    tree.links.new(mapping.outputs["Vector"], texture.inputs["Vector"])
    tree.links.new(texture.outputs["Color"], tree.nodes["Background"].inputs["Color"])
    return image

"""Cryptomatte: Blender's own node decodes the passes and metadata that a small engine writes."""

import json

import bpy
import numpy as np
import pytest
from livehand.backend.render.cryptomatte import crypto_hash, crypto_id, crypto_metadata, crypto_ranks

LAYER = "ViewLayer.CryptoObject"


@pytest.fixture
def engine():
    """Renders two objects of known coverage, as LIVEHAND would."""
    columns = np.linspace(0, 1, 8)[None].repeat(6, 0).astype(np.float32)
    coverages = {"Händ.R": columns, 'Mug "old"': (1 - columns) * 0.5}

    class CryptoEngine(bpy.types.RenderEngine):
        bl_idname = "LIVEHAND_TEST_CRYPTO"
        bl_label = "Crypto"

        def update_render_passes(self, scene, renderlayer):
            self.register_pass(scene, renderlayer, "Combined", 4, "RGBA", "COLOR")
            self.register_pass(scene, renderlayer, "CryptoObject00", 4, "RGBA", "COLOR")

        def render(self, depsgraph):
            self.add_pass("CryptoObject00", 4, "RGBA")
            result = self.begin_result(0, 0, 8, 6, layer=depsgraph.view_layer.name)
            (level,) = crypto_ranks(coverages, level_count=1)
            result.layers[0].passes["CryptoObject00"].rect.foreach_set(level[::-1].ravel())
            for field, value in crypto_metadata(f"{depsgraph.view_layer.name}.CryptoObject", coverages).items():
                self.get_result().stamp_data_add_field(field, value)
            self.end_result(result)

    bpy.utils.register_class(CryptoEngine)
    scene = bpy.context.scene
    scene.render.engine = CryptoEngine.bl_idname
    scene.render.resolution_x, scene.render.resolution_y = 8, 6
    scene.camera = bpy.data.objects.new("Camera", bpy.data.cameras.new("Camera"))
    scene.collection.objects.link(scene.camera)
    scene.view_layers[0].name = "ViewLayer"
    yield coverages
    bpy.utils.unregister_class(CryptoEngine)


def save_exr(scene, path):
    settings = scene.render.image_settings
    if hasattr(settings, "media_type"):
        settings.media_type = "MULTI_LAYER_IMAGE"
    settings.file_format, settings.color_depth, settings.exr_codec = "OPEN_EXR_MULTILAYER", "32", "ZIP"
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def matte(name, scene, path, read_exr):
    """What Blender's Cryptomatte node makes of a name: the composite's red."""
    from livehand.livehand_blender.compositing.tree import compositor_of, output_input

    tree = compositor_of(scene)
    tree.nodes.clear()
    node = tree.nodes.new("CompositorNodeCryptomatteV2")
    node.source, node.scene = "RENDER", scene
    node.layer_name, node.matte_id = LAYER, name
    tree.links.new(node.outputs["Matte"], output_input(tree))
    save_exr(scene, path)
    return read_exr(path)["Composite.Combined.R"]


def test_blenders_own_node_finds_each_object_exactly(engine, read_exr, tmp_path):
    for number, (name, coverage) in enumerate(engine.items()):
        found = matte(name, bpy.context.scene, tmp_path / f"{number}.exr", read_exr)
        np.testing.assert_array_equal(found, coverage)


def test_the_files_header_says_which_name_has_which_id(engine, tmp_path):
    save_exr(bpy.context.scene, tmp_path / "crypto.exr")
    header = (tmp_path / "crypto.exr").read_bytes()[:4000]
    fields = crypto_metadata(LAYER, engine)
    for name, value in fields.items():
        assert name.encode() in header
        assert value.encode() in header
    assert 'Händ.R":"'.encode() in header  # in UTF-8, not escaped
    assert {name.rpartition("/")[0] for name in fields} == {f"cryptomatte/{crypto_hash(LAYER):08x}"[:19]}
    (manifest,) = (json.loads(value) for name, value in fields.items() if name.endswith("/manifest"))
    assert {name: np.uint32(int(bits, 16)).view(np.float32) for name, bits in manifest.items()} == {
        name: crypto_id(name) for name in engine
    }

"""Cryptomatte: published hashes, ranks by hand, and Blender's own node on what a small engine writes."""

import json

import bpy
import numpy as np
import pytest
from livehand.backend.rendering.cryptomatte import (
    crypto_hash,
    crypto_id,
    crypto_metadata,
    crypto_ranks,
    merged_ranks,
    murmur3_32,
)

LAYER = "ViewLayer.CryptoObject"


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", 0),
        ("test", 0xBA6BD213),
        ("Hello, world!", 0xC0363E43),
        ("The quick brown fox jumps over the lazy dog", 0x2E4FF723),
    ],
)
def test_murmur_hashes_are_the_published_ones(text, expected):
    assert murmur3_32(text.encode()) == expected


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("hello", 6.0705627102400005616e-17),
        ("cube", -4.08461912519e15),
        ("sphere", 2.79018604383e15),
        ("plane", 3.66557617593e-11),
    ],
)
def test_ids_are_those_of_the_specifications_own_program(name, expected):
    assert float(crypto_id(name)) == pytest.approx(expected, rel=1e-11)


def test_every_id_is_a_normal_float(monkeypatch):
    module = "livehand.backend.rendering.cryptomatte.murmur3_32"
    for bits in (0x00000001, 0x7F800000, 0xFF800001, 0x807FFFFF):
        monkeypatch.setattr(module, lambda data, bits=bits: bits)
        assert np.isfinite(crypto_id("x"))
        assert abs(crypto_id("x")) >= np.finfo(np.float32).tiny
        assert crypto_hash("x") == bits ^ 1 << 23


def test_ranks_go_from_the_largest_coverage_down():
    coverages = {"a": [[0.2, 0.0]], "b": [[0.5, 1.0]], "c": [[0.3, 0.0]]}
    a, b, c = (float(crypto_id(name)) for name in "abc")
    one, two = crypto_ranks({name: np.array(value) for name, value in coverages.items()}, level_count=2).tolist()
    np.testing.assert_array_equal(one, np.float32([[[b, 0.5, c, 0.3], [b, 1, 0, 0]]]))
    np.testing.assert_array_equal(two, np.float32([[[a, 0.2, 0, 0], [0, 0, 0, 0]]]))


def test_what_does_not_fit_is_left_out():
    coverages = {name: np.full((1, 1), coverage) for name, coverage in (("a", 0.2), ("b", 0.5), ("c", 0.3))}
    (level,) = crypto_ranks(coverages, level_count=1)
    np.testing.assert_array_equal(level[0, 0, 1::2], np.float32([0.5, 0.3]))


@pytest.fixture
def engine():
    """Renders two objects whose coverages are known, as LIVEHAND would."""
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
    assert 'Händ.R":"'.encode() in header  # as it is, not as an escape
    assert {name.rpartition("/")[0] for name in fields} == {f"cryptomatte/{crypto_hash(LAYER):08x}"[:19]}
    (manifest,) = (json.loads(value) for name, value in fields.items() if name.endswith("/manifest"))
    assert {name: np.uint32(int(bits, 16)).view(np.float32) for name, bits in manifest.items()} == {
        name: crypto_id(name) for name in engine
    }


def test_objects_put_into_a_picture_take_their_part_of_what_was_there():
    before = {"wall": np.full((2, 3), 0.6), "cup": np.full((2, 3), 0.4)}
    hand = {"hand": np.linspace(0, 1, 6).reshape(2, 3)}
    left = 1 - hand["hand"]
    expected = crypto_ranks({**{name: part * left for name, part in before.items()}, **hand}, 2)
    merged = merged_ranks(crypto_ranks(before, 2), hand)
    np.testing.assert_allclose(merged[..., 1::2], expected[..., 1::2], atol=1e-6)
    is_clear = np.abs(np.diff(np.sort(np.stack([0.6 * left, 0.4 * left, hand["hand"]]), 0), axis=0)).min(0) > 1e-3
    np.testing.assert_array_equal(merged[:, is_clear][..., ::2], expected[:, is_clear][..., ::2])

"""File Output nodes write where the shot says, and the user knows; or nowhere, or into the output folder."""

import json

import bpy
import pytest
from livehand.livehand_blender import cli
from livehand.livehand_blender.compositing.tree import compositor_of, output_input
from livehand.livehand_blender.render.file_outputs import _BASE_PATH


@pytest.fixture
def elsewhere(hand_scene, shot_path, tmp_path):
    """A folder that two nodes of the shot write to, one of them in a group."""
    tree = compositor_of(hand_scene)
    rendered = tree.nodes.new("CompositorNodeRLayers").outputs["Image"]
    tree.links.new(rendered, output_input(tree))
    inner = bpy.data.node_groups.new("Inner", "CompositorNodeTree")
    inner.interface.new_socket("Image", in_out="INPUT", socket_type="NodeSocketColor")
    group = tree.nodes.new("CompositorNodeGroup")
    group.node_tree = inner
    tree.links.new(rendered, group.inputs[0])
    for owner, name, source in (
        (tree, "Beauty", rendered),
        (inner, "Inner: 1", inner.nodes.new("NodeGroupInput").outputs[0]),
    ):
        node = owner.nodes.new("CompositorNodeOutputFile")
        node.name = name
        setattr(node, _BASE_PATH, str(tmp_path / "elsewhere"))
        if hasattr(node, "file_output_items"):
            node.file_output_items.new("RGBA", "Image")
        owner.links.new(source, node.inputs[0])
    bpy.ops.wm.save_mainfile()
    return tmp_path / "elsewhere"


@pytest.fixture
def render(shot_path, tmp_path, fake_session, capsys):
    def run(*arguments):
        capsys.readouterr()
        command = ["render", str(shot_path), "-o", str(tmp_path / "out"), "--frames", "1", "--json", *arguments]
        code = cli.main(command)
        out, err = capsys.readouterr()
        return code, [json.loads(line) for line in out.splitlines()], err

    return run


def images(folder):
    return [path for path in folder.rglob("*") if path.is_file() and not path.name.startswith("wave_")]


def test_they_are_kept_with_a_warning(render, elsewhere, tmp_path):
    code, events, err = render()
    (warning,) = (event["message"] for event in events if event.get("event") == "warning")
    assert code == 0
    assert warning.startswith(f"2 File Output nodes write outside the output folder: {elsewhere}; --file-outputs mute")
    assert f"warning: {warning}" in err
    assert images(elsewhere) != []


def test_they_are_muted(render, elsewhere, tmp_path):
    assert render("--file-outputs", "mute")[::2] == (0, "")
    assert not elsewhere.exists()
    assert images(tmp_path / "out") == []


def test_they_are_moved_into_the_output_folder(render, elsewhere, tmp_path):
    assert render("--file-outputs", "move")[::2] == (0, "")
    assert not elsewhere.exists()
    assert {path.parent.name for path in images(tmp_path / "out")} == {"Beauty", "Inner__1"}


def test_one_that_writes_into_the_output_folder_or_is_muted_is_no_fault(hand_scene, elsewhere, render, tmp_path):
    tree = compositor_of(hand_scene)
    setattr(tree.nodes["Beauty"], _BASE_PATH, str(tmp_path / "out" / "beauty"))
    bpy.data.node_groups["Inner"].nodes["Inner: 1"].mute = True
    bpy.ops.wm.save_mainfile()
    assert render()[::2] == (0, "")
    assert {path.parent.name for path in images(tmp_path / "out")} == {"beauty"}


def test_nodes_of_a_compositor_that_is_off_write_nothing(hand_scene, elsewhere, render):
    hand_scene.render.use_compositing = False
    bpy.ops.wm.save_mainfile()
    assert render()[::2] == (0, "")
    assert not elsewhere.exists()

import os
import subprocess
import sys
import textwrap

import bpy
import livehand
import pytest
from livehand.livehand_blender import registration


def menu_entries():
    return len(getattr(bpy.types.VIEW3D_MT_armature_add.draw, "_draw_funcs", ()))


def panels_with_our_engine():
    return {
        panel.__name__
        for panel in bpy.types.Panel.__subclasses__()
        if "LIVEHAND" in getattr(panel, "COMPAT_ENGINES", ()) and not panel.__name__.startswith("LIVEHAND")
    }


def handlers():
    lists = {name: getattr(bpy.app.handlers, name) for name in dir(bpy.app.handlers)}
    return {name: len(functions) for name, functions in lists.items() if isinstance(functions, list)}


@pytest.fixture
def _back_again():
    yield
    if not hasattr(bpy.types.Object, "livehand"):
        livehand.register()


@pytest.mark.usefixtures("_back_again")
def test_unregister_leaves_nothing_and_register_works_again():
    with_livehand, entries = handlers(), menu_entries()
    for _ in range(2):
        livehand.unregister()
        assert not hasattr(bpy.types.Object, "livehand")
        assert not hasattr(bpy.types.Scene, "livehand")
        assert [name for name in dir(bpy.types) if name.startswith("LIVEHAND")] == []
        assert not [cls for cls in registration.CLASSES if cls.is_registered]
        assert panels_with_our_engine() == set()
        assert menu_entries() == entries - 1
        livehand.register()
        assert all(cls.is_registered for cls in registration.CLASSES)
        assert panels_with_our_engine()
    assert menu_entries() == entries
    assert handlers() == with_livehand


@pytest.mark.usefixtures("_back_again")
def test_rendered_views_are_stopped_first():
    bpy.context.scene.render.engine = "LIVEHAND"
    windows = bpy.context.window_manager.windows
    spaces = [area.spaces.active for window in windows for area in window.screen.areas if area.type == "VIEW_3D"]
    spaces[0].shading.type = "RENDERED"
    livehand.unregister()
    assert spaces[0].shading.type == "SOLID"


def test_no_panel_is_there_twice():
    """Cycles has its own Visibility, Light, Simplify and more in place of Blender's."""
    replaced = {"OBJECT_PT_visibility", "DATA_PT_light", "DATA_PT_preview", "RENDER_PT_simplify", "DATA_PT_camera_dof"}
    replaced |= {"RENDER_PT_post_processing", "NODE_DATA_PT_light", "VIEWLAYER_PT_layer_passes"}
    assert replaced.isdisjoint(panels_with_our_engine())
    kept = {"RENDER_PT_format", "DATA_PT_lens", "CYCLES_OBJECT_PT_visibility", "CYCLES_LIGHT_PT_light"}
    assert kept <= panels_with_our_engine()


def test_the_scenes_viewport_samples_are_offered_in_both_modes():
    for mode in ("HAND", "SCENE"):
        bpy.context.scene.livehand.mode = mode
        assert "CYCLES_RENDER_PT_sampling_viewport" in panels_with_our_engine()


def test_preferences_belong_to_the_installed_package():
    from livehand.livehand_blender.ui.preferences import LIVEHAND_AP_preferences

    assert LIVEHAND_AP_preferences.bl_idname == "livehand"


def run_python(code, *, limit_s=60):
    """A fresh process: Blender as a module hangs at exit if anything is left registered."""
    return subprocess.run(
        [sys.executable, "-c", textwrap.dedent(code)],
        capture_output=True,
        text=True,
        timeout=limit_s,
        check=False,
        env={**os.environ, "PYTHONWARNINGS": "error::DeprecationWarning:livehand"},
    )


def test_a_process_that_adds_a_hand_ends_cleanly_and_needs_numpy_alone():
    done = run_python(
        """
        import sys
        for name in ("torch", "trimesh", "xatlas", "jaxtyping", "safetensors", "PIL", "tqdm", "scipy"):
            sys.modules[name] = None  # so that importing it fails
        import bpy, livehand
        livehand.register()
        bpy.ops.livehand.add_hand(side="left")
        livehand.unregister()
        """
    )
    assert done.returncode == 0, done.stderr


def test_package_imports_without_blender_or_torch():
    done = run_python(
        """
        import sys
        sys.modules["bpy"] = sys.modules["torch"] = None
        import livehand, livehand.livehand_blender
        """
    )
    assert done.returncode == 0, done.stderr

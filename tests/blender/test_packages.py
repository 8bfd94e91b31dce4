"""Install Packages and Get Hand Tracker: only online and when asked, in steps that a window watches, to be canceled."""

import hashlib
import sys
import sysconfig
from types import SimpleNamespace

import bpy
import numpy as np
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system import packages as dependencies
from livehand.backend.system.gpu_driver import CudaVersion
from livehand.livehand_blender.render import package_folder
from livehand.livehand_blender.render.engine import LiveHandRender
from livehand.livehand_blender.render.package_folder import forget_packages, packages_folder, use_packages
from livehand.livehand_blender.ui import packages, preferences
from livehand.livehand_blender.ui.packages import LIVEHAND_PT_packages, RunningTask
from livehand.livehand_blender.ui.panels import LIVEHAND_PT_performance
from livehand.livehand_blender.ui.preferences import LIVEHAND_AP_preferences
from livehand.tests.blender.test_panels import Layout, clipped, drawn_layout
from livehand.tests.fake_wheels import fake_wheel

FAKE = dependencies.Requirement("livehand_missing_package", "livehand-missing-package>=1", 12)
IS_ONLINE = SimpleNamespace(online_access=True, background=True, binary_path="", version=bpy.app.version)


class Context:
    """Stands in for Blender's context: a window manager that records, one window, a workspace."""

    def __init__(self):
        self.said, self.timers = [], []
        self.window = object()
        self.window_manager = SimpleNamespace(
            event_timer_add=lambda interval, window: self.timers.append(interval) or "timer",
            event_timer_remove=lambda timer: self.timers.pop(),
            modal_handler_add=lambda operator: None,
            windows=[],
        )
        self.workspace = SimpleNamespace(status_text_set=self.said.append)
        self.preferences = bpy.context.preferences


class Task:
    """Stands in for an install: it runs until it is told that pip has ended, and may fail."""

    def __init__(self, error=None):
        self.error, self.done = error, []
        self.job = SimpleNamespace(
            is_running=True, last_line="Downloading torch", wait=lambda: self.done.append("waited")
        )

    def progress(self):
        return 0.25

    def finish(self):
        if self.error:
            raise LiveHandError(self.error)
        self.done.append("finished")

    def cancel(self):
        self.done.append("canceled")


class Operator(packages.RunsPip):
    """An operator that Blender does not know, so that it can be called step by step."""

    bl_label = "Install Packages"

    def __init__(self, task):
        self.task, self.reports = task, []

    def start(self, context):
        return self.task

    def report(self, kinds, text):
        self.reports.append((*kinds, text))


@pytest.fixture
def fake(monkeypatch):
    """One package, which is missing."""
    for module in (dependencies, preferences):
        monkeypatch.setattr(module, "REQUIREMENTS", (FAKE,))
    monkeypatch.setattr(RunningTask, "now", None)
    return FAKE


@pytest.fixture
def online(monkeypatch):
    monkeypatch.setattr(packages, "bpy", SimpleNamespace(app=IS_ONLINE, data=bpy.data, context=bpy.context))


@pytest.fixture
def in_window(monkeypatch):
    app = SimpleNamespace(online_access=True, background=False)
    monkeypatch.setattr(packages, "bpy", SimpleNamespace(app=app, data=bpy.data))
    monkeypatch.setattr(RunningTask, "now", None)


def test_the_tab_and_the_preferences_offer_one_button_until_nothing_is_missing(fake, online, monkeypatch):
    assert LIVEHAND_PT_packages.poll(bpy.context)
    assert [one for one in drawn_layout(LIVEHAND_PT_packages).drawn if "." in one] == ["livehand.install_packages"]
    assert "livehand.install_packages" in drawn_layout(LIVEHAND_AP_preferences).drawn
    assert "livehand.copy_install_command" in drawn_layout(LIVEHAND_AP_preferences).drawn
    monkeypatch.setattr(dependencies, "REQUIREMENTS", ())
    monkeypatch.setattr(preferences, "REQUIREMENTS", ())
    assert not LIVEHAND_PT_packages.poll(bpy.context)
    assert not [one for one in drawn_layout(LIVEHAND_AP_preferences).drawn if "." in one]


def test_the_button_tells_the_size_and_fits_a_narrow_tab(fake, online):
    layout = drawn_layout(LIVEHAND_PT_packages)
    assert list(clipped(layout)) == []
    assert any("12 MB" in text for text, _ in layout.parts[0].parts)


@pytest.mark.parametrize(("engine", "shading", "is_shown"), [("LIVEHAND", "RENDERED", 1), ("LIVEHAND", "SOLID", 0)])
def test_a_rendered_view_has_the_button_in_its_header(fake, online, engine, shading, is_shown):
    bpy.context.scene.render.engine = engine
    context = SimpleNamespace(
        scene=bpy.context.scene,
        preferences=bpy.context.preferences,
        space_data=SimpleNamespace(shading=SimpleNamespace(type=shading)),
    )
    drawn = []
    packages._draw_header(SimpleNamespace(layout=Layout(drawn)), context)
    assert drawn == ["livehand.install_packages", "RENDER"][: 2 * is_shown]


def test_the_headers_button_is_at_its_left_end():
    """What is right of Blender's own is cut off in a usual window."""
    assert bpy.types.VIEW3D_HT_header.draw._draw_funcs[0] is packages._draw_header


def test_offline_blenders_own_button_stands_before_it_and_nothing_starts(fake, monkeypatch):
    monkeypatch.setattr(bpy.context.preferences.system, "use_online_access", False)
    assert not bpy.app.online_access
    drawn = drawn_layout(LIVEHAND_PT_packages).drawn
    assert drawn.index("extensions.userpref_allow_online") < drawn.index("livehand.install_packages")
    operator = Operator(Task())
    assert operator.execute(Context()) == {"CANCELLED"}
    assert operator.reports == [("ERROR", "Online access is off: allow it in Preferences > System > Network")]
    monkeypatch.setattr(packages, "packages_folder", lambda: "somewhere")
    monkeypatch.setattr(packages, "has_networks", lambda: False)
    with pytest.raises(RuntimeError, match="Online access is off"):
        bpy.ops.livehand.install_packages()
    with pytest.raises(RuntimeError, match="Online access is off"):
        bpy.ops.livehand.fetch_tracker()


def test_a_pip_package_says_that_pip_brings_the_others(fake, online):
    assert packages_folder() is None
    with pytest.raises(RuntimeError, match="LiveHand is a pip package here"):
        bpy.ops.livehand.install_packages()


def test_a_window_shows_what_pip_does_and_goes_on(in_window):
    task, context = Task(), Context()
    operator = Operator(task)
    assert operator.execute(context) == {"RUNNING_MODAL"}
    assert context.timers == [0.25]
    assert RunningTask.now is task
    for event in ("TIMER", "MOUSEMOVE", "ESC"):
        assert operator.modal(context, SimpleNamespace(type=event)) == {"PASS_THROUGH"}
    assert context.said == ["Install Packages: Downloading torch"]
    layout = Layout([])
    assert packages.draw_progress(layout)
    assert layout.drawn == [("Install Packages", 0.25), "livehand.cancel_task"]
    task.job.is_running = False
    assert operator.modal(context, SimpleNamespace(type="TIMER")) == {"FINISHED"}
    assert task.done == ["finished"]
    assert context.timers == []
    assert context.said[-1] is None
    assert RunningTask.now is None


def test_the_cross_beside_the_progress_cancels_it(in_window):
    task, context = Task(), Context()
    operator = Operator(task)
    operator.execute(context)
    assert bpy.ops.livehand.cancel_task() == {"FINISHED"}
    assert operator.modal(context, SimpleNamespace(type="TIMER")) == {"CANCELLED"}
    assert task.done == ["canceled"]
    assert context.timers == []
    assert operator.reports == [("INFO", "Install Packages: canceled, nothing has changed")]
    with pytest.raises(RuntimeError, match="poll"):
        bpy.ops.livehand.cancel_task()


def test_a_closed_window_cancels_it(in_window):
    task, context = Task(), Context()
    operator = Operator(task)
    operator.execute(context)
    operator.cancel(context)
    assert task.done == ["canceled"]
    assert RunningTask.now is None


def test_what_pip_could_not_do_is_reported(in_window):
    task, context = Task(error="pip must install the packages, got: no network"), Context()
    operator = Operator(task)
    operator.execute(context)
    task.job.is_running = False
    assert operator.modal(context, SimpleNamespace(type="TIMER")) == {"CANCELLED"}
    assert operator.reports == [("ERROR", "pip must install the packages, got: no network")]
    assert RunningTask.now is None


def test_two_do_not_run_at_once(fake, online, monkeypatch):
    monkeypatch.setattr(packages, "packages_folder", lambda: "somewhere")
    RunningTask.begin(Task(), "Get Hand Tracker")
    with pytest.raises(RuntimeError, match="Get Hand Tracker is still running"):
        bpy.ops.livehand.install_packages()


def test_packages_are_found_once_they_are_there_after_blenders_own(tmp_path, monkeypatch):
    monkeypatch.setattr(package_folder, "EXTENSION", "bl_ext.user_default.livehand")
    monkeypatch.setattr(package_folder.bpy.utils, "extension_path_user", lambda name, path: str(tmp_path / path))
    monkeypatch.setattr(sys, "path", list(sys.path))
    folder = packages_folder()
    assert folder == tmp_path / "packages" / f"py{sys.version_info.major}{sys.version_info.minor}"
    before = list(sys.path)
    use_packages()
    assert sys.path == before
    (folder / "livehand_missing_package").mkdir(parents=True)
    (folder / "livehand_missing_package" / "__init__.py").write_text("")
    use_packages()
    use_packages()
    assert sys.path == [*before, str(folder)]
    assert dependencies.is_installed(FAKE)
    forget_packages()
    assert sys.path == before


def test_a_window_is_sent_to_the_button_and_a_farm_gets_the_line(fake, monkeypatch):
    error = ImportError("torch")
    in_farm = package_folder.missing_packages(error)
    assert "lacks: livehand_missing_package; install them with: " in in_farm
    assert in_farm.split("with: ")[1].startswith(sys.executable)
    app = SimpleNamespace(background=False)
    monkeypatch.setattr(package_folder, "bpy", SimpleNamespace(app=app, utils=bpy.utils))
    in_window = package_folder.missing_packages(error)
    assert in_window.endswith("lacks: livehand_missing_package; press Install Packages at the top of the LiveHand tab")


def test_the_copied_line_installs_the_missing_packages(fake, monkeypatch):
    monkeypatch.setattr(packages, "packages_folder", lambda: None)
    assert bpy.ops.livehand.copy_install_command() == {"FINISHED"}
    monkeypatch.setattr(dependencies, "REQUIREMENTS", ())
    with pytest.raises(RuntimeError, match="No package is missing"):
        bpy.ops.livehand.copy_install_command()


def test_after_an_install_the_kernels_are_prepared_before_a_view_begins_to_render(monkeypatch):
    """A view that begins first compiles the same kernels in Blender's own process."""
    calls = []
    monkeypatch.setattr(packages, "prepare_now", lambda: calls.append("prepare"))
    monkeypatch.setattr(packages, "_restart_rendered_views", lambda: calls.append("render"))
    packages._begin_to_render()
    assert calls == ["prepare", "render"]


def test_a_release_names_the_index_of_its_packages(tmp_path, monkeypatch):
    assert package_folder.released_index() == ""
    monkeypatch.setattr(package_folder, "_INDEX_FILE", tmp_path / "package_index.txt")
    (tmp_path / "package_index.txt").write_text("https://example.org/cpu\n")
    assert package_folder.released_index() == "https://example.org/cpu"


HERE = sysconfig.get_platform()
NEW, OLD = CudaVersion(13, 0), CudaVersion(12, 9)
GPU_BUTTON = ["livehand.install_packages", "GPU"]


@pytest.fixture
def gpu(monkeypatch):
    """A system with a driver whose package for GPUs is a fake one, of 7 MB, and missing."""

    def put(driver, system=HERE, module="livehand_fake_gpu"):
        wheels = (dependencies.PinnedWheel(system, "0" * 64, 7),)
        monkeypatch.setattr(
            packages, "GPU", (dependencies.Requirement(module, "livehand-fake-gpu==1.0", wheels=wheels),)
        )
        monkeypatch.setattr(packages, "cuda_of_driver", lambda: driver)

    monkeypatch.setattr(RunningTask, "now", None)
    return put


@pytest.mark.parametrize("place", [LIVEHAND_AP_preferences, LIVEHAND_PT_performance])
def test_gpu_rendering_is_offered_with_its_size_where_a_driver_is(gpu, online, place):
    gpu(NEW)
    layout = drawn_layout(place)
    at = layout.drawn.index(GPU_BUTTON[0])
    assert layout.drawn[at : at + 2] == GPU_BUTTON
    texts = [part[0] for inner in layout.parts if isinstance(inner, Layout) for part in inner.parts]
    assert "Install GPU Rendering (7 MB)" in texts
    assert list(clipped(drawn_layout(LIVEHAND_PT_performance))) == []


@pytest.mark.parametrize("place", [LIVEHAND_AP_preferences, LIVEHAND_PT_performance])
@pytest.mark.parametrize(
    ("driver", "system", "module", "said"),
    [
        (None, HERE, "livehand_fake_gpu", []),
        (NEW, "elsewhere", "livehand_fake_gpu", []),
        (OLD, HERE, "livehand_fake_gpu", ["update the NVIDIA driver (CUDA 13)"]),
        (NEW, HERE, "livehand", ["Device CUDA renders on GPU"]),
    ],
)
def test_it_is_not_offered_where_it_cannot_be_or_is_there(gpu, online, place, driver, system, module, said):
    gpu(driver, system, module)
    drawn = drawn_layout(place).drawn
    assert GPU_BUTTON[0] not in drawn
    assert [text for text in drawn if "CUDA" in text] == said
    assert list(clipped(drawn_layout(LIVEHAND_PT_performance))) == []


def test_its_progress_stands_in_place_of_the_button_and_offline_blenders_own_button_before_it(gpu, monkeypatch):
    gpu(NEW)
    monkeypatch.setattr(bpy.context.preferences.system, "use_online_access", False)
    drawn = drawn_layout(LIVEHAND_AP_preferences).drawn
    assert drawn[-3:] == ["extensions.userpref_allow_online", *GPU_BUTTON]
    RunningTask.begin(Task(), "Install GPU Rendering")
    assert drawn_layout(LIVEHAND_AP_preferences).drawn[-2:] == [("Install GPU Rendering", 0.25), "livehand.cancel_task"]


@pytest.fixture
def gpu_index(tmp_path, monkeypatch):
    """An index that has the package for GPUs, by its hash, and a folder of an extension's own."""
    wheel = fake_wheel(tmp_path / "index", "livehand-fake-gpu", needs=["numpy"])
    sha256 = hashlib.sha256(wheel.read_bytes()).hexdigest()
    wheels = (dependencies.PinnedWheel(HERE, sha256, 7),)
    wanted = (dependencies.Requirement("livehand_fake_gpu", "livehand-fake-gpu==1.0", wheels=wheels),)
    monkeypatch.setattr(packages, "GPU", wanted)
    for module in (packages, package_folder):
        monkeypatch.setattr(module, "packages_folder", lambda: tmp_path / "packages" / "py311")
    monkeypatch.setattr(sys, "path", list(sys.path))
    monkeypatch.setattr(RunningTask, "now", None)
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path / "index"))
    return tmp_path


@pytest.mark.slow
def test_gpu_rendering_is_installed_and_what_is_loaded_chooses_again(gpu_index, online, capfd):
    session = LiveHandRender.required_session()
    session._renderers["one that is loaded"] = object()
    assert bpy.ops.livehand.install_packages(purpose="GPU") == {"FINISHED"}
    assert (gpu_index / "packages" / "py311" / "livehand_fake_gpu" / "__init__.py").is_file()
    assert sys.path[-1] == str(gpu_index / "packages" / "py311")
    assert packages.missing_for("GPU") == ()
    assert session._renderers == {}
    said = capfd.readouterr().out
    assert "Install GPU Rendering: done" in said
    assert "Device CUDA, in Advanced > Performance, now renders on the GPU" in said
    with pytest.raises(RuntimeError, match="nothing to install"):
        bpy.ops.livehand.install_packages(purpose="GPU")


@pytest.mark.slow
def test_gpu_rendering_of_another_hash_is_refused_and_renderers_stay(gpu_index, online):
    fake_wheel(gpu_index / "index", "livehand-fake-gpu", licence="another")
    session = LiveHandRender.required_session()
    session._renderers["one that is loaded"] = loaded = object()
    try:
        with pytest.raises(RuntimeError, match="DO NOT MATCH THE HASHES"):
            bpy.ops.livehand.install_packages(purpose="GPU")
        assert session._renderers == {"one that is loaded": loaded}
    finally:
        session.free()
    assert len(packages.missing_for("GPU")) == 1
    assert list((gpu_index / "packages" / "py311").iterdir()) == []


@pytest.mark.slow
def test_other_packages_leave_what_is_loaded_and_say_nothing_of_a_gpu(gpu_index, online, monkeypatch, capfd):
    fake_wheel(gpu_index / "index", "livehand-fake-camera")
    fake_wheel(gpu_index / "index", "numpy", np.__version__)
    monkeypatch.setattr(packages, "CAMERA", (dependencies.Requirement("livehand_fake_camera", "livehand-fake-camera"),))
    session = LiveHandRender.required_session()
    session._renderers["one that is loaded"] = loaded = object()
    try:
        assert bpy.ops.livehand.install_packages(purpose="CAMERA") == {"FINISHED"}
        assert session._renderers == {"one that is loaded": loaded}
    finally:
        session.free()
    said = capfd.readouterr().out
    assert "Install Packages: done" in said
    assert "GPU" not in said

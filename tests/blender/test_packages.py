"""Install Packages and Get Hand Tracker: only online and when asked, in steps that a window watches, to be canceled."""

import sys
from types import SimpleNamespace

import bpy
import pytest
from livehand.backend.records.errors import LiveHandError
from livehand.backend.system import packages as dependencies
from livehand.livehand_blender.render import package_folder
from livehand.livehand_blender.render.package_folder import forget_packages, packages_folder, use_packages
from livehand.livehand_blender.ui import packages, preferences
from livehand.livehand_blender.ui.packages import LIVEHAND_PT_packages, RunningTask
from livehand.livehand_blender.ui.preferences import LIVEHAND_AP_preferences
from livehand.tests.blender.test_panels import Layout, clipped, drawn_layout

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

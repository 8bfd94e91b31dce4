"""Python packages and the hand tracker, which pip brings while Blender goes on; and the farms' line for a terminal."""

from __future__ import annotations

from typing import Any, ClassVar, Protocol

import bpy
from bpy.props import EnumProperty

from ...backend.records.errors import LiveHandError
from ...backend.system.gpu_driver import cuda_of_driver, driver_fault
from ...backend.system.package_files import PackageFetch
from ...backend.system.package_install import PackageInstall, PipJob, download_mb, install_command
from ...backend.system.packages import CAMERA, GPU, PICTURES, Requirement, missing_of, missing_requirements, wheel_here
from ...backend.system.shells import Shell, command_line, shells_of
from ...backend.tracking.weights import PACKAGE, has_networks, keep_networks
from ..render.engine import prepare_now
from ..render.memory import free_memory
from ..render.package_folder import package_index, packages_folder, use_packages
from ..scene.settings import ENGINE
from .mixins import Tab

_INTERVAL_S = 0.25
_PURPOSES = (
    ("RENDER", "Rendering", "What every picture of a hand needs"),
    ("PICTURES", "Avatars from Pictures", "What avatars from a film or photographs need beside that"),
    ("CAMERA", "Live Hands", "What hands that follow a camera need beside that"),
    ("GPU", "GPU Rendering", "What frames on an NVIDIA GPU need beside that"),
)
_SHELLS = tuple((shell.name, shell.value, f"A line for {shell.value}") for shell in shells_of())
_GPU_TITLE = "Install GPU Rendering"
_OFFLINE = "Online access is off: allow it in Preferences > System > Network"
_NOT_AN_EXTENSION = "LiveHand is a pip package here: install the others with pip, too"


class _Task(Protocol):
    """What pip brings."""

    job: PipJob

    def progress(self) -> float: ...

    def finish(self) -> None: ...

    def cancel(self) -> None: ...


class RunningTask:
    """The one task that runs, which panels show.

    Attributes:
        now: it; None: none runs.
        title: what it does.
    """

    now: ClassVar[_Task | None] = None
    title: ClassVar[str] = ""

    @classmethod
    def begin(cls, task: _Task, title: str) -> None:
        """Show a task that has started."""
        cls.now, cls.title = task, title

    @classmethod
    def end(cls) -> None:
        """Show none."""
        cls.now = None


class RunsPip:
    """Mixin of operators that start a task and watch it by a timer; without a window they wait for its end."""

    bl_label: ClassVar[str]
    report: Any

    @property
    def title(self) -> str:
        """What it does, for users."""
        return self.bl_label

    def start(self, context: bpy.types.Context) -> _Task:
        """Start the task; raises a LiveHandError."""
        raise NotImplementedError

    def execute(self, context):
        """Start; in a window, Blender then calls `modal` by a timer."""
        if not bpy.app.online_access:
            self.report({"ERROR"}, _OFFLINE)
            return {"CANCELLED"}
        try:
            self._task = self.start(context)
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        if bpy.app.background or context.window is None:
            self._task.job.wait()
            return self._finish()
        RunningTask.begin(self._task, self.title)
        self._timer = context.window_manager.event_timer_add(_INTERVAL_S, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Show what pip does, and take what it has brought; everything else goes on."""
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        _redraw(context)
        if RunningTask.now is not self._task:
            self._stop(context)
            self._task.cancel()
            self.report({"INFO"}, f"{self.title}: canceled, nothing has changed")
            return {"CANCELLED"}
        if self._task.job.is_running:
            context.workspace.status_text_set(f"{self.title}: {self._task.job.last_line}")
            return {"PASS_THROUGH"}
        self._stop(context)
        return self._finish()

    def cancel(self, context):
        """Stop when the window was closed."""
        self._stop(context)
        self._task.cancel()

    def _stop(self, context: bpy.types.Context) -> None:
        RunningTask.end()
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)

    def _finish(self) -> set[str]:
        try:
            self._task.finish()
        except LiveHandError as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self.report({"INFO"}, f"{self.title}: done")
        return {"FINISHED"}


class LIVEHAND_OT_install_packages(RunsPip, bpy.types.Operator):
    """Download the missing Python packages with pip, into a folder that Blender removes with LiveHand."""

    bl_idname = "livehand.install_packages"
    bl_label = "Install Packages"
    bl_options = {"INTERNAL"}

    purpose: EnumProperty(name="For", items=_PURPOSES)

    @property
    def title(self) -> str:
        """What it does, for users."""
        return _GPU_TITLE if self.purpose == "GPU" else self.bl_label

    @classmethod
    def poll(cls, context):
        """Enable it while nothing else is installed, where LiveHand has a folder of its own and may use the network."""
        if packages_folder() is None:
            cls.poll_message_set(_NOT_AN_EXTENSION)
            return False
        return _may_start(cls)

    def start(self, context):
        """Start pip."""
        missing = missing_for(self.purpose)
        folder = packages_folder()
        if not missing or folder is None:
            raise LiveHandError("a package must be missing, got none; there is nothing to install")
        return PackageInstall.start(missing, folder, package_index(bpy.context))

    def _finish(self):
        """Let Python and the rendered views find the packages."""
        outcome = super()._finish()
        use_packages()
        if outcome == {"FINISHED"}:
            if self.purpose == "GPU":
                free_memory()  # renderers that are loaded have chosen how they use the GPU
                self.report({"INFO"}, "Device CUDA, in Advanced > Performance, now renders on the GPU")
            _begin_to_render()
        return outcome


class LIVEHAND_OT_fetch_tracker(RunsPip, bpy.types.Operator):
    """Download the hand tracker's networks (36 MB): MediaPipe's, under the Apache License 2.0."""

    bl_idname = "livehand.fetch_tracker"
    bl_label = "Get Hand Tracker"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        """Enable it while the networks are missing and the network may be used."""
        if has_networks():
            cls.poll_message_set("The hand tracker is there already")
            return False
        return _may_start(cls)

    def start(self, context):
        """Start pip."""
        return PackageFetch.start(PACKAGE, keep_networks)


class LIVEHAND_OT_cancel_task(bpy.types.Operator):
    """Stop the download; nothing of it is kept."""

    bl_idname = "livehand.cancel_task"
    bl_label = "Cancel"
    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        """Enable it while something is downloaded."""
        return RunningTask.now is not None

    def execute(self, context):
        """Let the operator that watches it end it."""
        RunningTask.end()
        return {"FINISHED"}


class LIVEHAND_OT_copy_install_command(bpy.types.Operator):
    """Copy the line that installs the missing Python packages in a terminal, for farms."""

    bl_idname = "livehand.copy_install_command"
    bl_label = "Copy Install Command"
    bl_options = {"INTERNAL"}

    shell: EnumProperty(name="Terminal", items=_SHELLS)

    @classmethod
    def poll(cls, context):
        """Enable it while a package is missing."""
        if not missing_requirements():
            cls.poll_message_set("No package is missing")
            return False
        return True

    def execute(self, context):
        """Copy the line to the clipboard, and report it."""
        command = install_command(missing_requirements(), packages_folder(), package_index(context))
        line = command_line(command, Shell[self.shell])
        context.window_manager.clipboard = line
        self.report({"INFO"}, f"Copied: {line}")
        return {"FINISHED"}


class LIVEHAND_PT_packages(Tab, bpy.types.Panel):
    """What is missing before the first picture, at the top of the tab."""

    bl_label = "Packages"
    bl_order = -1
    bl_options = {"HIDE_HEADER"}

    @classmethod
    def poll(cls, context):
        """Show it until a hand can be rendered, and while something is downloaded."""
        return RunningTask.now is not None or bool(missing_requirements())

    def draw(self, context):
        """Draw one line and one button, or the progress."""
        draw_packages(self.layout, context)


CLASSES = (
    LIVEHAND_OT_install_packages,
    LIVEHAND_OT_fetch_tracker,
    LIVEHAND_OT_cancel_task,
    LIVEHAND_OT_copy_install_command,
    LIVEHAND_PT_packages,
)


def missing_for(purpose: str) -> tuple[Requirement, ...]:
    """List what is missing for a purpose of `LIVEHAND_OT_install_packages`."""
    if purpose == "RENDER":
        return missing_requirements()
    return missing_of({"PICTURES": PICTURES, "CAMERA": CAMERA, "GPU": GPU}[purpose])


def draw_packages(layout: bpy.types.UILayout, context: bpy.types.Context, purpose: str = "RENDER") -> None:
    """Draw how to install what is missing for a purpose; draws nothing if nothing is missing or downloaded."""
    if not draw_progress(layout) and missing_for(purpose):
        column = layout.column(align=True)
        column.label(text="Python packages missing", icon="INFO")
        _draw_online(column)
        _draw_install(column, context, purpose, "Install Packages")


def draw_install(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw what installs the packages that rendering needs, or the progress."""
    if not draw_progress(layout):
        _draw_online(layout)
        _draw_install(layout, context, "RENDER", "Install Packages")


def draw_gpu(layout: bpy.types.UILayout, context: bpy.types.Context) -> None:
    """Draw how to install what frames on a GPU need, or what then renders there; draws nothing without its driver."""
    driver = cuda_of_driver()
    if driver is None or not all(map(wheel_here, GPU)):
        return
    column = layout.column(align=True)
    if fault := driver_fault(driver):
        column.label(text="For GPU rendering:", icon="INFO")
        column.label(text=fault)
    elif not missing_for("GPU"):
        column.label(text="Device CUDA renders on GPU", icon="CHECKMARK")
    elif not draw_progress(column):
        _draw_online(column)
        _draw_install(column, context, "GPU", _GPU_TITLE)


def draw_offer(layout: bpy.types.UILayout, context: bpy.types.Context, purpose: str, title: str) -> None:
    """Draw, as one button with a title, what installs the packages of a purpose that few need; or the progress."""
    if not draw_progress(layout):
        _draw_install(layout, context, purpose, title)


def _draw_install(layout: bpy.types.UILayout, context: bpy.types.Context, purpose: str, title: str) -> None:
    megabytes = download_mb(missing_for(purpose), package_index(context))
    text = f"{title} ({megabytes:,} MB)"
    layout.operator("livehand.install_packages", text=text, icon="IMPORT").purpose = purpose


def draw_tracker(layout: bpy.types.UILayout) -> None:
    """Draw how to get the hand tracker, or the progress."""
    if not draw_progress(layout):
        column = layout.column(align=True)
        column.label(text="Hand tracker missing", icon="INFO")
        _draw_online(column)
        column.operator("livehand.fetch_tracker", text=f"Get Hand Tracker ({PACKAGE.megabytes} MB)", icon="IMPORT")


def draw_progress(layout: bpy.types.UILayout) -> bool:
    """Draw the progress of the running task with a button that cancels it; returns whether one runs."""
    task = RunningTask.now
    if task is None:
        return False
    column = layout.column(align=True)
    row = column.row(align=True)
    row.progress(factor=task.progress(), text=RunningTask.title)
    row.operator("livehand.cancel_task", text="", icon="X")
    return True


def add_to_header() -> None:
    """Show the button in the header of a view in Rendered shading, too: at its left end, as its right is cut off."""
    bpy.types.VIEW3D_HT_header.prepend(_draw_header)


def remove_from_header() -> None:
    """Undo `add_to_header`."""
    bpy.types.VIEW3D_HT_header.remove(_draw_header)


def _draw_header(header: bpy.types.Header, context: bpy.types.Context) -> None:
    if context.scene.render.engine == ENGINE and context.space_data.shading.type == "RENDERED":
        row = header.layout.row()
        if not draw_progress(row) and missing_for("RENDER"):
            _draw_install(row, context, "RENDER", "Install Packages")


def _draw_online(layout: bpy.types.UILayout) -> None:
    """Draw, before a button that needs the network, Blender's own button that allows it."""
    if not bpy.app.online_access:
        layout.operator("extensions.userpref_allow_online", text="Allow Online Access", icon="INTERNET")


def _may_start(operator: type) -> bool:
    if RunningTask.now is not None:
        operator.poll_message_set(f"{RunningTask.title} is still running")
        return False
    if not bpy.app.online_access:
        operator.poll_message_set(_OFFLINE)
        return False
    return True


def _redraw(context: bpy.types.Context) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("VIEW_3D", "PREFERENCES"):
                area.tag_redraw()


def _begin_to_render() -> None:
    prepare_now()
    _restart_rendered_views()


def _restart_rendered_views() -> None:
    """Let the views begin anew that showed why they could not render."""
    for screen in bpy.data.screens:
        for area in screen.areas:
            if area.type == "VIEW_3D" and area.spaces.active.shading.type == "RENDERED":
                area.spaces.active.shading.type = "SOLID"
                area.spaces.active.shading.type = "RENDERED"

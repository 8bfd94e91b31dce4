"""The zips of a release: a system, a Python, and the versions of Blender that have that Python."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class System:
    """An operating system on one kind of processor.

    Attributes:
        platform: its name in Blender's manifests.
        wheel_platforms: the tags of wheels that run there, for pip.
        markers: its answers to the conditions in packages' requirements.
        folder: where Blender unpacks wheels there, with a user's name of 20 letters.
        most_path: characters that a path may have; None: no limit that matters.
        ignores_case: two names that differ in case alone are one file.
    """

    platform: str
    wheel_platforms: tuple[str, ...]
    markers: dict[str, str]
    folder: str
    most_path: int | None
    ignores_case: bool

    @property
    def name(self) -> str:
        """Its name in files."""
        return self.platform.replace("-", "_")


@dataclass(frozen=True)
class Target:
    """What one zip is for.

    Attributes:
        system: that it runs on.
        python: version, as `3.11`.
        blender: the first version of Blender that has this Python, and the first that has another; None: not yet.
        numpy: the oldest and the newest that those Blenders bring, or may bring. It is never in the zip.
    """

    system: System
    python: str
    blender: tuple[str, str | None]
    numpy: tuple[str, str]

    @property
    def name(self) -> str:
        """The end of the zip's name."""
        return f"{self.system.name}-py{self.python.replace('.', '')}"

    @property
    def markers(self) -> dict[str, str]:
        """The answers to the conditions in packages' requirements."""
        return self.system.markers | {"python_version": self.python, "python_full_version": f"{self.python}.0"}


WINDOWS = System(
    platform="windows-x64",
    wheel_platforms=("win_amd64",),
    markers={
        "os_name": "nt",
        "sys_platform": "win32",
        "platform_system": "Windows",
        "platform_machine": "AMD64",
    },
    folder=r"C:\Users\{user}\AppData\Roaming\Blender Foundation\Blender\{blender}\extensions\.local\lib\python{python}"
    r"\site-packages",
    most_path=259,
    ignores_case=True,
)
MACOS = System(
    platform="macos-arm64",
    wheel_platforms=("macosx_12_0_arm64", "macosx_12_0_universal2"),  # numba's wheels for Python 3.13 ask for 12
    markers={
        "os_name": "posix",
        "sys_platform": "darwin",
        "platform_system": "Darwin",
        "platform_machine": "arm64",
    },
    folder="/Users/{user}/Library/Application Support/Blender/{blender}/extensions/.local/lib/python{python}"
    "/site-packages",
    most_path=1023,
    ignores_case=True,
)
LINUX = System(
    platform="linux-x64",
    wheel_platforms=(
        "manylinux_2_28_x86_64",
        "manylinux_2_27_x86_64",
        "manylinux_2_24_x86_64",
        "manylinux_2_17_x86_64",
        "manylinux2014_x86_64",
        "manylinux_2_12_x86_64",
        "manylinux2010_x86_64",
        "manylinux_2_5_x86_64",
        "manylinux1_x86_64",
        "linux_x86_64",
    ),
    markers={
        "os_name": "posix",
        "sys_platform": "linux",
        "platform_system": "Linux",
        "platform_machine": "x86_64",
    },
    folder="/home/{user}/.config/blender/{blender}/extensions/.local/lib/python{python}/site-packages",
    most_path=4095,
    ignores_case=False,
)
SYSTEMS = (WINDOWS, MACOS, LINUX)
TARGETS = tuple(
    Target(system, python, blender, numpy)
    for python, blender, numpy in (
        ("3.11", ("4.2.0", "5.1.0"), ("1.24.3", "1.26.4")),
        ("3.13", ("5.1.0", None), ("2.2.0", "2.5.99")),
    )
    for system in SYSTEMS
)

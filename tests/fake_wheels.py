"""Tiny wheels for tests of what installs packages: a module each, made in milliseconds."""

import base64
import hashlib
import zipfile


def fake_wheel(folder, name, version="1.0", tag="py3-none-any", needs=(), files=None, licence="MIT"):
    """Write a wheel of a package whose module says its version; returns the path.

    `needs` are its requirements, `files` more of its files (or others in place of its own ones).
    """
    module = name.replace("-", "_")
    info = f"{module}-{version}.dist-info"
    metadata = f"Metadata-Version: 2.4\nName: {name}\nVersion: {version}\nLicense-Expression: {licence}\n"
    content = {
        f"{module}/__init__.py": f"version = {version!r}\n",
        f"{info}/METADATA": metadata + "".join(f"Requires-Dist: {one}\n" for one in needs),
        f"{info}/WHEEL": f"Wheel-Version: 1.0\nGenerator: test\nRoot-Is-Purelib: {tag.endswith('any')}\nTag: {tag}\n",
        f"{info}/licenses/LICENSE": f"The licence of {name}.\n",
    } | (files or {})
    rows = [f"{path},sha256={digest(text)},{len(text.encode())}" for path, text in content.items()]
    content[f"{info}/RECORD"] = "\n".join([*rows, f"{info}/RECORD,,"]) + "\n"
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{module}-{version}-{tag}.whl"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        for member, text in content.items():
            archive.writestr(member, text)
    return path


def digest(text):
    return base64.urlsafe_b64encode(hashlib.sha256(text.encode()).digest()).rstrip(b"=").decode()

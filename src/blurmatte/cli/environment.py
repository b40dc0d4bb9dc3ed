"""What blurmatte runs on: versions, platform, extras, and where compiled kernels are kept."""

from __future__ import annotations

import os
import platform
import re
from collections.abc import Iterable
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Any

import blurmatte as bm
from blurmatte.compiling import kernel_folder

_ALL, _DEVELOPERS = "all", "dev"  # extras that repeat others, and of developers
_SUFFIXES = "*.nbi", "*.nbc"  # of numba's files


def environment() -> tuple[Iterable[str], dict[str, Any]]:
    """Lines for people, and the same as values."""
    libraries, extras = _required()
    folder = kernel_folder()
    kept = [] if folder is None else [p for end in _SUFFIXES for p in folder.rglob(end)]
    numbers = {
        "blurmatte": bm.__version__,
        "python": f"{platform.python_implementation()} {platform.python_version()}",
        "platform": platform.platform(),
        "machine": platform.machine(),
        "cores": os.cpu_count(),
        "libraries": libraries,
        "extras": extras,
        "kernels": {"folder": folder, "bytes": sum(path.stat().st_size for path in kept)},
    }
    return _lines(numbers), numbers


def _lines(numbers: dict[str, Any]) -> Iterable[str]:
    """The same in lines."""
    yield f"blurmatte {numbers['blurmatte']}"
    yield f"{numbers['python']}, {numbers['cores']} cores, {numbers['platform']}"
    yield _named(numbers["libraries"])
    extras = numbers["extras"].items()
    present = {name: packages for name, packages in extras if None not in packages.values()}
    for name, packages in present.items():
        yield f"extra {name}: {_named(packages)}"
    missing = ", ".join(name for name, _ in extras if name not in present)
    yield f"extras that are not installed: {missing or 'none'}"
    kernels = numbers["kernels"]
    if kernels["folder"] is None:
        yield "compiled kernels: kept nowhere; NUMBA_CACHE_DIR names a folder"
    else:
        yield f"compiled kernels: {kernels['bytes'] / 1e6:.1f} MB below {kernels['folder']}"


def _named(versions: dict[str, str | None]) -> str:
    """Packages with their versions."""
    return ", ".join(f"{name} {found or 'missing'}" for name, found in versions.items())


def _required() -> tuple[dict[str, str | None], dict[str, dict[str, str | None]]]:
    """Versions of the libraries that every command needs, and of those of each extra.

    Empty if blurmatte runs from its source without being installed.
    """
    libraries: dict[str, str | None] = {}
    extras: dict[str, dict[str, str | None]] = {}
    try:
        lines = requires("blurmatte") or ()
    except PackageNotFoundError:
        return libraries, extras
    for line in lines:
        name = re.split(r"[^\w.-]", line, maxsplit=1)[0]
        extra = re.search(r"extra == ['\"]([\w-]+)['\"]", line)
        if extra is None:
            libraries[name] = _version(name)
        elif extra[1] not in (_ALL, _DEVELOPERS):
            extras.setdefault(extra[1], {})[name] = _version(name)
    return libraries, extras


def _version(name: str) -> str | None:
    """The version of an installed package; None if it is missing."""
    try:
        return version(name)
    except PackageNotFoundError:
        return None

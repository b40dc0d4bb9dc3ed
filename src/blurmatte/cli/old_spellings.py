"""Command lines of version 0.1, in the spelling of today. To be deleted in the next version."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from blurmatte.formats import is_clip

Args = list[str]
_ROW_MARKS = "#*?[%"
_IN_SPACE = "--camera", "--on-plane", "--speed", "--height", "--plate"
_NOT_IN_SPACE = "--scale", "--points", "--line-time", "--going", "--overlay"
_OVER = "--over", "--fit", "--place", "--scale", "--match-light"
_SWITCHES = (
    *("--json", "--several", "--resume", "--rotation", "--remove", "--long", "--all", "--list"),
    *("--help", "-h", "--quiet", "-q", "--verbose", "-v"),
)


def modern(args: Sequence[str]) -> tuple[Args, bool]:
    """The arguments in today's spelling, and whether that differs."""
    if not args or args[0] not in _RULES:
        return list(args), False
    command, *rest = args
    new = _RULES[command](command, rest)
    return new, new != list(args)


def _solve(command: str, args: Args) -> Args:
    for old, name, form in (
        ("--mask", "--region", "{}"),
        ("--smoothness", "--solver", "smooth:{}"),
        ("--shaded-plate", "--solver", "shaded:{}"),
    ):
        if (value := _take(args, old)) is not None:
            _take(args, name)
            args += [name, form.format(value)]
    return [command, *args]


def _measure(command: str, args: Args) -> Args:
    points = _take(args, "--points")
    if points is not None:
        place, _, length = points.rpartition(",")
        args += ["--scale", f"{place}={length}"]
    source = _first_argument(args)
    if source is None:
        return [command, *args]
    path = Path(source)
    is_row = any(mark in path.name for mark in _ROW_MARKS) and not path.is_file()
    if is_row or (is_clip(path) and not (path / "layer.exr").is_file()):
        return _track("track", _with_frames(args))
    if not any(_has(args, name) for name in _IN_SPACE):
        return [command, *args]
    for name in _NOT_IN_SPACE:
        _take(args, name)
    return ["locate", *(arg for arg in args if arg != "--rotation")]


def _track(command: str, args: Args) -> Args:
    return [command, *(arg for arg in args if arg != "--resume")]


def _edit(command: str, args: Args) -> Args:
    if "--remove" in args:
        return ["remove", *(arg for arg in args if arg != "--remove")]
    start = _take(args, "--start")
    if start is not None:
        args += ["--first", start]
    if any(_has(args, name) for name in _OVER):
        if not _has(args, "--image"):
            return ["compose", *args]
    elif _has(args, "--plate") and not _has(args, "--image"):
        plate = _take(args, "--plate")
        return ["compose", *args, "--over", str(plate)]
    return [command, *args]


def _with_frames(args: Args) -> Args:
    """--start, --stop and --step as --frames."""
    start, stop, step = (_take(args, f"--{name}") for name in ("start", "stop", "step"))
    if (start, stop, step) == (None, None, None):
        return args
    return [*args, "--frames", ":".join([start or "", stop or "", *([step] if step else [])])]


_RULES: dict[str, Callable[[str, Args], Args]] = {
    "solve": _solve,
    "color": _solve,
    "measure": _measure,
    "track": _track,
    "edit": _edit,
    "plate": lambda command, args: [command, *_with_frames(args)],
}


def _has(args: Args, name: str) -> bool:
    return any(arg == name or arg.startswith(f"{name}=") for arg in args)


def _take(args: Args, name: str) -> str | None:
    """Remove an option and its value from the arguments; the last value if there are several."""
    value = None
    while _has(args, name):
        k = next(k for k, arg in enumerate(args) if arg == name or arg.startswith(f"{name}="))
        if "=" in args[k]:
            value = args.pop(k).partition("=")[2]
        elif k + 1 < len(args):
            value = args.pop(k + 1)
            del args[k]
        else:
            return None  # a value is missing, and parsing will say so
    return value


def _first_argument(args: Args) -> str | None:
    """The first word that is neither an option nor its value."""
    after_option = False
    for arg in args:
        if arg.startswith("-") and len(arg) > 1:
            after_option = "=" not in arg and arg not in _SWITCHES
        elif after_option:
            after_option = False
        else:
            return arg
    return None

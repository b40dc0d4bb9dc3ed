"""Scene files: TOML → Shot.

Each table of a scene file is a call: `kind` names the function, every other key is an argument.
Colors are linear [r, g, b] or sRGB-coded "#rrggbb"; lengths are pixels, angles degrees.
"""

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from blurmatte.errors import FileError
from blurmatte.files.documents import parse_toml, read_document
from blurmatte.files.reading import read, read_layer
from blurmatte.radiometry import NoiseModel, named_transfer
from blurmatte.radiometry.transfer import is_hex, light_of_hex
from blurmatte.rendering import Ball, Camera, Scene, Shot, colorful_plate
from blurmatte.rendering.flat_bodies import Cube, Sheet, Sprite, star_sprite
from blurmatte.rendering.lighting import Lamp
from blurmatte.rendering.plates import (
    photo_plate,
    plain_plate,
    striped_plate,
    textured_plate,
    two_hue_plate,
    wire_fence,
)
from blurmatte.rendering.pose import Change, Pinhole, path_in_depth
from blurmatte.rendering.processing import Processing
from blurmatte.rendering.scene import Nearby, Shadow
from blurmatte.rendering.shot import Drift
from blurmatte.trajectory import Trajectory

MAX_RENDERED_PIXELS = 25_000_000  # a renderer holds some 400 bytes for each
MAX_COUNT = 10_000  # frames of a clip, pictures of a plate, points of a path
MAX_BLUR = 200  # pixels, of lens, defocus and shadows

Table = Mapping[str, Any]
Makers = Mapping[str, Callable[..., Any]]

_NAMED = Path(__file__).parent / "named"
_ANGLES = ("rotation", "angle", "squash_angle", "turned", "spin")
_SCENE_KEYS = ("opacity", "defocus", "shutter_ramp", "pixel_filter")
_SHOT_KEYS = ("plate_frames", "seed", "crf")
_TABLES = (
    *("plate", "body", "path", "change", "shadow", "nearby", "pinhole", "occluder"),
    *("camera", "processing", "drift", "clip"),
)


def scene_names() -> list[str]:
    """Names of the built-in scenes, for `read_shots`.

    Examples
    --------
    >>> bm.scenes.scene_names()[:3]
    ['approaching', 'astronaut', 'bounce']
    """
    return sorted(path.stem for path in _NAMED.glob("*.toml"))


def scene_title(scene: str | Path) -> str:
    """Title of a scene file; empty if it has none.

    Raises
    ------
    FileError
        If the file does not exist or is not TOML.

    Examples
    --------
    >>> bm.scenes.scene_title("easy")
    'An orange ball, colorful tiles, five frames of the plate: the easy case'
    """
    try:
        return str(parse_toml(scene_text(scene)).get("title", ""))
    except ValueError as error:
        raise FileError(f"{scene}: {error}") from error


def scene_text(scene: str | Path) -> str:
    """Text of a scene file, by its path or the name of a built-in scene.

    Raises
    ------
    FileError
        If the file does not exist.

    Examples
    --------
    >>> print(bm.scenes.scene_text("easy").splitlines()[0])
    title = "An orange ball, colorful tiles, five frames of the plate: the easy case"
    """
    named = _NAMED / f"{scene}.toml"
    path = named if str(scene) in scene_names() else Path(scene)
    try:
        return read_document(path, "give a scene file")
    except FileError as error:
        raise FileError(f"{error}; the built-in scenes are {', '.join(scene_names())}") from error


def scene_files(scene: str | Path) -> list[Path]:
    """The scene file, and the pictures that it names, of which some may not exist.

    Raises FileError if the file does not exist.
    """
    found, tables = [Path(scene)], [parse_toml(scene_text(scene))]
    for table in tables:  # grows
        tables += [value for value in table.values() if isinstance(value, dict)]
        if isinstance(table.get("file"), str):
            found.append(Path(scene).parent / table["file"])
    return found


def read_shots(scene: str | Path, max_pixels: int = MAX_RENDERED_PIXELS) -> list[Shot]:
    """The shots of a scene file: one, or one for each frame of its clip.

    Parameters
    ----------
    scene : str or Path
        A TOML file, or the name of a built-in scene (`scene_names`).
    max_pixels : int
        Larger scenes are rejected before memory is allocated.

    Returns
    -------
    list of Shot
        Frames of a clip in order, each with a different seed.

    Raises
    ------
    FileError
        If the file does not exist or is wrong; the message names the table and key.

    Examples
    --------
    >>> shot, *others = bm.scenes.read_shots("easy")
    >>> shot.scene.size
    (512, 384)
    """
    text = scene_text(scene)
    try:
        return _shots(parse_toml(text), Path(scene).parent, max_pixels)
    except (ValueError, TypeError) as error:
        raise FileError(f"{scene}: {error}") from error


def _shots(file: Table, folder: Path, max_pixels: int) -> list[Shot]:
    known = ("title", "size", *_SHOT_KEYS, *_SCENE_KEYS, *_TABLES)
    for name in file:
        if name not in known:
            raise ValueError(f"there is no {name!r} in a scene; it takes {', '.join(known)}")
    size, seed = _size(file, max_pixels), file.get("seed", 0)
    for name in (*_SCENE_KEYS, "plate_frames"):
        _check_range(name, file.get(name))
    plates, occluders = _plates(size, seed, folder), {"wire_fence": partial(wire_fence, size=size)}
    body = dict(_table(file, "body"))
    if isinstance(body.get("texture"), dict):
        body["texture"] = _made("body.texture", body["texture"], _plates((256, 128), seed, folder))
    scene = Scene(
        _made("plate", _table(file, "plate"), plates),
        _made("path", _table(file, "path"), _PATHS),
        _made("body", body, _bodies(folder)),
        change=_plain("change", file, Change),
        shadow=_optional("shadow", file, Shadow),
        nearby=_optional("nearby", file, Nearby),
        pinhole=_optional("pinhole", file, Pinhole),
        occluder=_made("occluder", file["occluder"], occluders) if "occluder" in file else None,
        **{key: file[key] for key in _SCENE_KEYS if key in file},
    )
    shot = Shot(
        scene,
        replace(_plain("camera", file, _camera), processing=_plain("processing", file, Processing)),
        _plain("drift", file, Drift),
        **{key: file[key] for key in _SHOT_KEYS if key in file},
    )
    return _plain("clip", file, partial(_frames, shot)) if "clip" in file else [shot]


def _frames(shot: Shot, count: int, duty: float) -> list[Shot]:
    parts = enumerate(shot.scene.exposures(count, duty))
    return [replace(shot, scene=part, seed=shot.seed + n) for n, part in parts]


def _size(file: Table, max_pixels: int) -> tuple[int, int]:
    size = file.get("size")
    if not (isinstance(size, list) and len(size) == 2 and all(type(s) is int for s in size)):
        raise ValueError(f"size must be [width, height] in whole pixels, got {size}")
    if min(size) < 1:
        raise ValueError(f"size must be 1 or more, got {size}")
    if size[0] * size[1] > max_pixels:
        raise ValueError(
            f"size must be at most {max_pixels} pixels, got {size[0]} x {size[1]}; raise the limit "
            "with max_pixels= (--max-pixels) if that is right"
        )
    return size[0], size[1]


def _plates(size: tuple[int, int], seed: int, folder: Path) -> Makers:
    def picture(file: str) -> Any:
        """(H, W, 3) light of a file."""
        return read(folder / file).rgb.astype(float)

    return {
        "plain": partial(plain_plate, size=size, rng=seed),
        "two_hue": partial(two_hue_plate, size=size, rng=seed),
        "colorful": partial(colorful_plate, size=size, rng=seed),
        "textured": partial(textured_plate, size=size, rng=seed),
        "striped": partial(striped_plate, size=size),
        "photo": partial(photo_plate, size=size),
        "file": picture,
    }


def _bodies(folder: Path) -> Makers:
    def sprite(file: str) -> Sprite:
        """The sprite of a layer file."""
        return Sprite(read_layer(folder / file))

    return {"ball": Ball, "sheet": Sheet, "cube": Cube, "star": star_sprite, "sprite": sprite}


def _camera(
    gain: float = 0.0,
    read_std: float = 0.0,
    code_std: float = 0.0,
    bits: int | str = 8,
    transfer: str = "srgb",
    jpeg_quality: int | None = None,
    chroma: str = "4:4:4",
    bayer: bool = False,
    blur: float = 0.0,
    defocus: float = 0.0,
) -> Camera:
    return Camera(
        NoiseModel(gain, read_std),
        code_std=code_std,
        bits=None if bits == "float" else bits,  # type: ignore[arg-type]  # Camera checks it
        transfer=named_transfer(transfer),
        jpeg_quality=jpeg_quality,
        chroma=chroma,
        bayer=bayer,
        blur=blur,
        defocus=defocus,
    )


_PATHS: Makers = {
    "line": Trajectory.line,
    "arc": Trajectory.arc,
    "parabola": Trajectory.parabola,
    "bounce": Trajectory.bounce,
    "from_rest": Trajectory.from_rest,
    "in_depth": path_in_depth,
    "points": Trajectory,
}


def _table(file: Table, name: str) -> Table:
    if not isinstance(file.get(name), dict):
        raise ValueError(f"needs a table [{name}]")
    table: Table = file[name]
    return table


def _made(name: str, table: Table, makers: Makers) -> Any:
    kind = str(table.get("kind"))
    if kind not in makers:
        raise ValueError(f"[{name}] kind must be one of {', '.join(makers)}, got {kind!r}")
    return _called(name, makers[kind], {k: v for k, v in table.items() if k != "kind"})


def _plain(name: str, file: Table, maker: Callable[..., Any]) -> Any:
    """Call `maker` with an optional table that has no `kind`."""
    return _called(name, maker, _table({name: {}} | dict(file), name))


def _optional(name: str, file: Table, maker: Callable[..., Any]) -> Any:
    """Like `_plain`, but None if the table is missing."""
    return _plain(name, file, maker) if name in file else None


def _called(name: str, maker: Callable[..., Any], table: Table) -> Any:
    takes = dict(inspect.signature(maker).parameters)
    for given in getattr(maker, "keywords", {}):  # of a partial
        del takes[given]
    for key in table:
        if key not in takes:
            raise ValueError(f"[{name}] has no {key!r}; it takes {', '.join(takes) or 'nothing'}")
    for key, parameter in takes.items():
        if parameter.default is parameter.empty and key not in table:
            raise ValueError(f"[{name}] needs {key!r}")
    values = {key: _value(f"{name}.{key}", takes[key], value) for key, value in table.items()}
    try:
        return maker(**values)
    except (ValueError, TypeError) as error:
        raise ValueError(f"[{name}] {error}") from error


def _check_range(name: str, value: Any) -> None:
    """ValueError for numbers that no picture needs, before anything is allocated for them."""
    limits = dict.fromkeys(("count", "points", "plate_frames"), MAX_COUNT)
    limits |= dict.fromkeys(("blur", "defocus", "softness"), MAX_BLUR)
    key = name.rpartition(".")[2]
    most = limits.get(key, math.inf)
    for number in value if isinstance(value, list) else [value]:
        if isinstance(number, list):
            _check_range(name, number)
        elif isinstance(number, int | float) and not abs(number) <= most:
            raise ValueError(f"{name} must be at most {most:g}, got {number!r:.20}")
    if key in ("tile", "spacing") and isinstance(value, int | float) and value < 1:
        raise ValueError(f"{name} must be 1 pixel or more, got {value:g}")


def _value(name: str, parameter: inspect.Parameter, value: Any) -> Any:
    _check_range(name, value)
    angle = parameter.name in _ANGLES
    match value:
        case str() if value.startswith("#"):
            return _light(name, value)
        case str() if "str" not in str(parameter.annotation):
            raise ValueError(f"{name} must be numbers or a color like #d8ff3c, got {value!r}")
        case [str(), *_]:
            return [_light(name, color) for color in value]
        case [dict(), *_] if parameter.name == "lamps":
            return tuple(_called(name, Lamp, lamp) for lamp in value)
        case [int() | float(), *_]:
            return tuple(np.radians(value).tolist() if angle else value)
        case int() | float() if angle:
            return float(np.radians(value))
    return value


def _light(name: str, color: Any) -> Any:
    """Linear light of a hex color."""
    if not (isinstance(color, str) and is_hex(color)):
        raise ValueError(f"{name} must be a color like #d8ff3c, got {color!r}")
    return light_of_hex(color)[0]

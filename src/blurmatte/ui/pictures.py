"""Pictures for the page: as tiles of linear light, and as numbers."""

import io
import warnings
from collections import OrderedDict
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from PIL import Image

import blurmatte as bm
from blurmatte.background.guess import guess_behind
from blurmatte.checks import Bools, Floats, strips
from blurmatte.files.documents import plain
from blurmatte.formats import EXR, is_clip, named
from blurmatte.radiometry.transfer import hex_of_light
from blurmatte.statistics import cell_means

T = TypeVar("T")

TILE = 512  # pixels, a side of a tile
_CACHE_BYTES = 1 << 30  # of pictures in memory
_FRAMES_PASSED = 8  # of a clip that is played, before seeking is quicker
_MAX_LEVEL = 16
_MAX_RADIUS = 512  # pixels, of an eyedropper
_MAX_STOPS = 64.0
_MAX_HALF = float(np.finfo(np.float16).max)


@dataclass(frozen=True)
class _ShownPart:
    """What is shown of a file: picture, layer or error; or what a picture hides, by another file.

    Of the latter, "matched" is a plate as it would have been at the moment of the picture, and
    "guessed" the scene behind a layer of the picture.
    """

    path: Path
    name: str
    frame: int = 0
    basis: Path | None = None

    @property
    def key(self) -> tuple[Any, ...]:
        """Of the files as they are now."""
        other = () if self.basis is None else _identity(self.basis)
        return (*_identity(self.path), self.name, self.frame, *other)


@dataclass
class _Played:
    """A clip whose frames are decoded one after the other."""

    of: tuple[Any, ...]  # the file
    next: int  # number of the frame that comes
    frames: Iterator[Any]


class ShownPictures:
    """Pictures in memory, of so many bytes, and what is asked of them."""

    def __init__(self, max_bytes: int = _CACHE_BYTES) -> None:
        self._max_bytes = max_bytes
        self._cache: OrderedDict[Any, tuple[Any, int]] = OrderedDict()
        self._played: _Played | None = None
        self._questions: dict[str, Callable[..., bytes | dict[str, Any]]] = {
            "describe": self.describe,
            "tile": self.tile,
            "preview": self.preview,
            "pixels": self.pixels,
        }

    def answer(self, name: str, values: dict[str, Any]) -> tuple[bytes, dict[str, Any], str]:
        """Bytes, numbers, or why there is no answer to a question, without private folders."""
        try:
            with warnings.catch_warnings(action="ignore"):  # the commands say them
                found = self._questions[name](**values)
        except (bm.BlurmatteError, ValueError, OSError, MemoryError) as error:
            why = " ".join(str(error).split()) or repr(error)
            for path in (one for one in values.values() if isinstance(one, Path)):
                why = why.replace(str(path), path.name)
            return b"", {}, why
        except Exception as error:
            why = f"a defect of blurmatte, {type(error).__name__}: {error}; please report it"
            return b"", {}, why
        return (found, {}, "") if isinstance(found, bytes) else (b"", plain(found), "")

    def _kept(self, key: Any, make: Callable[[], T], size: Callable[[T], int]) -> T:
        """A thing that is made once, and dropped when memory is needed for others."""
        if key not in self._cache:
            made = make()
            self._cache[key] = made, size(made)
        self._cache.move_to_end(key)
        while len(self._cache) > 1 and sum(n for _, n in self._cache.values()) > self._max_bytes:
            self._cache.popitem(last=False)
        kept: T = self._cache[key][0]
        return kept

    def describe(self, path: Path) -> dict[str, Any]:
        """Kind, size and times of a file."""
        frames = self._frames(path)
        if frames is not None:
            width, height = frames.size
            size = {"kind": "clip", "width": width, "height": height}
            return {**size, "frames": len(frames), "rate": frames.rate}
        picture = self._picture(path, 0)
        meta = picture.meta
        width, height = picture.size
        solution, layer = self._solution(path), self._layer_if_any(path)
        return {
            "kind": "solution" if solution else "layer" if layer else "picture",
            "layer": None if layer is None else _of_layer(layer),
            "width": width,
            "height": height,
            "frames": 1,
            "exposure_seconds": meta.exposure_time,
            "camera": meta.camera,
            "time": meta.time,
            "gray": bool(bm.radiometry.image.are_gray(picture, picture)),
        }

    def tile(
        self,
        path: Path,
        part: str,
        frame: int,
        level: int,
        x: int,
        y: int,
        basis: Path | None = None,
    ) -> bytes:
        """Half floats, RGBA, of a tile of the picture at a power of two."""
        tile = self._tile(_ShownPart(path, part, frame, basis), level, x, y)
        return np.clip(tile, -_MAX_HALF, _MAX_HALF).astype("<f2").tobytes()

    def preview(self, path: Path, part: str, frame: int, side: int, stops: float) -> bytes:
        """A PNG of 8 bits, at most so many pixels wide and high."""
        if side < 1:
            raise ValueError(f"side must be at least 1, got {side}")
        shown = _ShownPart(path, part, frame)
        level, (height, width) = 0, self._whole(shown)[1].shape
        while max(height, width) > side:
            level, height, width = level + 1, (height + 1) // 2, (width + 1) // 2
        return _png(self._level(shown, level), part, stops)

    def _tile(self, part: _ShownPart, level: int, x: int, y: int) -> Floats:
        """(h, w, 4) float32 pixels of a tile."""
        if not 0 <= level <= _MAX_LEVEL:
            raise ValueError(f"level must be 0 to {_MAX_LEVEL}, got {level}")
        place = slice(y * TILE, (y + 1) * TILE), slice(x * TILE, (x + 1) * TILE)
        if level == 0:
            light, alpha = self._whole(part)
            tile = _joined(light[place], alpha[place])
        else:
            tile = self._level(part, level)[place]
        if tile.size == 0:
            raise ValueError(f"there is no tile {x}, {y} at level {level}")
        return tile

    def pixels(self, path: Path, frame: int, x: int, y: int, radius: int) -> dict[str, Any]:
        """Mean of the valid light around a pixel, and alpha with its error if the file holds them."""
        picture = self._picture(path, frame)
        width, height = picture.size
        if not (0 <= x < width and 0 <= y < height):
            raise ValueError(f"pixel {x}, {y} is outside the picture of {width}x{height}")
        if not 0 <= radius <= _MAX_RADIUS:
            raise ValueError(f"radius must be 0 to {_MAX_RADIUS}, got {radius}")
        rows = slice(max(y - radius, 0), y + radius + 1)
        columns = slice(max(x - radius, 0), x + radius + 1)
        valid = picture.valid[rows, columns]
        counted = valid if valid.any() else np.ones_like(valid)  # all, rather than nothing
        light = picture.rgb[rows, columns][counted].astype(float)
        mean = light.mean(axis=0)
        numbers: dict[str, Any] = {
            "x": x,
            "y": y,
            "count": int(valid.sum()),
            "light": mean.tolist(),
            "scatter": light.std(axis=0).tolist(),
            "hex": hex_of_light(np.clip(mean, 0, 1)),
        }
        solution, layer = self._solution(path), self._layer_if_any(path)
        if solution is None and layer is not None:
            numbers["alpha"] = float(layer.alpha[y, x])
        if solution is not None:
            flags = bm.matting.Quality(int(solution.quality[y, x]))
            numbers |= {
                "alpha": float(solution.alpha[y, x]),
                "alpha_std": float(solution.alpha_std[y, x]),
                "flags": [str(flag.name).lower() for flag in flags],
            }
        return numbers

    def _level(self, part: _ShownPart, level: int) -> Floats:
        """(h, w, 4) float32 pixels at a level; each is the mean of 2×2 of the level before."""

        def make() -> Floats:
            if level > 1:
                return _halved(self._level(part, level - 1), part.name)
            light, alpha = self._whole(part)
            parts = (_joined(light[rows], alpha[rows]) for rows in strips(len(alpha)))
            return np.concatenate([_halved(one, part.name) for one in parts])

        if level == 0:  # as large as the picture, which is kept
            return _joined(*self._whole(part))
        return self._kept((*part.key, level), make, lambda made: int(made.nbytes))

    def _whole(self, part: _ShownPart) -> tuple[Floats, Floats | Bools]:
        """(H, W, 3) light and (H, W) what goes with it: validity, alpha, or 1 with error and flags."""
        path, name = part.path, part.name
        if part.basis is not None and name in ("matched", "guessed"):
            behind = self._kept(part.key, lambda: self._behind(part), _bytes_of)
            return behind.rgb, behind.valid
        if name == "picture":
            picture = self._picture(path, part.frame)
            return picture.rgb, picture.valid
        if name == "layer":
            layer = self._layer(path)
            return layer.premultiplied, layer.alpha
        if name == "error":
            solution = self._solution(path)
            if solution is None:
                raise ValueError(f"{path.name} holds no errors; choose the layer.exr of solve")
            std = np.nan_to_num(solution.alpha_std, posinf=_MAX_HALF).astype(np.float32)
            std = np.where(solution.streak, std, np.float32(0))
            flags = solution.quality.astype(np.float32)
            return np.dstack([std, flags, np.zeros_like(std)]), np.ones(std.shape, bool)
        raise ValueError(f"part must be picture, layer or error, got {name!r}")

    def _behind(self, part: _ShownPart) -> bm.LinearImage:
        """The scene behind the object of a picture, as `edit` takes it."""
        assert part.basis is not None
        image = bm.read(part.path)
        if part.name == "matched":
            return bm.match_plate(bm.read(part.basis), image).in_srgb()
        solution = self._solution(part.basis)
        streak = self._layer(part.basis).alpha > 0 if solution is None else solution.streak
        return guess_behind(image, streak).plates[0].in_srgb()

    def _picture(self, path: Path, frame: int) -> bm.LinearImage:
        """A picture, or a frame of a clip by its number."""
        frames = self._frames(path)
        if frames is None:
            return self._kept(
                (*_identity(path), "read"), lambda: bm.read(path).in_srgb(), _bytes_of
            )
        if not 0 <= frame < len(frames):
            raise ValueError(f"there is no frame {frame}; the clip has {len(frames)}")
        clip = _identity(path)
        key = *clip, "read", frame
        return self._kept(key, lambda: self._decoded(frames, clip, frame), _bytes_of)

    def _decoded(
        self, frames: bm.Frames[Any], clip: tuple[Any, ...], number: int
    ) -> bm.LinearImage:
        """A frame of a clip; those after it come without seeking."""
        played, self._played = self._played, None
        if played is None or played.of != clip or not 0 <= number - played.next <= _FRAMES_PASSED:
            played = _Played(clip, number, frames.load(range(number, len(frames))))
        for one in played.frames:
            played.next += 1
            if played.next == number + 1:
                self._played = played
                shown: bm.LinearImage = one.in_srgb()
                return shown
        raise ValueError(f"there is no frame {number}: the clip ends with frame {played.next - 1}")

    def _frames(self, path: Path) -> bm.Frames[Any] | None:
        """The frames of a clip; None of a picture."""
        if not is_clip(path):
            return None
        return self._kept((*_identity(path), "frames"), lambda: bm.read_frames(path), lambda _: 0)

    def _layer(self, path: Path) -> bm.Layer:
        key = *_identity(path), "layer"
        return self._kept(key, lambda: bm.read_layer(path), lambda x: 4 * int(x.alpha.nbytes))

    def _layer_if_any(self, path: Path) -> bm.Layer | None:
        """The layer in an EXR; None if it has no alpha, or is another file."""
        try:
            return self._layer(path) if named(path) is EXR else None
        except bm.BlurmatteError:
            return None

    def _solution(self, path: Path) -> bm.Solution | None:
        """A solution; None if the file is something else."""

        def make() -> bm.Solution | None:
            try:
                return bm.read_solution(path)
            except bm.BlurmatteError:
                return None

        if named(path) is not EXR:
            return None
        return self._kept(
            (*_identity(path), "solution"), make, lambda s: 0 if s is None else 8 * s.alpha.nbytes
        )


def _of_layer(layer: bm.Layer) -> dict[str, Any] | None:
    """What changes of a layer depend on: its box, mean color, and 99 % quantile of brightness."""
    if layer.empty:
        return None
    return {
        "box": list(layer.box),
        "color": layer.color.tolist(),
        "brightest": layer.brightest,
        "peak": float(layer.alpha.max()),
    }


def _bytes_of(picture: bm.LinearImage) -> int:
    return int(picture.rgb.nbytes)


def _identity(path: Path) -> tuple[Any, ...]:
    """A file as it is now."""
    found = path.stat()
    return str(path), found.st_mtime_ns, found.st_size


def _joined(light: Floats, alpha: Floats | Bools) -> Floats:
    """(h, w, 4) float32 of light and what goes with it."""
    joined = np.empty((*alpha.shape, 4), np.float32)
    joined[..., :3], joined[..., 3] = light, alpha
    return joined


def _halved(pixels: Floats, part: str) -> Floats:
    """The mean of each 2×2 pixels; of the last row and column those that there are.

    Of errors the second channel holds flags: all that one of the pixels has.
    """
    height, width = pixels.shape[:2]
    if height % 2 or width % 2:
        pixels = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    halved = cell_means(pixels, 2)
    if part == "error":
        flags = pixels[..., 1].astype(np.uint16)
        either = flags[0::2] | flags[1::2]
        halved[..., 1] = either[:, 0::2] | either[:, 1::2]
    return halved


def _png(pixels: Floats, part: str, stops: float) -> bytes:
    """A PNG of 8 bits in sRGB, brighter by stops; a layer with straight alpha."""
    if not abs(stops) <= _MAX_STOPS:
        raise ValueError(f"stops must be -{_MAX_STOPS:g} to {_MAX_STOPS:g}, got {stops}")
    light, alpha = pixels[..., :3], np.clip(pixels[..., 3:], 0, 1)
    if part == "layer":
        light = np.divide(light, alpha, out=np.zeros_like(light), where=alpha > 0)
    codes = bm.SRGB.encode(np.clip(light * np.float32(2.0**stops), 0, 1))
    if part == "layer":
        codes = np.dstack([codes, alpha])
    file = io.BytesIO()
    Image.fromarray(np.round(255 * codes).astype(np.uint8)).save(file, "png")
    return file.getvalue()

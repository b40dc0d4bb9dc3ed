"""The viewer: a process that reads pictures for the page, as tiles of linear light and as numbers."""

from __future__ import annotations

import shutil
import time
import warnings
from collections import OrderedDict, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from blurmatte.ui.helper import end_group

if TYPE_CHECKING:
    import blurmatte as bm
    from blurmatte.checks import Floats

T = TypeVar("T")

TILE = 512  # pixels, a side of a tile
_CACHE_BYTES = 1 << 30  # of pictures in memory
_FRAMES_READ_AHEAD = 8  # of a clip, behind one that was asked for
_SECONDS_OF_KILLED = 0.3  # in which the other processes of a server that was killed end


@dataclass(frozen=True)
class Question:
    """What the server asks."""

    number: int
    name: str
    values: dict[str, Any]


@dataclass(frozen=True)
class Answer:
    """An answer: bytes, or numbers, or why there is none."""

    number: int
    data: bytes = b""
    numbers: dict[str, Any] = field(default_factory=dict)
    refusal: str = ""


def look(pipe: Connection, private: Path) -> None:
    """Answer questions until the server ends, and then delete its private folder."""
    warnings.simplefilter("ignore")  # the commands say them
    viewer = _Viewer()
    waiting: deque[Question] = deque()
    while True:
        while not waiting or wait([pipe], 0):
            try:
                message = pipe.recv()
            except (EOFError, OSError):
                time.sleep(_SECONDS_OF_KILLED)
                shutil.rmtree(private, ignore_errors=True)
                end_group()
            if isinstance(message, Question):
                waiting.append(message)
            else:
                waiting = deque(one for one in waiting if one.number != message)
        pipe.send(viewer.answer(waiting.popleft()))


class _Viewer:
    """Pictures in memory, and what is asked of them."""

    def __init__(self) -> None:
        self._cache: OrderedDict[Any, tuple[Any, int]] = OrderedDict()
        self._questions: dict[str, Callable[..., bytes | dict[str, Any]]] = {
            "describe": self.describe,
            "tile": self.tile,
            "preview": self.preview,
            "pixels": self.pixels,
        }

    def answer(self, question: Question) -> Answer:
        """The answer to a question; an error of the library is a refusal."""
        import blurmatte as bm

        try:
            found = self._questions[question.name](**question.values)
        except (bm.BlurmatteError, ValueError, OSError, MemoryError, IndexError) as error:
            return Answer(question.number, refusal=" ".join(str(error).split()) or repr(error))
        if isinstance(found, bytes):
            return Answer(question.number, found)
        return Answer(question.number, numbers=found)

    def _kept(self, key: Any, make: Callable[[], T], size: Callable[[T], int]) -> T:
        """A thing that is made once, and dropped when memory is needed for others."""
        if key not in self._cache:
            made = make()
            self._cache[key] = made, size(made)
        self._cache.move_to_end(key)
        while len(self._cache) > 1 and sum(n for _, n in self._cache.values()) > _CACHE_BYTES:
            self._cache.popitem(last=False)
        kept: T = self._cache[key][0]
        return kept

    def describe(self, path: Path) -> dict[str, Any]:
        """Kind, size and times of a file."""
        import blurmatte as bm

        frames = self._frames(path)
        if frames is not None:
            width, height = frames.size
            return {
                "kind": "clip",
                "width": width,
                "height": height,
                "frames": len(frames),
                "rate": frames.rate,
            }
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

    def tile(self, path: Path, part: str, frame: int, level: int, x: int, y: int) -> bytes:
        """Half floats, RGBA, of a tile of the picture at a power of two."""
        import numpy as np

        levels = self._levels(path, part, frame, level)
        tile = levels[y * TILE : (y + 1) * TILE, x * TILE : (x + 1) * TILE]
        if tile.size == 0:
            raise ValueError(f"there is no tile {x}, {y} at level {level}")
        most = float(np.finfo(np.float16).max)
        return np.clip(tile, -most, most).astype("<f2").tobytes()

    def preview(self, path: Path, part: str, frame: int, side: int, stops: float) -> bytes:
        """A PNG of 8 bits, at most so many pixels wide and high, for pages without shaders."""
        import io

        import numpy as np
        from PIL import Image

        import blurmatte as bm

        level, size = 0, max(self._levels(path, part, frame, 0).shape[:2])
        while size > side:
            level, size = level + 1, (size + 1) // 2
        pixels = self._levels(path, part, frame, level)
        light = np.clip(pixels[..., :3] * np.float32(2.0**stops), 0, 1)
        codes = np.round(255 * bm.SRGB.encode(light)).astype(np.uint8)
        alpha = np.round(255 * np.clip(pixels[..., 3:], 0, 1)).astype(np.uint8)
        shown = codes if part in ("picture", "error") else np.dstack([codes, alpha])
        file = io.BytesIO()
        Image.fromarray(shown).save(file, "png")
        return file.getvalue()

    def pixels(self, path: Path, frame: int, x: int, y: int, radius: int) -> dict[str, Any]:
        """Mean light around a pixel, and alpha with its error if the file holds them."""
        import numpy as np

        import blurmatte as bm

        picture = self._picture(path, frame)
        width, height = picture.size
        if not (0 <= x < width and 0 <= y < height):
            raise ValueError(f"pixel {x}, {y} is outside the picture of {width}x{height}")
        rows = slice(max(y - radius, 0), y + radius + 1)
        columns = slice(max(x - radius, 0), x + radius + 1)
        light = picture.rgb[rows, columns].reshape(-1, 3).astype(float)
        mean = light.mean(axis=0)
        numbers: dict[str, Any] = {
            "x": x,
            "y": y,
            "count": len(light),
            "light": mean.tolist(),
            "scatter": light.std(axis=0).tolist(),
        }
        shown = np.clip(bm.SRGB.encode(np.clip(mean, 0, 1)), 0, 1)
        numbers["hex"] = "#" + "".join(f"{round(255 * float(c)):02x}" for c in shown)
        solution, layer = self._solution(path), self._layer_if_any(path)
        if solution is None and layer is not None:
            numbers["alpha"] = float(layer.alpha[y, x])
        if solution is not None:
            numbers |= {
                "alpha": float(solution.alpha[y, x]),
                "alpha_std": float(solution.alpha_std[y, x]),
                "flags": [
                    str(flag.name).lower()
                    for flag in bm.Quality
                    if int(solution.quality[y, x]) & flag.value
                ],
            }
        return numbers

    def _levels(self, path: Path, part: str, frame: int, level: int) -> Floats:
        """(H, W, 4) float32 light of a part at a level; each level is the mean of 2×2 pixels."""
        if not 0 <= level <= 16:
            raise ValueError(f"level must be 0 to 16, got {level}")
        key = (*_identity(path), part, frame, level)

        def make() -> Floats:
            if level == 0:
                return self._pixels_of(path, part, frame)
            return _halved(self._levels(path, part, frame, level - 1))

        return self._kept(key, make, lambda made: int(made.nbytes))

    def _pixels_of(self, path: Path, part: str, frame: int) -> Floats:
        """(H, W, 4) float32: light and validity, premultiplied light and alpha, or error and flags."""
        import numpy as np

        if part == "picture":
            picture = self._picture(path, frame)
            return np.dstack([picture.rgb, picture.valid]).astype(np.float32)
        if part == "layer":
            layer = self._layer(path)
            return np.dstack([layer.premultiplied, layer.alpha]).astype(np.float32)
        if part == "error":
            solution = self._solution(path)
            if solution is None:
                raise ValueError(f"{path.name} holds no errors; choose the layer.exr of solve")
            std = np.where(solution.streak, np.nan_to_num(solution.alpha_std), 0)
            one = np.ones_like(std)
            return np.dstack([std, solution.quality, one, one]).astype(np.float32)
        raise ValueError(f"part must be picture, layer or error, got {part!r}")

    def _picture(self, path: Path, frame: int) -> bm.LinearImage:
        """A picture, or a frame of a clip by its number."""
        frames = self._frames(path)
        if frames is None:
            return self._kept((*_identity(path), "read"), lambda: _read(path), _bytes_of)
        if not 0 <= frame < len(frames):
            raise ValueError(f"there is no frame {frame}; the clip has {len(frames)}")
        key = (*_identity(path), "read", frame)
        if key not in self._cache:
            ahead = range(frame, min(frame + _FRAMES_READ_AHEAD, len(frames)))
            for number, one in zip(ahead, frames.load(ahead), strict=False):
                self._kept((*key[:-1], number), one.in_srgb, _bytes_of)
        return self._kept(key, lambda: _frame(frames, frame), _bytes_of)

    def _frames(self, path: Path) -> bm.Frames[Any] | None:
        """The frames of a clip; None of a picture."""
        import blurmatte as bm
        from blurmatte.formats import is_clip

        if not is_clip(path):
            return None
        return self._kept((*_identity(path), "frames"), lambda: bm.read_frames(path), lambda _: 0)

    def _layer(self, path: Path) -> bm.Layer:
        import blurmatte as bm

        return self._kept(
            (*_identity(path), "layer"),
            lambda: bm.read_layer(path),
            lambda x: 4 * int(x.alpha.nbytes),
        )

    def _layer_if_any(self, path: Path) -> bm.Layer | None:
        """The layer in an EXR; None if it has no alpha, or is another file."""
        import blurmatte as bm

        try:
            return self._layer(path) if path.suffix.lower() == ".exr" else None
        except bm.BlurmatteError:
            return None

    def _solution(self, path: Path) -> bm.Solution | None:
        """A solution; None if the file is something else."""
        import blurmatte as bm

        def make() -> bm.Solution | None:
            try:
                return bm.read_solution(path)
            except bm.BlurmatteError:
                return None

        if path.suffix.lower() != ".exr":
            return None
        return self._kept(
            (*_identity(path), "solution"), make, lambda s: 0 if s is None else 8 * s.alpha.nbytes
        )


def _read(path: Path) -> bm.LinearImage:
    """A picture in linear sRGB, to look at."""
    import blurmatte as bm

    return bm.read(path).in_srgb()


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


def _frame(frames: bm.Frames[Any], number: int) -> bm.LinearImage:
    """One frame of a clip."""
    one: bm.LinearImage = frames[number]
    return one.in_srgb()


def _bytes_of(picture: bm.LinearImage) -> int:
    return int(picture.rgb.nbytes)


def _identity(path: Path) -> tuple[str, int]:
    """A file as it is now."""
    return str(path), path.stat().st_mtime_ns


def _halved(pixels: Floats) -> Floats:
    """The mean of each 2×2 pixels; of the last row and column those that there are."""
    import numpy as np

    height, width = pixels.shape[:2]
    padded = np.pad(pixels, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    rows = padded[0::2] + padded[1::2]
    return np.asarray((rows[:, 0::2] + rows[:, 1::2]) * np.float32(0.25))

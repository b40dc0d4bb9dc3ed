"""How long do edits take as whole processes, and how much memory do long sequences need?

Run: python -m benchmarks.speed.editing
"""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks.table import Cell, Table, publish_all

import blurmatte as bm
from blurmatte.rendering import colorful_plate

LARGE, QUICK_LARGE = (3840, 2160), (384, 216)
CLIP, FRAMES, QUICK_FRAMES = (640, 480), (24, 240), (2, 4)
ROUNDS = 3
NOISE = 1.0  # code values of 255
# Linux reports the peak memory of a process; that of `resource` may be the parent's there.
RUN = """
import sys
from pathlib import Path
from blurmatte.cli import app
app(sys.argv[1:], standalone_mode=False)
status = Path("/proc/self/status")
lines = status.read_text().splitlines() if status.exists() else []
print(*(line.split()[1] for line in lines if line.startswith("VmHWM")), file=sys.stderr)
"""


def scene(size: tuple[int, int]) -> bm.rendering.Rendering:
    """A ball's arc before tiles of all hues, in the middle of the picture."""
    width, height = size
    path = bm.Trajectory.arc(
        (0.25 * width, 0.7 * height), (0.5 * width, 0.4 * height), (0.78 * width, 0.33 * height)
    )
    ball = bm.rendering.Ball(0.05 * height, np.array([0.9, 0.45, 0.05]))
    return bm.rendering.render(
        bm.rendering.Scene(colorful_plate(size, 3, tile=height / 7), path, ball)
    )


def codes(light: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """8 bits with noise."""
    values = 255 * bm.SRGB.encode(light) + rng.normal(0, NOISE, light.shape)
    return np.clip(np.rint(values), 0, 255).astype(np.uint8)


def single(layer: bm.Layer) -> bm.Layer:
    """In the numbers that files hold."""
    return bm.Layer(layer.alpha.astype(np.float32), layer.premultiplied.astype(np.float32))


def measured(*arguments: object) -> tuple[float, float]:
    """Seconds and megabytes of one command as a process of its own."""
    command = [sys.executable, "-W", "ignore", "-c", RUN, *map(str, arguments)]
    start = time.perf_counter()
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    seconds = time.perf_counter() - start
    kilobytes = done.stderr.split()
    return seconds, float(kilobytes[-1]) / 1024 if kilobytes else float("nan")


def edits(folder: Path, size: tuple[int, int]) -> Iterator[tuple[str, list[object]]]:
    """Commands on one large picture, by what is edited."""
    rendering, rng = scene(size), np.random.default_rng(0)
    bm.write(folder / "layer.exr", single(rendering.layer))
    for ending in ("jpg", "png"):
        names = [folder / f"{name}.{ending}" for name in ("image", "plate")]
        for name, picture in zip(names, (rendering.image, rendering.plate), strict=True):
            bm.write(name, codes(picture.rgb, rng))
        own = ["--image", names[0], "--plate", names[1]]
        start = ["edit", folder / "layer.exr"]
        out = ["--out", folder / f"out.{ending}"]
        yield f"fade, {ending}", [*start, *own, "--fade", 2, *out]
        yield (
            f"fade, {ending}, plate as it is",
            [*start, *own, "--fade", 2, "--match", "none", *out],
        )
        yield f"over, {ending}", [*start, "--over", names[1], *out]


def rows_of_layers(folder: Path, count: int) -> list[object]:
    """The command that stacks so many layers."""
    layer = single(scene(CLIP).layer)
    target = folder / f"{count}.####.exr"
    bm.write_frames(target, (layer.fade(0.5 + n / (2 * count)) for n in range(count)))
    return ["stack", target, "--out", folder / "stack.exr"]


def tables(quick: bool = False) -> list[Table]:
    size, counts = (QUICK_LARGE, QUICK_FRAMES) if quick else (LARGE, FRAMES)
    rows: list[tuple[Cell, ...]] = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        jobs = [(what, size, command) for what, command in edits(folder, size)]
        jobs += [(f"stack of {n}", CLIP, rows_of_layers(folder, n)) for n in counts]
        for what, of, command in jobs:
            runs = [measured(*command) for _ in range(1 if quick else ROUNDS)]
            least, most = min(run[0] for run in runs), max(run[1] for run in runs)
            rows.append((what, f"{of[0]}x{of[1]}", least, most))
    return [
        Table(
            "editing",
            "How long do edits take as whole processes?",
            f"8 bits with noise; the shortest of {ROUNDS} runs, each a process that reads, edits and "
            "writes. MB: peak memory of a process, if the system reports it. A stack holds one layer "
            "at a time.",
            ("edit", "size", "seconds", "MB"),
            rows,
        )
    ]


if __name__ == "__main__":
    publish_all(tables)

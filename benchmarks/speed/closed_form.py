"""How close is the closed form to the memory bandwidth?

Solves a 4K picture into reused outputs and divides, in one run, the time of each variant by

* that of the same loop without arithmetic: it reads the same arrays and writes the same outputs,
* that of two threads of `numpy.copyto` that move as many bytes. These bypass the cache when they
  write. A compiled loop cannot: each of its writes first reads the cache line.

Run: python -m benchmarks.speed.closed_form
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count

import numpy as np
from benchmarks.speed.timing import interleaved
from benchmarks.table import Table, publish_all
from numba import njit

from blurmatte.color.model import ColorModel
from blurmatte.matting.maps import PixelMaps, _strips
from blurmatte.matting.pixelwise import Pixelwise
from blurmatte.radiometry import SRGB, NoiseModel

HEIGHT, WIDTH, ROUNDS = 2160, 3840, 15
QUICK_HEIGHT, QUICK_WIDTH = 270, 480
PATCH = 30  # pixels: side of a patch of one color
LINE, PLANE = ColorModel.from_hex("#d8ff3c"), ColorModel.from_hex("#d8ff3c", "#2040ff")
NOISE = NoiseModel(gain=1e-4, read_std=1e-3)


def plain_numpy(C, B, model, noise):
    """The same weighted fit as anybody would write it, without the error of P."""
    n1, n2 = model.normals.T.astype(C.dtype)
    projector = (model.basis @ model.basis.T).astype(C.dtype)
    D = B - C
    b1, b2, d1, d2 = B @ n1, B @ n2, D @ n1, D @ n2
    plain = (b1 * d1 + b2 * d2) / (b1 * b1 + b2 * b2)
    through = 1 - np.clip(plain, 0, 1)[..., None]
    s = noise.variance(C) + through**2 * noise.variance(B)
    S11, S12, S22 = s @ (n1 * n1), s @ (n1 * n2), s @ (n2 * n2)
    w1, w2 = S22 * b1 - S12 * b2, S11 * b2 - S12 * b1
    A = w1 * b1 + w2 * b2
    alpha = (w1 * d1 + w2 * d2) / A
    P = C - (1 - alpha)[..., None] * B
    return (
        alpha,
        np.sqrt((S11 * S22 - S12 * S12) / A),
        P @ projector,
    )


@njit(nogil=True, fastmath=True)
def touch(C, B, alpha, alpha_std, P, P_std, quality):
    """Read and write what the closed form does, and compute nothing."""
    for i in range(alpha.shape[0]):
        x, y, z = C[3 * i] + B[3 * i], C[3 * i + 1] + B[3 * i + 1], C[3 * i + 2] + B[3 * i + 2]
        alpha[i], alpha_std[i] = x, y
        P[3 * i], P[3 * i + 1], P[3 * i + 2] = x, y, z
        P_std[3 * i], P_std[3 * i + 1], P_std[3 * i + 2] = z, y, x
        quality[i] |= 1


def in_threads(run: Callable[[slice], None], length: int) -> None:
    with ThreadPoolExecutor(cpu_count()) as threads:
        list(threads.map(run, _strips(length)))


def code_pictures(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Image and plate, (H, W, 3) uint8: smooth with noise, so that neighbors have similar codes."""
    rng = np.random.default_rng(0)
    patches = rng.uniform(30, 200, (height // PATCH, width // PATCH, 3))
    scene = patches.repeat(PATCH, 0).repeat(PATCH, 1)
    plate = np.clip(scene + rng.normal(0, 2, scene.shape), 1, 254).astype(np.uint8)
    image = np.clip(0.7 * scene + 40 + rng.normal(0, 2, scene.shape), 1, 254).astype(np.uint8)
    return image, plate


def copying(image: np.ndarray, plate: np.ndarray, maps: PixelMaps) -> dict[str, Callable]:
    """What moves as many bytes as the closed form and does nothing else."""
    alpha, std, P, P_std, quality = (m.reshape(-1) for m in maps)
    C, B = image.reshape(-1), plate.reshape(-1)

    def touch_strip(s: slice) -> None:
        t = slice(3 * s.start, 3 * s.stop)
        touch(C[t], B[t], alpha[s], std[s], P[t], P_std[t], quality[s])

    outputs = 2 * maps.quality.nbytes + sum(m.nbytes for m in maps)
    moved = (image.nbytes + plate.nbytes + outputs) // 2
    source, target = np.ones(moved, np.uint8), np.empty(moved, np.uint8)
    return {
        "no arithmetic": lambda: in_threads(touch_strip, alpha.size),
        "numpy.copyto": lambda: in_threads(lambda s: np.copyto(target[s], source[s]), moved),
    }


def solving(image_codes: np.ndarray, plate_codes: np.ndarray, maps: PixelMaps) -> dict:
    """The closed form for lines and planes, for light and for code values."""
    solver = Pixelwise()
    table, table16 = (SRGB.table(levels).astype(np.float32) for levels in (256, 65536))
    image, plate = table[image_codes], table[plate_codes]
    image16, plate16 = (codes.astype(np.uint16) * 257 for codes in (image_codes, plate_codes))

    def solve(model, C, B, tables=None):
        return lambda: solver(C, B, model, NOISE, NOISE, tables=tables, out=maps)

    return {
        "rank 1, float32": solve(LINE, image, plate),
        "rank 2, float32": solve(PLANE, image, plate),
        "rank 1, 8 bit": solve(LINE, image_codes, plate_codes, (table, table)),
        "rank 1, 16 bit": solve(LINE, image16, plate16, (table16, table16)),
        **copying(image, plate, maps),
        "plain NumPy": lambda: plain_numpy(image, plate, LINE, NOISE),
    }


def tables(quick: bool = False) -> list[Table]:
    height, width = (QUICK_HEIGHT, QUICK_WIDTH) if quick else (HEIGHT, WIDTH)
    jobs = solving(*code_pictures(height, width), PixelMaps.empty(height, width))
    numpy_job = {"plain NumPy": jobs.pop("plain NumPy")}
    interleaved(jobs, 1)  # compiles
    times = interleaved(jobs, 1 if quick else ROUNDS)
    seconds = {name: float(np.median(t)) for name, t in times.items()}
    seconds["plain NumPy"] = min(interleaved(numpy_job, 1)["plain NumPy"])
    rows = [
        (
            name,
            1e3 * t,
            t / seconds["no arithmetic"],
            t / seconds["numpy.copyto"],
            seconds["plain NumPy"] / t,
        )
        for name, t in seconds.items()
    ]
    return [
        Table(
            "closed_form",
            "How close is the closed form to the memory bandwidth?",
            f"A picture of {width}x{height} is solved into reused outputs, {cpu_count()} processors, "
            f"median of {ROUNDS} interleaved rounds. no arithmetic: the same loop reads the same "
            "arrays and writes the same outputs. numpy.copyto: its threads move as many bytes, without "
            "the cache. plain NumPy: the same fit in plain NumPy, once. Columns: milliseconds, ratios "
            "to two other times, and speedup over plain NumPy.",
            ("variant", "ms", "/ no arithmetic", "/ numpy.copyto", "plain NumPy /"),
            rows,
        )
    ]


if __name__ == "__main__":
    publish_all(tables)

"""How close is the closed form to the speed of memory?

Solves a 4K picture into reused outputs and prints, from one run, the time of each variant divided by

* the same loop without arithmetic: it reads the same arrays and writes the same outputs,
* two threads of `numpy.copyto` that move as many bytes. Those bypass the cache when they write,
  which a compiled loop cannot: each of its writes first reads the line it is about to replace.

Run: python benchmarks/speed/closed_form.py
"""

import platform
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from os import cpu_count

import numpy as np
from numba import njit

from blurmatte.color import ColorModel
from blurmatte.matting.pixelwise import PixelMaps, Pixelwise, _strips
from blurmatte.radiometry import SRGB, NoiseModel

HEIGHT, WIDTH, ROUNDS = 2160, 3840, 15


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


def main() -> None:
    rng = np.random.default_rng(0)
    # Smooth scenes with noise, as photographs are: neighbours have nearly the same code values.
    scene = rng.uniform(30, 200, (HEIGHT // 40, WIDTH // 40, 3)).repeat(40, 0).repeat(40, 1)
    plate_codes = np.clip(scene + rng.normal(0, 2, scene.shape), 1, 254).astype(np.uint8)
    image_codes = np.clip(0.7 * scene + 40 + rng.normal(0, 2, scene.shape), 1, 254).astype(np.uint8)
    table = SRGB.table(256).astype(np.float32)
    image, plate = table[image_codes], table[plate_codes]
    image16, plate16 = (codes.astype(np.uint16) * 257 for codes in (image_codes, plate_codes))
    table16 = SRGB.table(65536).astype(np.float32)
    line, plane = ColorModel.from_hex("#d8ff3c"), ColorModel.from_hex("#d8ff3c", "#2040ff")
    noise, solver = NoiseModel(gain=1e-4, read_std=1e-3), Pixelwise()
    maps = PixelMaps.empty(HEIGHT, WIDTH)
    flat = [m.reshape(-1) for m in maps]
    flat_image, flat_plate = image.reshape(-1), plate.reshape(-1)

    def copy_without_arithmetic() -> None:
        def run(s: slice) -> None:
            t = slice(3 * s.start, 3 * s.stop)
            alpha, std, P, P_std, quality = flat
            touch(flat_image[t], flat_plate[t], alpha[s], std[s], P[t], P_std[t], quality[s])

        in_threads(run, HEIGHT * WIDTH)

    moved = (
        image.nbytes + plate.nbytes + 2 * maps.quality.nbytes + sum(m.nbytes for m in maps)
    ) // 2
    source, target = np.ones(moved, np.uint8), np.empty(moved, np.uint8)

    def solve(model, C, B, tables=None):
        return lambda: solver(C, B, model, noise, noise, tables=tables, out=maps)

    jobs: dict[str, Callable[[], object]] = {
        "rank 1, float32": solve(line, image, plate),
        "rank 2, float32": solve(plane, image, plate),
        "rank 1, 8 bit": solve(line, image_codes, plate_codes, (table, table)),
        "rank 1, 16 bit": solve(line, image16, plate16, (table16, table16)),
        "no arithmetic": copy_without_arithmetic,
        "numpy.copyto": lambda: in_threads(lambda s: np.copyto(target[s], source[s]), moved),
    }
    times: dict[str, list[float]] = {name: [] for name in jobs}
    for job in jobs.values():
        job()
    for _ in range(ROUNDS):
        for name, job in jobs.items():
            start = time.perf_counter()
            job()
            times[name].append(time.perf_counter() - start)
    start = time.perf_counter()
    plain_numpy(image, plate, line, noise)
    numpy_time = time.perf_counter() - start

    median = {name: float(np.median(t)) for name, t in times.items()}
    print(f"{WIDTH}x{HEIGHT}, {cpu_count()} processors, {platform.machine()}, {ROUNDS} rounds")
    print(f"{'':18} {'ms':>7} {'/ no arithmetic':>16} {'/ numpy.copyto':>15} {'plain NumPy /':>14}")
    for name, t in median.items():
        print(
            f"{name:18} {1e3 * t:7.1f} {t / median['no arithmetic']:16.2f} "
            f"{t / median['numpy.copyto']:15.2f} {numpy_time / t:14.0f}"
        )


if __name__ == "__main__":
    main()

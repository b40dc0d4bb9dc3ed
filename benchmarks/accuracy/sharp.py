"""How close to the truth are deblurred objects, their errors and their paths?

Renders textured balls before a textured plate, fits their sweeps with any colors, deblurs them, and
compares eight sub-frames with the true ones, the blurred picture and a Wiener filter.

The Wiener filter divides the Fourier transform of the premultiplied light by that of the true point
spread function, and its constant is chosen with the truth: it bounds all filters of this kind.

Run: python -m benchmarks.accuracy.sharp
"""

import time
from dataclasses import dataclass

import numpy as np
from benchmarks.table import Cell, Table, publish_all
from benchmarks.trials import rows_over_seeds

from blurmatte.color.model import ColorModel
from blurmatte.deblurring import Sharp, deblur
from blurmatte.layer import Layer, box_around
from blurmatte.metrics import subframe_psnr, subframe_ssim, trajectory_iou
from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.rendering import Ball, Camera, Rendering, Scene, Shot, render
from blurmatte.rendering.plates import textured_plate
from blurmatte.sweep import fit_sweep
from blurmatte.trajectory import Trajectory

FRAMES = 8
RADIUS = 16.0
LENGTHS = (1, 3, 6)  # radii
CAMERAS = {
    "PNG, 1 code": Camera(code_std=1 / 255, bits=8),
    "JPEG 90": Camera(code_std=1 / 255, bits=8, jpeg_quality=90, chroma="4:2:0"),
}
SEEDS = 6
CONSTANTS = 10.0 ** np.arange(-4, 0, 0.5)  # of the Wiener filter
NOTES = f"""
Balls of radius {RADIUS:g} px with patches or clouds of random paint, flat light, before a
textured plate; straight paths of so many radii in all directions; the plate is the median of five
frames; nothing given but that the object may have any colors. Medians over {SEEDS} seeds of each
texture, of eight sub-frames in the true object's box: PSNR and SSIM of sRGB codes; Wiener: the
same filter with the best constant. TIoU: of the refined path. z: RMS of the error of the straight
color over its standard deviation, inside. seconds: of one processor.
"""
COLUMNS = ("camera", "length", "blurred", "Wiener", "sharp", "SSIM", "TIoU", "z", "seconds")


@dataclass(frozen=True)
class Outcome:
    """Scores of one scene; decibel, and as in `NOTES`."""

    blurred: float
    wiener: float
    sharp: float
    ssim: float
    tiou: float
    z: float
    seconds: float


def texture(seed: int) -> np.ndarray:
    """(96, 192, 3) patches of paint for even seeds, clouds for odd ones."""
    from scipy.ndimage import zoom

    rng = np.random.default_rng(seed)
    paint = rng.uniform(0.08, 0.95, (6, 12, 3))
    return np.clip(zoom(paint, (16, 16, 1), order=0 if seed % 2 == 0 else 3), 0.02, 1)


def scene(length: float, seed: int) -> Scene:
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0, 2 * np.pi)
    half = length * RADIUS / 2 * np.array([np.cos(angle), np.sin(angle)])
    size = np.ceil(2 * np.abs(half) + 2 * RADIUS + 40).astype(int)
    middle = size / 2 + rng.uniform(-0.5, 0.5, 2)
    path = Trajectory.line(middle - half, middle + half)
    ball = Ball(RADIUS, texture=texture(seed), ambient=1.0)
    return Scene(textured_plate((int(size[0]), int(size[1])), seed), path, ball)


def trial(camera: str, length: float, seed: int) -> Outcome:
    truth = render(scene(length, seed))
    image, plate = Shot(truth.scene, CAMERAS[camera], plate_frames=5, seed=seed).photograph(truth)
    sweep = fit_sweep(image, plate, model=ColorModel.any())
    start = time.process_time()
    sharp = deblur(image, plate, sweep)
    frames = sharp.subframes(FRAMES)
    seconds = time.process_time() - start
    shown = [layer.over(plate).rgb for layer in frames]
    psnr, ssim = scores(shown, truth)
    return Outcome(
        scores([image.rgb] * FRAMES, truth)[0],
        max(scores(shown, truth)[0] for shown in wiener(image, plate, truth)),
        psnr,
        ssim,
        trajectory_iou(sharp.sweeps[0].trajectory, truth.trajectory, RADIUS),
        z_of(sharp, truth),
        seconds,
    )


def scores(shown: list[np.ndarray], truth: Rendering) -> tuple[float, float]:
    """PSNR and SSIM in the box of the true object."""
    true = truth.subframes(FRAMES)
    x0, y0, x1, y1 = box_around(*true) or (0, 0, 1, 1)

    def coded(light: np.ndarray) -> np.ndarray:
        return SRGB.encode(np.clip(light, 0, 1))[y0:y1, x0:x1]

    stack = np.stack([coded(one.over(truth.plate).rgb) for one in true])
    found, plate = np.stack([coded(one) for one in shown]), coded(truth.plate.rgb)
    return subframe_psnr(found, stack, plate), subframe_ssim(found, stack, plate)


def wiener(image: LinearImage, plate: LinearImage, truth: Rendering) -> list[list[np.ndarray]]:
    """Sub-frames for each constant, with the true path and silhouette."""
    light = image.rgb - (1 - truth.layer.alpha)[..., None] * plate.rgb
    h, w = truth.layer.alpha.shape
    u, v = np.fft.fftfreq(w), np.fft.fftfreq(h)[:, None]
    moments = truth.trajectory.at((np.arange(512) + 0.5) / 512)
    still = truth.trajectory.at(0.5)
    waves = [np.exp(-2j * np.pi * (u * dx + v * dy)) for dx, dy in moments - still]
    H = np.mean(waves, axis=0)[..., None]
    spectrum = np.fft.fft2(light, axes=(0, 1))
    stacks = []
    for constant in CONSTANTS:
        sharp = spectrum * H.conj() / (np.abs(H) ** 2 + constant)
        stack = []
        for n, layer in enumerate(truth.subframes(FRAMES)):
            dx, dy = truth.trajectory.at((n + 0.5) / FRAMES) - still
            wave = np.exp(-2j * np.pi * (u * dx + v * dy))[..., None]
            moved = np.fft.ifft2(sharp * wave, axes=(0, 1)).real * (layer.alpha > 0)[..., None]
            stack.append(Layer(layer.alpha, moved).over(plate).rgb)
        stacks.append(stack)
    return stacks


def z_of(sharp: Sharp, truth: Rendering) -> float:
    """RMS error over standard deviation of the middle sub-frame's color, well inside."""
    true, layer = truth.scene, sharp.layer
    center = truth.trajectory.at(0.5)
    x, y = (np.arange(n) - c for n, c in zip(layer.size, center, strict=True))
    coverage, light = true.body.sharp(x, y, true.pose(0.5))
    inside = (coverage > 0.999) & (layer.alpha > 0.999)
    error = (layer.straight() - light)[inside] / sharp.color_std[inside]
    return float(np.sqrt(np.mean(error**2)))


def row(group: list[Outcome]) -> list[Cell]:
    return np.median([list(vars(one).values()) for one in group], axis=0).tolist()


def tables(quick: bool = False) -> list[Table]:
    settings = [(camera, length) for camera in CAMERAS for length in LENGTHS]
    settings = settings[:1] if quick else settings
    rows = rows_over_seeds(trial, settings, row, quick, 2 * SEEDS)
    question = "How close to the truth are deblurred sub-frames, their errors and their paths?"
    return [Table("sharp", question, NOTES, COLUMNS, rows)]


if __name__ == "__main__":
    publish_all(tables)

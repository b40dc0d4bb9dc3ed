"""How close to the truth is the spin of a ball from one picture, and how often is it refused?

Renders spinning balls before a textured plate, fits their sweeps with any colors, and estimates their
spins. Sub-frames with and without the spin are compared with the true ones.

Each scene takes about half a minute of one processor. Its outcome is printed and kept in `KEPT`, so
that a run which was interrupted goes on where it stopped, for the same commit and machine.

Run: python -m benchmarks.accuracy.spin
"""

import json
import time
from dataclasses import asdict, dataclass
from functools import partial
from hashlib import sha256
from pathlib import Path

import numpy as np
from benchmarks.accuracy.sharp import FRAMES, scores, texture
from benchmarks.table import Cell, Table, changed_files, machine, publish_all
from benchmarks.trials import over_seeds

from blurmatte.color.model import ColorModel
from blurmatte.deblurring import deblur, fit_spin
from blurmatte.errors import MotionError, SpinError
from blurmatte.rendering import Ball, Camera, Rendering, Scene, Shot, render
from blurmatte.rendering.lighting import Lamp
from blurmatte.rendering.plates import textured_plate
from blurmatte.rendering.pose import Change
from blurmatte.sweep import Sweep, fit_sweep
from blurmatte.trajectory import Trajectory

CAMERA = Camera(code_std=1 / 255, bits=8)
LIGHTS = {"flat": 1.0, "lamp": 0.35}  # ambient fraction of the light
RATES = ((0, 50), (50, 100), (100, 150))  # degrees per exposure
SEEDS = 36
KEPT = Path(__file__).parents[2] / ".cache" / "spin"
# An error of more standard deviations, and of more than the next, is confidently wrong
WRONG_STD = 4.0
WRONG_DEG = 10.0
NOTES = f"""
Balls of radius 10 to 20 px with patches or clouds of random paint, straight paths of 1.5 to 8
radii, any axis, any orientation; light without direction, or a lamp on the camera's side and 35 % of
ambient light; a textured plate, the median of five frames; 8 bits, noise of 1 code value. Nothing is
given but that the object may have any colors. right: spins with an error within {WRONG_STD:g}
standard deviations or {WRONG_DEG:g} degrees; refused: those without an answer; wrong: the others.
error: median of those with an answer, degrees per exposure, the length of the difference of rotation
vectors in the direction of time of the sweep. z: root mean square error over standard deviation of
the three components. dB: median gain of PSNR of {FRAMES} sub-frames over a ball that shows one side.
seconds: of one processor.
"""
COLUMNS = ("light", "rate", "right", "refused", "wrong", "error", "z", "dB", "seconds")


@dataclass(frozen=True)
class Outcome:
    """Of one scene: error vector over standard deviations as a square sum; None if refused."""

    error: float | None
    chi_square: float | None
    gain: float | None
    seconds: float
    refusal: str = ""

    @property
    def wrong(self) -> bool:
        """Confidently wrong."""
        if self.error is None or self.chi_square is None:
            return False
        return self.chi_square > WRONG_STD**2 and self.error > WRONG_DEG


def scene(ambient: float, rates: tuple[float, float], seed: int) -> Scene:
    """A ball of random size, texture, path, axis and orientation."""
    rng = np.random.default_rng((seed, int(100 * ambient), int(rates[0])))
    radius = rng.uniform(10, 20)
    length, angle = radius * rng.uniform(1.5, 8), rng.uniform(0, 2 * np.pi)
    axis, turned, lamp = rng.normal(size=(3, 3))
    spin = np.radians(rng.uniform(*rates)) * axis / np.linalg.norm(axis)
    half = length / 2 * np.array([np.cos(angle), np.sin(angle)])
    size = np.ceil(2 * np.abs(half) + 2 * radius + 40).astype(int)
    middle = size / 2 + rng.uniform(-0.5, 0.5, 2)
    toward = (lamp[0], lamp[1], abs(lamp[2]))
    ball = Ball(radius, texture=texture(seed), ambient=ambient, lamps=(Lamp(toward),))
    return Scene(
        textured_plate((int(size[0]), int(size[1])), seed),
        Trajectory.line(middle - half, middle + half),
        ball,
        Change(turned=tuple(turned), spin=tuple(spin)),
    )


def trial(light: str, rates: tuple[float, float], seed: int) -> Outcome:
    truth = render(scene(LIGHTS[light], rates, seed))
    image, plate = Shot(truth.scene, CAMERA, plate_frames=5, seed=seed).photograph(truth)
    start = time.process_time()
    try:
        sweep = fit_sweep(image, plate, model=ColorModel.any())
        start = time.process_time()
        spin = fit_spin(image, plate, sweep)
    except (MotionError, SpinError) as error:
        return Outcome(None, None, None, time.process_time() - start, str(error))
    seconds = time.process_time() - start
    error = spin.rotation - true_rotation(truth, sweep)
    psnr = [
        scores(
            [one.over(plate).rgb for one in deblur(image, plate, sweep, spin=s).subframes(FRAMES)],
            truth,
        )[0]
        for s in (spin, None)
    ]
    return Outcome(
        float(np.degrees(np.linalg.norm(error))),
        float(error @ np.linalg.solve(spin.rotation_covariance, error)),
        psnr[0] - psnr[1],
        seconds,
    )


def kept_trial(folder: Path, light: str, rates: tuple[float, float], seed: int) -> Outcome:
    """The outcome in a folder, or that of a new trial, which is printed and kept there."""
    file = folder / f"{light}-{rates[0]}-{seed}.json"
    if file.exists():
        return Outcome(**json.loads(file.read_text()))
    outcome = trial(light, rates, seed)
    print(file.stem, outcome, flush=True)
    unfinished = file.with_suffix(".part")
    unfinished.write_text(json.dumps(asdict(outcome)))
    unfinished.replace(file)
    return outcome


def true_rotation(truth: Rendering, sweep: Sweep) -> np.ndarray:
    """In the sweep's direction of time."""
    rotation = np.array(truth.scene.change.spin)
    along = truth.trajectory.at(1.0) - truth.trajectory.at(0.0)
    found = sweep.trajectory.at(1.0) - sweep.trajectory.at(0.0)
    return rotation if along @ found > 0 else -rotation


def tables(quick: bool = False) -> list[Table]:
    settings = [(light, rates) for light in LIGHTS for rates in RATES]
    settings = settings[:1] if quick else settings
    rows: list[tuple[Cell, ...]] = []
    one = trial
    if not quick and not changed_files():
        folder = KEPT / sha256(machine().encode()).hexdigest()[:12]
        folder.mkdir(parents=True, exist_ok=True)
        one = partial(kept_trial, folder)
    groups = over_seeds(one, settings, quick, SEEDS)
    for (light, (slow, fast)), group in zip(settings, groups, strict=True):
        answered = [one for one in group if one.error is not None]
        wrong = sum(one.wrong for one in group)
        squares = [one.chi_square / 3 for one in answered if one.chi_square is not None]
        rows.append(
            (
                *(
                    light,
                    f"{slow}-{fast}",
                    len(answered) - wrong,
                    len(group) - len(answered),
                    wrong,
                ),
                _median([one.error for one in answered]),
                float(np.sqrt(np.mean(squares))) if squares else None,
                _median([one.gain for one in answered]),
                _median([one.seconds for one in group]),
            )
        )
    question = "How close to the truth is the spin of a ball from one picture, and is it refused?"
    return [Table("spin", question, NOTES, COLUMNS, rows)]


def _median(values: list[float | None]) -> float | None:
    return float(np.median([v for v in values if v is not None])) if values else None


if __name__ == "__main__":
    publish_all(tables)

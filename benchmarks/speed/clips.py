"""What does a frame of a clip cost, compared with decoding it, and how much memory does a clip need?

Run: python -m benchmarks.speed.clips
"""

import time
from collections.abc import Callable, Iterator
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks.speed.editing import measured
from benchmarks.table import Cell, Table, publish_all

import blurmatte as bm
from blurmatte.motion.clip.color import color_in_scene
from blurmatte.motion.clip.measure import Detector
from blurmatte.motion.clip.scene import StaticScene, clip_plate, survey
from blurmatte.motion.clip.solving import FrameSolver, rows_with_priors
from blurmatte.motion.clip.steps import shots_of
from blurmatte.rendering import colorful_plate

SIZES, QUICK_SIZES = ((1920, 1080), (3840, 2160)), ((320, 180),)
FRAMES, QUICK_FRAMES = 100, 25
CYCLE, BUSY = 25, 5  # frames, and those of them that show the ball
SOLVED, QUICK_SOLVED = 5, 1  # frames
NOISE = 1.5  # code values of 255
COLOR = np.array([0.75, 0.55, 0.06])
ROUNDS = 3


def pictures(size: tuple[int, int], count: int) -> Iterator[np.ndarray]:
    """Frames of 8 bits with noise: a ball crosses the picture, then nothing moves for a while."""
    height, rng = size[1], np.random.default_rng(0)
    plate = colorful_plate(size, 3, tile=height / 9)
    empty = 255 * bm.SRGB.encode(plate).astype(np.float32)
    noise = NOISE * rng.standard_normal(empty.shape, np.float32)
    for k in range(count):
        codes = empty.copy()
        if k % CYCLE < BUSY:
            box, image = ball_before(plate, k % CYCLE)
            codes[box] = 255 * bm.SRGB.encode(image)
        codes += np.roll(noise, tuple(rng.integers(0, height, 2)), (0, 1))
        yield np.clip(np.rint(codes), 0, 255).astype(np.uint8)


def ball_before(plate: np.ndarray, step: int) -> tuple[tuple[slice, slice], np.ndarray]:
    """The part of the picture around the ball, and its light."""
    height, width = plate.shape[:2]
    radius, x, y = height / 54, width * (0.1 + 0.8 * step / BUSY), height * (0.3 + 0.06 * step)
    start, end = np.array([x, y]), np.array([x + 0.08 * width, y + 0.03 * height])
    corner = np.floor(start - 2 * radius - 8).astype(int)
    far = np.ceil(end + 2 * radius + 8).astype(int)
    box = slice(corner[1], far[1]), slice(corner[0], far[0])
    path = bm.Trajectory.line(tuple(start - corner), tuple(end - corner))
    return box, bm.rendering.render(
        bm.rendering.Scene(plate[box], path, bm.rendering.Ball(radius, COLOR))
    ).image.rgb


def cpu_seconds(job: Callable[[], object]) -> float:
    """Of this process."""
    start = time.process_time()
    job()
    return time.process_time() - start


def costs(path: Path, solved: int) -> list[tuple[str, float, float]]:
    """Steps, CPU seconds of each, and the number of frames that it did."""
    clip, alone = bm.read_frames(path), bm.motion.Workers(1)
    count = len(clip)
    plates: list[bm.LinearImage] = []
    plate_seconds = cpu_seconds(lambda: plates.append(clip_plate(clip).plate))
    scene = StaticScene.of(clip, plates[0])
    survey(clip[:2], scene, alone)  # compiles, or loads what is compiled
    steps = {
        "decoding": lambda: sum(1 for _ in clip.coded(slice(None))),
        "shots, with decoding": lambda: shots_of(clip, alone),
        "gate, with decoding": lambda: survey(clip, scene, alone),
    }
    times = [{name: cpu_seconds(job) for name, job in steps.items()} for _ in range(ROUNDS)]
    rows = [(name, min(each[name] for each in times), float(count)) for name in steps]
    rows.append(("plate, of each clip", plate_seconds, 1.0))
    model = color_in_scene(clip, survey(clip, scene, alone), alone)
    seen: list[bm.motion.FrameSightings] = []
    scene = scene.of_color(clip, model)
    new = Detector(scene, range(count), None, False).over(clip, alone, 0)
    rows.append(("table, all frames", cpu_seconds(lambda: seen.extend(new)), float(count)))
    solver = FrameSolver(scene, {k: k for k in range(count)})
    solver, wanted = rows_with_priors(clip, bm.motion.link_sightings(seen), solver, alone, False)
    (first, row), *few = list(solver.parts(wanted))[: solved + 1]
    solver(clip[first], row)
    seconds = cpu_seconds(lambda: [solver(clip[which], row) for which, row in few])
    return [*rows, ("solving, a frame with the ball", seconds, float(len(few)))]


def tables(quick: bool = False) -> list[Table]:
    sizes, count, solved = (
        (QUICK_SIZES, QUICK_FRAMES, QUICK_SOLVED) if quick else (SIZES, FRAMES, SOLVED)
    )
    rows: list[tuple[Cell, ...]] = []
    for size in sizes:
        name = f"{size[0]}x{size[1]}"
        with TemporaryDirectory() as folder:
            path = Path(folder) / "clip.mp4"
            bm.write_frames(path, pictures(size, count), rate=50)
            each = [(step, seconds / frames) for step, seconds, frames in costs(path, solved)]
            decoding = each[0][1]
            rows += [(s, name, 1e3 * cost, cost / decoding, None) for s, cost in each]
            alone = ["--workers", 1, "--frames", f"0:{count}"]
            for command, out in (("track", "table.csv"), ("solve", "out")):
                _, peak = measured(command, path, "--out", Path(folder) / out, *alone)
                rows.append((f"{command}, one process", name, None, None, peak))
    return [
        Table(
            "clips",
            "What does a frame of a clip cost, compared with decoding it?",
            f"A clip of H.264 (CRF 16, 8 bits, noise of {NOISE:g} codes), in which a ball is in one "
            f"frame of five; {count} frames. ms: CPU time of one thread, for each frame or as stated; "
            f"of decoding, shots and gate the shortest of {ROUNDS} interleaved rounds. ratio: to "
            "decoding. MB: peak memory of a whole command in one process, if the system reports it; "
            "plate, color, table and solving are in it.",
            ("step", "size", "ms", "ratio", "MB"),
            rows,
        )
    ]


if __name__ == "__main__":
    publish_all(tables)

"""How far are blurmatte and other methods from the true alpha and color, on the same pictures?

Photographs the scenes of the package and gives image and plate to every method; the column `given`
lists what a method gets. Each method runs over all scenes in its own process, so that its memory can be
measured.

Run: python -m benchmarks.accuracy.against_other_methods [--scenes NAME…]
"""

import argparse
import multiprocessing
import os
import pickle
import re
import time
import warnings
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from benchmarks.accuracy import other_methods as other
from benchmarks.table import Cell, Table, add_options, publish, result_folder

from blurmatte.color.model import ColorModel
from blurmatte.errors import BlurmatteError
from blurmatte.layer import Layer
from blurmatte.matting import solve
from blurmatte.radiometry import LinearImage
from blurmatte.rendering import render
from blurmatte.scenes import ProgramAnswer, Score, read_shots, score
from blurmatte.scenes.score import Truth

SCENES = (
    "easy", "plain_wall", "two_hues", "glossy", "two_paints", "painted", "dice", "stick", "star",
    "faint", "slow", "bounce", "from_rest", "defocused", "glassy", "approaching", "two_lamps",
    "fence", "stripes", "coffee", "astronaut", "wide_angle", "wide_filter", "near_wall", "phone",
)  # fmt: skip
SEED = 0
PLATE = "plate"  # all that is available with a real picture
OURS, OURS_WITH_COLORS = "blurmatte", "blurmatte, colors"
NOTES = """
All scenes of one shot; image and median plate are decoded from the camera's files. Errors are those
of blurmatte.metrics over the streak, median and worst of the scenes. `false`: alpha where the object
never was; `light`: premultiplied RMSE; `degrees`: angle between mean colors; `dB`: PSNR over another
background (worst: smallest). A miss is scored as an empty layer, which has no color. `seconds`: median
of a scene, BLAS in one thread, after an untimed first call. `MB`: peak memory of the process, with
Python and libraries; compare with `empty`. blurmatte finds streak and color; with `colors` it is given
the true line or plane, and omits scenes whose colors fill RGB. `published`: color by the formula of
2007, alpha by its equations, unweighted least squares, in the streak that blurmatte finds. `key`:
|C - B| summed over channels, linear light, divided by its 99.5th percentile in the streak; `key,
tuned`: gain and threshold with the least squared error. `cv`: OpenCV's subtractors trained on 50 noisy
copies of the plate; they detect, so alpha is 0 or 1. `pm`: PyMatting's solvers with their defaults,
color by estimate_foreground_ml. They get no plate but a trimap made from the truth: background 3
pixels and more from the streak, foreground where the true alpha exceeds 0.99 or, if that is nowhere,
on the ridge; cropped to 24 pixels around the streak. The picture is sRGB-coded, as in their
documentation. `best`: alpha times the true largest alpha, and the better, by the truth, of the
sRGB-coded and the linear picture (two solves).
"""


@dataclass(frozen=True, eq=False)
class Case:
    """Pictures of a scene, and the truth for methods that get it; model None: rank 3."""

    image: LinearImage
    plate: LinearImage
    truth: Layer
    model: ColorModel | None


@dataclass(frozen=True)
class Method:
    """Something that makes a layer of a case.

    Parameters
    ----------
    name : str
    given : str
        Its inputs besides the image.
    layer : callable
        Case to Layer. BlurmatteError, ValueError and LinAlgError are misses.
    alpha_only : bool
        It estimates no color.
    needs_model : bool
        It omits scenes whose colors are no line or plane.
    """

    name: str
    given: str
    layer: Callable[[Case], Layer]
    alpha_only: bool = False
    needs_model: bool = False


@dataclass(frozen=True, eq=False)
class Outcome:
    """What a method did with a case: a layer, or why there is none."""

    layer: Layer | None
    seconds: float
    why: str = ""


@dataclass(frozen=True)
class Result:
    """How well a method did in a scene, and why not."""

    method: str
    scene: str
    score: Score
    seconds: float
    why: str


def methods() -> list[Method]:
    """All of them, in the order of the tables."""
    detect = [
        Method(f"cv {name}", PLATE, partial(_detect, name), alpha_only=True)
        for name in ("MOG2", "KNN")
    ]
    matting = [
        method
        for name in ("cf", "knn", "lbdm", "lkm", "rw", "sm")
        for method in (
            Method(f"pm {name}", "trimap from truth", partial(_matting, name)),
            Method(f"pm {name}, best", "trimap, peak from truth", partial(_best_matting, name)),
        )
    ]
    return [
        Method(OURS, PLATE, lambda case: solve(case.image, case.plate).layer),
        Method(OURS_WITH_COLORS, "plate, true colors", _with_true_colors, needs_model=True),
        Method("published", PLATE, lambda case: other.published(case.image, case.plate)),
        Method("key", PLATE, lambda case: other.difference_key(case.image, case.plate)),
        Method("key, tuned", "plate, truth", _tuned_key),
        *detect,
        *matting,
        Method("empty", "", lambda case: other.nothing(case.image)),
    ]


def tables(scenes: Sequence[str] = SCENES, quick: bool = False) -> list[Table]:
    """Every method over all scenes, and the error of alpha of every method in every scene."""
    scenes = scenes[:2] if quick else scenes
    results: list[Result] = []
    memory = {}
    with TemporaryDirectory() as folder:
        truths = {scene: _photograph(scene, Path(folder)) for scene in scenes}
        for method in methods():
            outcomes, memory[method.name] = _in_own_process(method, list(scenes), folder)
            results += [_scored(method, s, outcomes[s], truths[s]) for s in outcomes]
    return [_over_scenes(results, memory), _by_scene(results)]


def _with_true_colors(case: Case) -> Layer:
    return solve(case.image, case.plate, case.model).layer


def _tuned_key(case: Case) -> Layer:
    return other.tuned_difference_key(case.image, case.plate, case.truth)


def _detect(name: str, case: Case) -> Layer:
    import cv2

    cv2.setRNGSeed(SEED)
    subtractor = getattr(cv2, f"createBackgroundSubtractor{name}")(detectShadows=False)
    mask = other.background_subtractor(subtractor, case.image, case.plate, SEED)
    return replace(other.nothing(case.image), alpha=mask)


def _matting(name: str, case: Case) -> Layer:
    return other.matting(_solver(name), case.image, other.trimap_of(case.truth))


def _best_matting(name: str, case: Case) -> Layer:
    trimap = other.trimap_of(case.truth)
    return other.best_matting(_solver(name), case.image, trimap, case.truth)


def _solver(name: str) -> other.MattingMethod:
    import pymatting

    solver: other.MattingMethod = getattr(pymatting, f"estimate_alpha_{name}")
    return solver


def _photograph(scene: str, folder: Path) -> Truth:
    """The truth of a scene; what the processes of the methods need goes to a file."""
    (shot,) = read_shots(scene)
    rendering = render(shot.scene)
    image, plate = shot.photograph(rendering)
    case = Case(image, plate, rendering.layer, rendering.model)
    (folder / f"{scene}.pickle").write_bytes(pickle.dumps(case))
    radius = max(shot.scene.body.reach(shot.scene.change.at(0)))
    return Truth(rendering.layer, rendering.plate, rendering.trajectory, radius, ())


def _in_own_process(
    method: Method, scenes: list[str], folder: str
) -> tuple[dict[str, Outcome], float | None]:
    """Outcomes by scene, and the most memory that the process held, MB."""
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # threads would wait for each other
    fresh = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=fresh) as process:
        return process.submit(_run, method.name, scenes, folder).result()


def _run(name: str, scenes: list[str], folder: str) -> tuple[dict[str, Outcome], float | None]:
    (method,) = (method for method in methods() if method.name == name)
    warnings.simplefilter("ignore")  # the scores show what they warn of
    outcomes = {}
    for scene in [scenes[0], *scenes]:  # the first twice: it imports and compiles
        case = pickle.loads((Path(folder) / f"{scene}.pickle").read_bytes())
        if case.model is not None or not method.needs_model:
            outcomes[scene] = _outcome(method, case)
    return outcomes, _most_memory()


def _outcome(method: Method, case: Case) -> Outcome:
    start = time.perf_counter()
    try:
        layer, why = method.layer(case), ""
    except (BlurmatteError, ValueError, np.linalg.LinAlgError) as error:
        layer, why = None, str(error)
    return Outcome(layer, time.perf_counter() - start, why)


def _most_memory() -> float | None:
    """MB that this process held at most; None if the system does not report it.

    Not ru_maxrss: there Linux counts in the process that started this one.
    """
    try:
        status = Path("/proc/self/status").read_text()
    except OSError:
        return None
    (line,) = (line for line in status.splitlines() if line.startswith("VmHWM"))
    return int(line.split()[1]) / 1024


def _scored(method: Method, scene: str, outcome: Outcome, truth: Truth) -> Result:
    answer = ProgramAnswer(outcome.layer, method.alpha_only) if outcome.layer else None
    return Result(method.name, scene, score(answer, truth), outcome.seconds, outcome.why)


def _over_scenes(results: list[Result], memory: dict[str, float | None]) -> Table:
    rows = []
    for method in methods():
        own = [result for result in results if result.method == method.name]
        missed = sum(not result.score.answered for result in own)
        seconds = float(np.median([result.seconds for result in own])) if own else None
        quality = [cell for measure in _MEASURES for cell in _median_and_worst(measure, own)]
        rows.append(
            (method.name, method.given, len(own), missed, *quality, seconds, memory[method.name])
        )
    heads = [head for name in _MEASURES.values() for head in (name, f"{name} worst")]
    return Table(
        name="against_other_methods",
        question="How far are blurmatte and other methods from the true alpha and color, on the "
        "same pictures?",
        notes=NOTES + _misses(results),
        columns=("method", "given", "scenes", "missed", *heads, "seconds", "MB"),
        rows=rows,
    )


_MEASURES = {
    "alpha_rmse": "alpha",
    "alpha_sum_bias": "bias",
    "false_alpha": "false",
    "premultiplied_rmse": "light",
    "color_degrees": "degrees",
    "recomposite_psnr": "dB",
}


def _median_and_worst(measure: str, results: list[Result]) -> tuple[Cell, Cell]:
    """Of those that have one; a bias counts without its sign."""
    all_values = [getattr(result.score, measure) for result in results]
    values = [abs(value) for value in all_values if value is not None]
    if not values:
        return None, None
    worst = min(values) if measure == "recomposite_psnr" else max(values)
    return float(np.median(values)), float(worst)


def _misses(results: list[Result]) -> str:
    """Which, and what they say up to the first detail."""
    missed = [r for r in results if r.why]
    said = [f"{r.method} in {r.scene}: {re.split('[(:;]', r.why)[0].strip()}" for r in missed]
    return f"Missed: {'; '.join(said)}." if said else ""


def _by_scene(results: list[Result]) -> Table:
    names = [method.name for method in methods()]
    equals = [method.name for method in methods() if method.given in (PLATE, "")]
    others = [name for name in names if name != OURS_WITH_COLORS]
    rows: list[tuple[Cell, ...]] = []
    for scene in dict.fromkeys(result.scene for result in results):
        alpha = {r.method: r.score.alpha_rmse for r in results if r.scene == scene}
        gave = {r.method: r.score.alpha_rmse for r in results if r.scene == scene and not r.why}
        nearest = [min((n for n in g if n in gave), key=gave.__getitem__) for g in (equals, others)]
        rows.append((scene, *nearest, *(alpha.get(name) for name in names)))
    return Table(
        name="against_other_methods_by_scene",
        question="Which method has the smallest error of alpha in which scene?",
        notes="RMSE of alpha over the streak; methods and misses as in against_other_methods. "
        "`nearest, given plate`: of those that get the plate and nothing else, or `empty`. "
        f"`nearest`: of all but {OURS_WITH_COLORS}. Misses are excluded.",
        columns=("scene", "nearest, given plate", "nearest", *names),
        rows=rows,
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--scenes", nargs="+", default=SCENES, choices=SCENES, metavar="NAME")
    add_options(parser)
    arguments = parser.parse_args()
    folder = result_folder(arguments.folder, arguments.quick, arguments.allow_dirty)
    for table in tables(arguments.scenes, arguments.quick):
        publish(table, folder, arguments.allow_dirty)


if __name__ == "__main__":
    main()

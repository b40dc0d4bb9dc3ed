"""Truth of a scene and answer of a program, read from their folders, and the score: its errors."""

from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, fields, replace
from pathlib import Path

import numpy as np

from blurmatte import metrics
from blurmatte.checks import Floats, check_kind, check_same_size
from blurmatte.errors import FileError
from blurmatte.files.models import read_path
from blurmatte.files.reading import read, read_layer
from blurmatte.files.solutions import read_solution
from blurmatte.formats import Writes, written
from blurmatte.layer import Layer
from blurmatte.matting.solution import Solution
from blurmatte.radiometry import LINEAR, SRGB, LinearImage
from blurmatte.streaks import Streak
from blurmatte.trajectory import Trajectory

# Of the fields of Score, in their order.
_HEADINGS = (
    *("answered", "alpha RMSE", "SAD", "gradient", "sum bias", "false alpha", "light RMSE"),
    *("color units", "degrees", "PSNR", "spread", "TIoU", "sub-PSNR", "sub-SSIM"),
)
LAYER_FILES = *(f"layer{end}" for end in written(Writes.LAYER)), "alpha.png"


@dataclass(frozen=True, eq=False)
class Truth:
    """The truth of a scene that `save_shot` wrote."""

    layer: Layer  # true alpha and premultiplied light
    plate: LinearImage  # the plate behind the object, without noise; in an archive, the given one
    trajectory: Trajectory  # true path of the center
    radius: float  # extent of the object from its center at the start, pixels
    subframes: tuple[Layer, ...]  # sharp layers at the middles of equal parts of the exposure


@dataclass(frozen=True, eq=False)
class ProgramAnswer:
    """The answer of a program to a scene."""

    layer: Layer  # alpha and premultiplied light; the light is 0 if `alpha_only`
    alpha_only: bool = False  # true if the program estimates no color
    # Estimates with their standard deviations, if blurmatte wrote it
    solution: Solution | None = None
    trajectory: Trajectory | None = None  # path of the object's center
    subframes: tuple[Layer, ...] | None = None  # sharp layers, as many as in the truth


def find_scenes(folder: str | Path) -> list[Path]:
    """The folder itself if it holds a scene, else all scene folders in it, sorted.

    Raises
    ------
    FileError
        If there is no scene.

    Examples
    --------
    >>> [folder.name for folder in bm.scenes.find_scenes("scenes")]
    ['throw']
    """
    place = Path(folder)
    if (place / "truth").is_dir():
        return [place]
    scenes = sorted(truth.parent for truth in place.glob("**/truth") if truth.is_dir())
    if not scenes:
        raise FileError(
            f"{folder}: holds no scene with its truth; give a folder that blurmatte render wrote, "
            "or a folder of them"
        )
    return scenes


def read_truth(folder: str | Path) -> Truth:
    """Read the truth of a scene from the folder that `save_shot` wrote, or of an archive.

    Raises
    ------
    FileError
        If the folder holds no scene.

    Examples
    --------
    >>> truth = bm.scenes.read_truth("scenes/throw")
    >>> print(f"{truth.layer.alpha.sum():.0f} pixels")
    314 pixels
    """
    truth = Path(folder) / "truth"
    trajectory, radius = read_path(truth / "path.json")
    if radius is None:
        raise FileError(f"{truth / 'path.json'}: has no radius; render the scene again")
    plates = truth / "plate.exr", Path(folder) / "plate.exr", Path(folder) / "plate.png"
    plate = read(next((path for path in plates if path.is_file()), plates[0]))
    layer = read_layer(truth / "layer.exr")
    return Truth(layer, plate, trajectory, radius, _subframes(truth) or ())


def read_answer(path: str | Path) -> ProgramAnswer:
    """Read the answer of a program: one file, or a folder of files.

    ================================  ======================================================
    layer.exr, layer.png, layer.tif   alpha and color: EXR linear and premultiplied, PNG straight
    alpha.png                         alpha only, gray, linear, if there is no layer
    path.json                         {"xy": [[x, y], …], "t": [0, …, 1]}, optional
    subframe_00.exr …                 sharp layers, as many as in the truth, optional
    ================================  ======================================================

    Raises
    ------
    FileError
        If there is no answer or it cannot be read.

    Examples
    --------
    >>> answer = bm.scenes.read_answer("layer.exr")
    >>> answer.layer.box
    (20, 20, 99, 55)
    """
    place = Path(path)
    if not place.is_dir():
        return _layer_answer(place)
    names = [name for name in LAYER_FILES if (place / name).is_file()]
    if not names:
        raise FileError(f"{path}: holds no result; one of {', '.join(LAYER_FILES)} is needed")
    answer, path_file = _layer_answer(place / names[0]), place / "path.json"
    trajectory = read_path(path_file)[0] if path_file.is_file() else None
    return replace(answer, trajectory=trajectory, subframes=_subframes(place))


def _layer_answer(path: Path) -> ProgramAnswer:
    if path.name == "alpha.png":
        picture = read(path, LINEAR)
        if not picture.meta.gray:
            raise FileError(f"{path}: has colors; an alpha.png is gray")
        return ProgramAnswer(Layer(picture.rgb[..., 0], 0 * picture.rgb), alpha_only=True)
    layer = read_layer(path)
    try:
        return ProgramAnswer(layer, solution=read_solution(path))
    except FileError:  # a layer of another program
        return ProgramAnswer(layer)


def _subframes(folder: Path) -> tuple[Layer, ...] | None:
    files = sorted(folder.glob("subframe_*.exr"))
    return tuple(read_layer(file) for file in files) or None


@dataclass(frozen=True)
class Score:
    """Errors of an answer relative to the truth; None for a quantity that the answer lacks.

    Parameters
    ----------
    answered : bool
        False for a miss, which is scored as an empty layer.
    alpha_rmse, alpha_sad, alpha_gradient_error, alpha_sum_bias : float
        Of alpha over the streak.
    false_alpha : float
        Root mean square of alpha where the true alpha is 0.
    premultiplied_rmse : float or None
        Of the light over the streak.
    color_units, color_degrees : float or None
        Distance between the mean colors of the object, independent of brightness.
    recomposite_psnr : float or None
        Decibel, over another background: the mirrored plate.
    alpha_spread : float or None
        Spread of (alpha − truth) / alpha_std over the streak; 1 is calibrated.
    trajectory_iou, subframe_psnr, subframe_ssim : float or None
        As defined by the benchmark of fast-moving objects.

    Examples
    --------
    >>> truth = bm.scenes.read_truth("scenes/throw")
    >>> found = bm.scenes.score(bm.scenes.read_answer("layer.exr"), truth)
    >>> print(f"alpha RMSE {found.alpha_rmse:.4f}, sum off by {found.alpha_sum_bias:.2%}")
    alpha RMSE 0.0010, sum off by 0.29%
    """

    answered: bool
    alpha_rmse: float
    alpha_sad: float
    alpha_gradient_error: float
    alpha_sum_bias: float
    false_alpha: float
    premultiplied_rmse: float | None
    color_units: float | None
    color_degrees: float | None
    recomposite_psnr: float | None
    alpha_spread: float | None
    trajectory_iou: float | None
    subframe_psnr: float | None
    subframe_ssim: float | None


def score(answer: ProgramAnswer | None, truth: Truth) -> Score:
    """Compare an answer with the truth.

    Parameters
    ----------
    answer : ProgramAnswer or None
        None if the program refused or wrote no file; this counts as a miss.
    truth : Truth

    Returns
    -------
    Score

    Raises
    ------
    ValueError
        If sizes or numbers of sub-frames differ, or numbers are not finite.

    Examples
    --------
    >>> truth = bm.scenes.read_truth("scenes/throw")
    >>> found = bm.scenes.score(bm.scenes.read_answer("layer.exr"), truth)
    >>> print(f"{found.alpha_rmse:.4f}")
    0.0008
    """
    check_kind("answer", answer, ProgramAnswer | None, "use blurmatte.scenes.read_answer(file)")
    check_kind("truth", truth, Truth, "use blurmatte.scenes.read_truth(folder)")
    true = truth.layer
    given = answer or ProgramAnswer(Layer(0 * true.alpha, 0 * true.premultiplied))
    layer, mirrored = given.layer, LinearImage(truth.plate.rgb[:, ::-1])
    check_same_size("the result", layer.size, "the truth", true.size)
    color = None if given.alpha_only else _color_distance(layer, true)
    iou, psnr, ssim = _motion_scores(given, truth)
    return Score(
        answered=answer is not None,
        alpha_rmse=metrics.alpha_rmse(layer.alpha, true.alpha),
        alpha_sad=metrics.alpha_sad(layer.alpha, true.alpha),
        alpha_gradient_error=metrics.alpha_gradient_error(layer.alpha, true.alpha),
        alpha_sum_bias=metrics.alpha_sum_bias(layer.alpha, true.alpha),
        false_alpha=metrics.false_alpha(layer.alpha, true.alpha),
        premultiplied_rmse=(
            None if given.alpha_only else metrics.premultiplied_rmse(layer.premultiplied, true)
        ),
        color_units=color.units if color else None,
        color_degrees=color.degrees if color else None,
        recomposite_psnr=None
        if given.alpha_only
        else metrics.recomposite_psnr(layer, true, mirrored),
        alpha_spread=_alpha_spread(given, truth),
        trajectory_iou=iou,
        subframe_psnr=psnr,
        subframe_ssim=ssim,
    )


def mean_score(scores: Sequence[Score]) -> Score:
    """Mean of every metric over the scenes in which it is not None.

    `answered` is True if all were answered. `alpha_sum_bias` is the mean of absolute values. If an
    answer to any scene has a path, a scene without one counts as a TIoU of 0.

    Raises
    ------
    ValueError
        If there are no scores.

    Examples
    --------
    >>> truth = bm.scenes.read_truth("scenes/throw")
    >>> found = bm.scenes.score(bm.scenes.read_answer("layer.exr"), truth)
    >>> missed = bm.scenes.score(None, truth)
    >>> mean = bm.scenes.mean_score([found, missed])
    >>> mean.alpha_rmse > found.alpha_rmse
    True
    """
    if not scores:
        raise ValueError("there is nothing to take the mean of")
    for score in scores:
        _check_score(score)
    means = {f.name: _mean(f.name, scores) for f in fields(Score) if f.name != "answered"}
    return Score(answered=all(s.answered for s in scores), **means)  # type: ignore[arg-type]


def score_table(scores: Mapping[str, Score]) -> str:
    """Table of scores by scene, with their means and the standard errors of these.

    A dash stands for a metric that is None. A standard error is the standard deviation of the metric
    over the scenes, divided by the square root of their number.

    Examples
    --------
    >>> truth = bm.scenes.read_truth("scenes/throw")
    >>> found = bm.scenes.score(bm.scenes.read_answer("layer.exr"), truth)
    >>> table = bm.scenes.score_table({"throw": found})
    >>> print(table.splitlines()[1][:20])
    throw       yes    0
    """
    rows = [["scene", *_HEADINGS]]
    rows += [[name, *_cells(s)] for name, s in scores.items()]
    if len(scores) > 1:
        every = list(scores.values())
        rows.append(["mean", *_cells(mean_score(every))])
        rows.append(["std error", *(_error_cell(f.name, every) for f in fields(Score))])
    shown = [i for i in range(len(rows[0])) if any(row[i] != "-" for row in rows[1:])]
    widths = {i: max(len(row[i]) for row in rows) for i in shown}
    return "\n".join(
        "  ".join(row[i].ljust(widths[i]) if i == 0 else row[i].rjust(widths[i]) for i in shown)
        for row in rows
    )


def _check_score(score: Score) -> None:
    check_kind("a score", score, Score, "use blurmatte.scenes.score(answer, truth)")


def _cells(score: Score) -> list[str]:
    _check_score(score)
    return [_cell(value) for value in astuple(score)]


def _cell(value: float | bool | None) -> str:
    match value:
        case None:
            return "-"
        case bool():
            return "yes" if value else "miss"
    return f"{value:.4g}"


def _error_cell(name: str, scores: Sequence[Score]) -> str:
    """The standard error of the mean of a metric; a dash unless two scenes have finite values."""
    values = [] if name == "answered" else _averaged(name, scores)
    if len(values) < 2 or not np.isfinite(values).all():
        return "-"
    return f"{np.std(values, ddof=1) / np.sqrt(len(values)):.2g}"


def _mean(name: str, scores: Sequence[Score]) -> float | None:
    values = _averaged(name, scores)
    return float(np.sum(values)) / len(values) if values else None


def _averaged(name: str, scores: Sequence[Score]) -> list[float]:
    """The values of a metric that make up its mean; none if no scene has it."""
    values = [getattr(s, name) for s in scores]
    known = [abs(v) if name == "alpha_sum_bias" else v for v in values if v is not None]
    missing = len(values) - len(known) if known and name == "trajectory_iou" else 0
    return known + [0.0] * missing


def _color_distance(layer: Layer, true: Layer) -> metrics.ColorDistance | None:
    """Distance between mean colors; None if the answer has no light on the streak."""
    streak = true.alpha > 0
    found, real = (part.premultiplied[streak].sum(axis=0, dtype=float) for part in (layer, true))
    if not found.any():
        return None
    return metrics.color_distance(found, real / true.alpha[streak].sum(dtype=float))


def _alpha_spread(answer: ProgramAnswer, truth: Truth) -> float | None:
    solution = answer.solution
    if solution is None:
        return None
    seen = solution.known & (truth.layer.alpha > 0)
    if not seen.any():
        return None
    return metrics.calibration(solution.alpha, solution.alpha_std, truth.layer.alpha, seen).spread


def _motion_scores(
    answer: ProgramAnswer, truth: Truth
) -> tuple[float | None, float | None, float | None]:
    path = answer.trajectory
    iou = metrics.trajectory_iou(path, truth.trajectory, truth.radius) if path else None
    if answer.subframes is None:
        return iou, None, None
    if len(answer.subframes) != len(truth.subframes):
        raise ValueError(
            f"the result has {len(answer.subframes)} sub-frames, the truth {len(truth.subframes)}"
        )
    box = Streak(truth.layer.alpha > 0).around(8)  # a margin of 8 pixels
    found, true = (
        np.stack([_coded(frame.over(truth.plate).crop(box).rgb) for frame in frames])
        for frames in (answer.subframes, truth.subframes)
    )
    plate = _coded(truth.plate.crop(box).rgb)
    return iou, metrics.subframe_psnr(found, true, plate), metrics.subframe_ssim(found, true, plate)


def _coded(light: Floats) -> Floats:
    return np.asarray(np.clip(SRGB.encode(np.clip(light, 0, 1)), 0, 1))

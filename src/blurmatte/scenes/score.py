"""Score: how far an answer is from the truth, in the numbers of `blurmatte.metrics`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np

from blurmatte.checks import Floats, check_kind, check_same_size
from blurmatte.layer import Layer
from blurmatte.metrics import (
    ColorDistance,
    alpha_gradient_error,
    alpha_rmse,
    alpha_sad,
    alpha_sum_bias,
    calibration,
    color_distance,
    false_alpha,
    premultiplied_rmse,
    recomposite_psnr,
    subframe_psnr,
    subframe_ssim,
    trajectory_iou,
)
from blurmatte.radiometry import SRGB, LinearImage
from blurmatte.scenes.truth import Answer, Truth
from blurmatte.streaks import Streak

_MARGIN = 8  # pixels around the object in which sub-frames are compared

_HEADINGS = {
    "answered": "answered",
    "alpha RMSE": "alpha_rmse",
    "SAD": "alpha_sad",
    "gradient": "alpha_gradient_error",
    "sum bias": "alpha_sum_bias",
    "false alpha": "false_alpha",
    "light RMSE": "premultiplied_rmse",
    "color units": "color_units",
    "degrees": "color_degrees",
    "PSNR": "recomposite_psnr",
    "spread": "alpha_spread",
    "TIoU": "trajectory_iou",
    "sub-PSNR": "subframe_psnr",
    "sub-SSIM": "subframe_ssim",
}


@dataclass(frozen=True)
class Score:
    """How far an answer is from the truth. None: the program does not tell such a thing.

    Parameters
    ----------
    answered : bool
        False for a miss, which is scored as a layer without anything in it.
    alpha_rmse, alpha_sad, alpha_gradient_error, alpha_sum_bias : float
        Of alpha over the streak.
    false_alpha : float
        Root mean square of alpha where the object never was.
    premultiplied_rmse : float or None
        Of the light over the streak.
    color_units, color_degrees : float or None
        Between the average colors of the object, Σ premultiplied; brightness is not judged.
    recomposite_psnr : float or None
        Decibel, over another background: the plate turned left to right.
    alpha_spread : float or None
        Spread of (alpha − truth) / alpha_std over the streak; 1 is honest.
    trajectory_iou, subframe_psnr, subframe_ssim : float or None
        As the benchmark of fast-moving objects defines them.
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


def score(answer: Answer | None, truth: Truth) -> Score:
    """Compare an answer with the truth.

    Parameters
    ----------
    answer : Answer or None
        None: the program refused, or there is no file. That is a miss and not a skip.
    truth : Truth

    Returns
    -------
    Score

    Raises
    ------
    ValueError
        If sizes differ, numbers are not finite, or there are not as many sub-frames as in the truth.
    """
    check_kind("answer", answer, Answer | None, "use blurmatte.read_answer(file)")
    check_kind("truth", truth, Truth, "use blurmatte.read_truth(folder)")
    given = answer or Answer(_nothing(truth))
    layer, true = given.layer, truth.layer
    check_same_size("the result", layer.size, "the truth", true.size)
    color = None if given.alpha_only else _color_distance(layer, true)
    iou, psnr, ssim = _motion_scores(given, truth)
    return Score(
        answered=answer is not None,
        alpha_rmse=alpha_rmse(layer.alpha, true.alpha),
        alpha_sad=alpha_sad(layer.alpha, true.alpha),
        alpha_gradient_error=alpha_gradient_error(layer.alpha, true.alpha),
        alpha_sum_bias=alpha_sum_bias(layer.alpha, true.alpha),
        false_alpha=false_alpha(layer.alpha, true.alpha),
        premultiplied_rmse=(
            None if given.alpha_only else premultiplied_rmse(layer.premultiplied, true)
        ),
        color_units=color.units if color else None,
        color_degrees=color.degrees if color else None,
        recomposite_psnr=(
            None if given.alpha_only else recomposite_psnr(layer, true, _turned(truth.plate))
        ),
        alpha_spread=_alpha_spread(given, truth),
        trajectory_iou=iou,
        subframe_psnr=psnr,
        subframe_ssim=ssim,
    )


def mean_score(scores: Sequence[Score]) -> Score:
    """The mean of every number over some scenes, those where it is None left out.

    `answered` tells whether all were. `alpha_sum_bias` is the mean of its sizes, so that too much
    and too little do not cancel. Where a program tells paths or sub-frames in some of the scenes,
    the others are misses: TIoU counts 0 there.

    Raises
    ------
    ValueError
        If there are no scores.
    """
    if not scores:
        raise ValueError("there is nothing to take the mean of")
    for score in scores:
        _check_score(score)
    means = {f.name: _mean(f.name, scores) for f in fields(Score) if f.name != "answered"}
    return Score(answered=all(s.answered for s in scores), **means)  # type: ignore[arg-type]


def score_table(scores: Mapping[str, Score]) -> str:
    """Scores by scene in columns, and their mean; a dash where a program does not tell."""
    rows = [["scene", *_HEADINGS]]
    rows += [[name, *_cells(s)] for name, s in scores.items()]
    if len(scores) > 1:
        rows.append(["mean", *_cells(mean_score(list(scores.values())))])
    told = [i for i in range(len(rows[0])) if any(row[i] != "-" for row in rows[1:])]
    widths = {i: max(len(row[i]) for row in rows) for i in told}
    return "\n".join(
        "  ".join(row[i].ljust(widths[i]) if i == 0 else row[i].rjust(widths[i]) for i in told)
        for row in rows
    )


def _check_score(score: Score) -> None:
    check_kind("a score", score, Score, "use blurmatte.score(answer, truth)")


def _cells(score: Score) -> list[str]:
    _check_score(score)
    return [_cell(getattr(score, name)) for name in _HEADINGS.values()]


def _cell(value: float | bool | None) -> str:
    match value:
        case None:
            return "-"
        case bool():
            return "yes" if value else "miss"
    return f"{value:.4g}"


def _mean(name: str, scores: Sequence[Score]) -> float | None:
    values = [getattr(s, name) for s in scores]
    known = [abs(v) if name == "alpha_sum_bias" else v for v in values if v is not None]
    if not known:
        return None
    return float(np.sum(known)) / (len(values) if name == "trajectory_iou" else len(known))


def _nothing(truth: Truth) -> Layer:
    return Layer(0 * truth.layer.alpha, 0 * truth.layer.premultiplied)


def _turned(plate: LinearImage) -> LinearImage:
    return LinearImage(plate.rgb[:, ::-1])


def _color_distance(layer: Layer, true: Layer) -> ColorDistance | None:
    """Between average colors; None where the answer holds no light."""
    streak = true.alpha > 0
    found, real = (part.premultiplied[streak].sum(axis=0, dtype=float) for part in (layer, true))
    if not found.any():
        return None
    return color_distance(found, real / true.alpha[streak].sum(dtype=float))


def _alpha_spread(answer: Answer, truth: Truth) -> float | None:
    solution = answer.solution
    if solution is None:
        return None
    seen = solution.known & (truth.layer.alpha > 0)
    if not seen.any():
        return None
    return calibration(solution.alpha, solution.alpha_std, truth.layer.alpha, seen).spread


def _motion_scores(answer: Answer, truth: Truth) -> tuple[float | None, float | None, float | None]:
    path = answer.trajectory
    iou = trajectory_iou(path, truth.trajectory, truth.radius) if path else None
    if answer.subframes is None:
        return iou, None, None
    if len(answer.subframes) != len(truth.subframes):
        raise ValueError(
            f"the result has {len(answer.subframes)} sub-frames, the truth {len(truth.subframes)}"
        )
    box = Streak(truth.layer.alpha > 0).around(_MARGIN)
    found, true = (
        np.stack([_coded(frame.over(truth.plate).crop(box).rgb) for frame in frames])
        for frames in (answer.subframes, truth.subframes)
    )
    plate = _coded(truth.plate.crop(box).rgb)
    return iou, subframe_psnr(found, true, plate), subframe_ssim(found, true, plate)


def _coded(light: Floats) -> Floats:
    return np.asarray(np.clip(SRGB.encode(np.clip(light, 0, 1)), 0, 1))

"""The tables of the second truth, made of a journal of outcomes."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from pathlib import Path

import numpy as np
from benchmarks.cycles import calibrate
from benchmarks.cycles.errors import MIN_ALPHA, Z_BOUNDS, Deviations, Errors
from benchmarks.cycles.methods import OURS, methods
from benchmarks.cycles.outcome import JOURNAL, Outcome, read_journal
from benchmarks.cycles.pictures import BLURMATTE, CYCLES, LEARN, OWN, SEALED, TUNE
from benchmarks.cycles.scoring import solving_commit
from benchmarks.table import RESULTS, Cell, Table, require_clean_tree
from benchmarks.table import publish as publish_table
from scipy.special import ndtri

from blurmatte.matting.maps import Grade

ALL = "all"
HONEST = 2  # error over claim, up to which a claim passes
MIN_GAIN = 1e-4  # of the RMSE of alpha, by which another method must be nearer to count
_ORDER = (CYCLES, BLURMATTE, "png", "phone", LEARN, TUNE, SEALED, OWN)
_NOTES = f"""
Scenes rendered by Blender Cycles, a path tracer that shares no code with blurmatte (renderer cycles),
and the harder scenes of blurmatte's own renderer through the same cameras (renderer blurmatte). png:
8 bits with the noise of a sensor; phone: JPEG with chroma subsampling, defocus or sharpening, and a
plate that moved by a fraction of a pixel; the other cameras are named. The streak is where the true
alpha is above {MIN_ALPHA:g}. The truth of Cycles has sampling noise; its standard deviation of alpha,
in the truth.json of each picture, is added in quadrature to the claim before errors are divided by
claims. A rejection is a picture for which the method states why it gives no answer.
"""
_SECOND_TRUTH = f"""
`blurmatte.solve(image, plate)` is given nothing else. pictures: scenes times cameras of the class;
answered: those with an answer; out of time: those without one within the limit. The others are
rejections. RMSE: error of alpha where the streak is known, median and 90 % quantile of the answers.
error/claim: that RMSE over the root mean square of the claimed standard deviations, the part of the
color included, median and largest; <= {HONEST}: fraction of the answers up to this value. sum/sigma:
absolute error of the sum of alpha over its standard deviation, median and largest. degrees: angle
between the estimated and the true mean color, median. false alpha: root mean square of the layer's
alpha where the object never was, median. CPU s: seconds of all threads for a picture, answered or not,
median and largest, after an untimed first call. confirmed, plausible: number of answers of this grade,
and the 95 % quantile of their RMSE.
"""
_METHODS = f"""
All methods get the image and the inputs in `given`; other methods than blurmatte get the plate as
matched to the image by blurmatte. RMSE: error of the layer's alpha over the streak, median and 90 %
quantile of all pictures; a missing answer counts as an empty layer, alpha 0. bias: absolute relative
error of the sum of alpha over the streak, in percent, median. nearer than blurmatte: pictures in which
the RMSE of the method is smaller than that of `blurmatte` by more than {MIN_GAIN:g}, of the pictures
of both (of). first disc: the best disc of one paint of blurmatte's search, correct or not; first disc,
smooth: `Smooth` with the color of that disc. The other names are those of against_other_methods.
"""
_DEVIATIONS = """
z is (estimate - truth) / claimed standard deviation, of the answers of `blurmatte.solve(image,
plate)`. alpha and light: of all pixels of the known streak, except those that claim an error of
exactly 0; light in all channels. sum: of the sum of alpha, one value for each answer. color: of the
mean color, two directions for a line of colors and one for a plane. path (two directions of its mean
position) and radius: of balls with a sweep as the likeliest hypothesis. spread: root mean square of z;
1 is correct, more is overconfident. robust: the same from the median of |z|; within 1 and 2: fractions
of |z|, 0.683 and 0.954 for normal errors. picture median, 99 % and worst: of the root mean square of z
within each picture.
"""


def publish(
    root: Path, sealed: bool = False, folder: Path = RESULTS, commit: str | None = None
) -> None:
    """Make and publish the tables of all outcomes of a commit in the journal of `root`.

    Parameters
    ----------
    root : Path
    sealed : bool
        Whether the sealed part is in them, in rows over all of its kinds.
    folder : Path
        Where to write.
    commit : str, optional
        As `Key.commit` has it; that of the running blurmatte if not given.

    Raises
    ------
    ValueError
        If the journal has no outcomes of that commit.
    DirtyTreeError
        If `folder` is docs/results and the tree differs from its commit.
    """
    require_clean_tree(folder)
    for table in tables(selected(root, sealed, commit)):
        publish_table(table, folder)
    samples = calibrate.read_samples(root / calibrate.JOURNAL)
    if samples:
        publish_table(calibrate.by_kind(samples), folder)


def selected(root: Path, sealed: bool = False, commit: str | None = None) -> list[Outcome]:
    """The outcomes of a commit; of a picture that was rendered again the last.

    Raises
    ------
    ValueError
        If there are none.
    """
    everything = read_journal(root / JOURNAL)
    wanted = commit or solving_commit()
    latest = {
        (o.key.part, o.key.scene, o.key.camera, o.key.method): o
        for o in everything
        if o.key.commit == wanted and (sealed or o.key.part != SEALED)
    }
    if not latest:
        there = ", ".join(sorted({o.key.commit for o in everything})) or "nothing"
        raise ValueError(
            f"{root / JOURNAL} must hold outcomes of commit {wanted}, it holds those of {there}; "
            "score first"
        )
    return list(latest.values())


def tables(outcomes: Sequence[Outcome]) -> list[Table]:
    """The three tables; that of other methods only if there are some."""
    ours = [o for o in outcomes if o.key.method == OURS]
    made = [second_truth(ours), honest_deviations(ours)]
    if len(ours) < len(outcomes):
        made.insert(1, second_truth_methods(outcomes))
    return made


def second_truth(outcomes: Sequence[Outcome]) -> Table:
    """How good answers are, by renderer, camera class and kind, and over each part."""
    shown = [o for o in outcomes if o.key.part != SEALED]
    by_kind = _grouped(shown, lambda o: (o.renderer, o.camera_class, ALL, o.kind))
    by_part = _grouped(outcomes, lambda o: (o.renderer, o.camera_class, o.key.part, ALL))
    groups = sorted((by_kind | by_part).items(), key=lambda item: _order(item[0]))
    return Table(
        "second_truth",
        "How accurate are answers on the scenes of another renderer?",
        _SECOND_TRUTH + _NOTES + _circumstances(outcomes),
        (
            *("renderer", "files", "part", "kind", "pictures", "answered", "out of time"),
            *("RMSE", "RMSE 90 %", "error/claim", "error/claim worst", f"error/claim <= {HONEST}"),
            *("sum/sigma", "sum/sigma worst", "degrees", "false alpha", "CPU s", "CPU s worst"),
            *("confirmed", "confirmed 95 %", "plausible", "plausible 95 %"),
        ),
        [(*group, *_quality(members)) for group, members in groups],
    )


def second_truth_methods(outcomes: Sequence[Outcome]) -> Table:
    """How near other methods are, and in how many pictures nearer."""
    ours = {_picture(o): o.errors.shown_rmse for o in outcomes if o.key.method == OURS}
    groups = _grouped(outcomes, lambda o: (o.renderer, o.camera_class, o.key.method))
    order = [*methods()]
    rows = [
        (*group, *_compared(members, ours))
        for group, members in sorted(
            groups.items(), key=lambda item: (_order(item[0][:2]), order.index(item[0][2]))
        )
    ]
    return Table(
        "second_truth_methods",
        "How accurate are other methods on the scenes of another renderer?",
        _METHODS + _NOTES + _circumstances(outcomes),
        (
            *("renderer", "files", "method", "given", "pictures", "answered", "RMSE", "RMSE 90 %"),
            *("bias %", "CPU s", "nearer than blurmatte", "of"),
        ),
        rows,
    )


def honest_deviations(outcomes: Sequence[Outcome]) -> Table:
    """Whether errors are as large as claimed, by camera and quantity."""
    answered = [o for o in outcomes if o.answered]
    groups = _grouped(answered, lambda o: (o.renderer, o.key.part, o.key.camera))
    rows = [
        (*group, name, *cells)
        for group, members in sorted(groups.items(), key=lambda item: _order(item[0]))
        for name, of in _QUANTITIES.items()
        if (cells := _deviations([found for o in members if (found := of(o.errors))]))
    ]
    return Table(
        "honest_deviations",
        "Are the claimed errors correct on the scenes of another renderer?",
        _DEVIATIONS + _NOTES + _circumstances(outcomes),
        (
            *("renderer", "part", "camera", "quantity", "values", "spread", "robust", "within 1"),
            *("within 2", "pictures", "picture median", "picture 99 %", "picture worst"),
        ),
        rows,
    )


def pooled(parts: Sequence[Deviations]) -> Deviations:
    """Deviations of all values together; `robust` to the width of the intervals of `Z_BOUNDS`.

    Raises
    ------
    ValueError
        If there are none.
    """
    if not parts:
        raise ValueError("parts must be one or more, got none")
    weights = np.array([part.count for part in parts], float)
    counts = np.sum([part.counts for part in parts], axis=0)
    mean = partial(np.average, weights=weights)
    return Deviations(
        int(weights.sum()),
        float(np.sqrt(mean([part.rms**2 for part in parts]))),
        _median(counts) / float(ndtri(0.75)),
        float(mean([part.within_1 for part in parts])),
        float(mean([part.within_2 for part in parts])),
        tuple(counts.tolist()),
    )


def _median(counts: np.ndarray) -> float:
    """That of values counted between `Z_BOUNDS`, taken to be spread evenly between two of them."""
    bounds = np.concatenate([[0.0], Z_BOUNDS])
    below = np.concatenate([[0], np.cumsum(counts[:-1])])
    return float(np.interp(counts.sum() / 2, below, bounds))


def _deviations(pictures: list[Deviations]) -> tuple[Cell, ...]:
    """Cells of a quantity; none if no picture has it."""
    if not pictures:
        return ()
    z, spreads = pooled(pictures), [picture.rms for picture in pictures]
    return (
        *(z.count, z.rms, z.robust, z.within_1, z.within_2),
        *(len(pictures), _quantile(spreads, 0.5), _quantile(spreads, 0.99), max(spreads)),
    )


def _values(*z: float | None) -> Deviations | None:
    return Deviations.of(np.array([value for value in z if value is not None]))


_QUANTITIES: dict[str, Callable[[Errors], Deviations | None]] = {
    "alpha": lambda errors: errors.alpha,
    "light": lambda errors: errors.light,
    "sum": lambda errors: _values(errors.sum_z),
    "color": lambda errors: _values(*errors.color_z),
    "path": lambda errors: _values(*errors.path_z),
    "radius": lambda errors: _values(errors.radius_z),
}


def _quality(outcomes: list[Outcome]) -> tuple[Cell, ...]:
    """Cells of a row of `second_truth` behind the names of the group."""
    errors = [o.errors for o in outcomes if o.answered]
    rmse, ratios = (_known(e.alpha_rmse for e in errors), _known(e.ratio for e in errors))
    sums = [abs(z) for z in _known(e.sum_z for e in errors)]
    seconds = _known(o.cpu_seconds for o in outcomes)
    return (
        *(len(outcomes), len(errors), sum(o.out_of_time for o in outcomes)),
        *(_quantile(rmse, 0.5), _quantile(rmse, 0.9), _quantile(ratios, 0.5), _quantile(ratios, 1)),
        float(np.mean([ratio <= HONEST for ratio in ratios])) if ratios else None,
        *(_quantile(sums, 0.5), _quantile(sums, 1)),
        _quantile(_known(e.color_degrees for e in errors), 0.5),
        _quantile([e.false_alpha for e in errors], 0.5),
        *(_quantile(seconds, 0.5), _quantile(seconds, 1)),
        *_of_grade(outcomes, Grade.CONFIRMED),
        *_of_grade(outcomes, Grade.PLAUSIBLE),
    )


def _of_grade(outcomes: list[Outcome], grade: Grade) -> tuple[Cell, Cell]:
    """How many pictures have a grade, and the 95 % quantile of their RMSE."""
    rmse = _known(o.errors.alpha_rmse for o in outcomes if o.grade == grade)
    return len(rmse), _quantile(rmse, 0.95)


def _compared(outcomes: list[Outcome], ours: dict[tuple[str, str, str], float]) -> tuple[Cell, ...]:
    """Cells of a row of `second_truth_methods` behind the names of the group."""
    name = outcomes[0].key.method
    rmse = [o.errors.shown_rmse for o in outcomes]
    both = [(o.errors.shown_rmse, ours[_picture(o)]) for o in outcomes if _picture(o) in ours]
    nearer = None if name == OURS else sum(other < own - MIN_GAIN for other, own in both)
    return (
        methods()[name].given,
        *(len(outcomes), sum(o.answered for o in outcomes)),
        *(_quantile(rmse, 0.5), _quantile(rmse, 0.9)),
        _quantile([100 * abs(o.errors.shown_bias) for o in outcomes], 0.5),
        _quantile(_known(o.cpu_seconds for o in outcomes), 0.5),
        *(nearer, None if nearer is None else len(both)),
    )


def _circumstances(outcomes: Sequence[Outcome]) -> str:
    """Parts, limit and commit of the outcomes, in sentences."""
    parts = sorted({o.key.part for o in outcomes}, key=lambda part: _order((part,)))
    limits = " or ".join(f"{limit:g}" for limit in sorted({o.limit for o in outcomes}))
    commits = ", ".join(sorted({o.key.commit for o in outcomes}))
    held = "" if SEALED in parts else f"; {SEALED} is held back"
    return (
        f"Parts: {', '.join(parts)}{held}. Limit for a picture: {limits} CPU s. "
        f"The solver was last changed in commit {commits}."
    )


def _grouped(
    outcomes: Iterable[Outcome], group: Callable[[Outcome], tuple[str, ...]]
) -> dict[tuple[str, ...], list[Outcome]]:
    groups: dict[tuple[str, ...], list[Outcome]] = {}
    for outcome in outcomes:
        groups.setdefault(group(outcome), []).append(outcome)
    return groups


def _order(names: tuple[str, ...]) -> tuple[tuple[int, str], ...]:
    """Known names in their order, others between them and `ALL`, by the alphabet."""
    known = {name: place for place, name in enumerate(_ORDER)} | {ALL: len(_ORDER) + 1}
    return tuple((known.get(name, len(_ORDER)), name) for name in names)


def _picture(outcome: Outcome) -> tuple[str, str, str]:
    return outcome.key.part, outcome.key.scene, outcome.key.camera


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _quantile(values: Sequence[float], q: float) -> float | None:
    return float(np.quantile(values, q)) if values else None

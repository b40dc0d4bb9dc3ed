"""fit_sweep: image, plate and streak → Sweep.

The fits of all `HYPOTHESES` are compared in one observation; `Hypotheses` holds them with their
weights, `fit_sweep` returns the likeliest.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

from threadpoolctl import threadpool_limits

from blurmatte.calibration import with_noise
from blurmatte.checks import check_kind
from blurmatte.color.model import ColorModel
from blurmatte.color.shadows import check_no_shadow, may_be_shadow
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import Streak, check_streak, require_streaks, without_faint
from blurmatte.sweep.assess.model_selection import Hypotheses
from blurmatte.sweep.candidates import FitRequest
from blurmatte.sweep.fit.multistart import Multistart
from blurmatte.sweep.fit.ranking import explained_fraction
from blurmatte.sweep.hypotheses import HYPOTHESES, Hypothesis, TimeLimit, quick_search
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.priors import MotionPrior, OpacityPrior
from blurmatte.sweep.other_light import in_likelier_light
from blurmatte.sweep.sweep import Sweep

_MAX_STREAKS = 5  # that are compared
_MAX_SOLID_BLUR = 0.1  # blur of the rim over the radius; shadows are softer


def fit_sweep(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak | None = None,
    model: ColorModel | None = None,
    *,
    start: Sweep | None = None,
) -> Sweep:
    """Find path, silhouette and color of an object from its streak.

    The likeliest of a disc, an outline, and a disc with the shadow that it casts, on the likeliest
    path. `Sweep.diagnostics` and `Sweep.rejection` assess the fit.

    Parameters
    ----------
    image, plate : LinearImage
        With the object, and without; same size.
    streak : Streak, optional
        Where it moved. If not given, the likeliest streak.
    model : ColorModel, optional
        Prior of the color with its covariance.
    start : Sweep, optional
        Of another frame of a clip, with about the same path elsewhere; a faster start of the fit.

    Returns
    -------
    Sweep

    Raises
    ------
    ColorModelError
        If no model was given and the streak only took light: it may be a shadow.
    MotionError
        If nothing moved.
    ValueError
        If the sizes differ.

    Examples
    --------
    >>> sweep = bm.sweep.fit_sweep(image, plate, streak)
    >>> print(sweep)
    Sweep(disc on a line, 59.6 px long, radius 10.01 ± 0.01 px, #ffc046, rank 1)
    """
    check_streak("streak", streak)
    check_kind("model", model, ColorModel | None, 'use blurmatte.ColorModel.from_hex("#d8ff3c")')
    check_kind("start", start, Sweep | None, "use blurmatte.sweep.fit_sweep(image, plate)")
    image, plate = with_noise(image, plate)
    if streak is None:
        streak = likeliest_streak(image, plate, require_streaks(image, plate), model)
    return fit_hypotheses(image, plate, streak, model, start).best.with_assumed_error


def likeliest_streak(
    image: LinearImage,
    plate: LinearImage,
    streaks: Sequence[Streak],
    model: ColorModel | None = None,
) -> Streak:
    """The streak with the most evidence that a disc explains, less that which it does not explain.

    A moving person may change more pixels than a ball, but no disc explains them. So may a shadow,
    which moves with its object: streaks that add light are preferred.

    image, plate: noise known.
    streaks: the strongest first, which is returned if a disc explains none by more than half.
    model: prior of the color.
    """
    strong = without_faint(streaks[:_MAX_STREAKS])
    if len(strong) < 2:
        return streaks[0]
    is_rough = plate.meta.guess_error is not None  # a loss of light may be texture
    lit = [] if is_rough else [one for one in strong if not may_be_shadow(image, plate, one)]
    scored: list[tuple[float, Streak]] = []
    for streak in lit or strong:
        search = quick_search(streak, image, plate, ColorPrior.of(model).of_one_paint)
        explained = explained_fraction(search.quick())
        scored.append((streak.evidence * (2 * explained - 1), streak))
    score, likeliest = max(scored, key=lambda one: one[0])
    return likeliest if score > 0 else (lit or strong)[0]


def fit_hypotheses(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    model: ColorModel | None = None,
    start: Sweep | None = None,
    prior: MotionPrior | None = None,
    hypotheses: Sequence[Hypothesis] = HYPOTHESES,
    seconds: float = math.inf,
    opacity: OpacityPrior = OpacityPrior.USUAL,
) -> Hypotheses:
    """Hypotheses about pictures whose noise is known; parameters as for `fit_sweep` and `solve`.

    Before the plate as it is or, if a hypothesis changes the plate, in the light that the object left
    on it if that is decisively likelier. After `seconds` of CPU time the first is fitted only.
    """

    def search(streak: Streak, image: LinearImage, plate: LinearImage) -> Multistart:
        """Fits before a plate."""
        search = Multistart.of(streak, image, plate, ColorPrior.of(model)).with_prior(prior)
        return search.with_observations(lambda one: replace(one, opacity=opacity))

    request = FitRequest(image, search, start, hypotheses, TimeLimit(seconds))
    with threadpool_limits(1):  # the matrices are small: threads wait longer than they work
        candidates = request.candidates(request.begun(plate, streak))
        # Without hues a dark object looks like a loss of light.
        if any(one.changes_plate for one in hypotheses) and not image.meta.one_channel:
            candidates = in_likelier_light(candidates, request)
        found = candidates.refined(request.limit if len(hypotheses) > 1 else None)
    # Nobody can give the color of a black thing in a gray picture.
    may_be_texture = plate.meta.guess_error is not None
    if model is None and not (image.meta.one_channel or may_be_texture or _is_solid(found.best)):
        check_no_shadow(image, plate, streak)
    return found


def _is_solid(sweep: Sweep) -> bool:
    """True if its rim is sharper than that of a soft shadow."""
    known = sweep.diagnostics
    return not known.rejection and known.blur_over_radius < _MAX_SOLID_BLUR

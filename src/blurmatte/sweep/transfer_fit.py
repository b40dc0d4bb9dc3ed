"""fit_transfer: which transfer curves a streak allows.

Light mixes linearly, code values do not. With a wrong curve the residuals across the color are
correlated along every rim; before a plate of one color this may not be observable.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy

from blurmatte.calibration import with_noise
from blurmatte.checks import Array, Bools, check_kind
from blurmatte.errors import PlateError
from blurmatte.radiometry import LINEAR, REC709, SRGB, LinearImage, Transfer, check_picture, gamma
from blurmatte.radiometry.transfer import TRANSFER_HINT
from blurmatte.streaks import Streak, check_streak, require_streaks
from blurmatte.sweep.fit.levenberg_marquardt import ROUGH_TOLERANCE, minimize
from blurmatte.sweep.fit.multistart import Multistart
from blurmatte.sweep.fitting_size import FittingSize
from blurmatte.sweep.model.color_field import ColorPrior
from blurmatte.sweep.model.observation import Observation
from blurmatte.sweep.model.state import State
from blurmatte.sweep.sweep import Sweep

CURVES = SRGB, REC709, gamma(1.8), gamma(2.2), gamma(2.6), LINEAR
UNSTATED_CURVES = REC709, SRGB, gamma(2.2)  # of clips and pictures that state none

# Variance inflation: of curves that cannot be preferred, over the least; and of residuals that no disc
# of one color explains with any curve.
_MAX_INFLATION_RATIO, _MAX_EXPLAINED_INFLATION = 1.3, 2.0


@dataclass(frozen=True)
class TransferFit:
    """Variance inflation of a streak's residuals for several transfer curves.

    Parameters
    ----------
    curves : sequence of Transfer
        The curve that the pictures were decoded with, then the others.
    left : sequence of float
        Variance inflation of the residuals of the best disc of one color with each; 1 is noise.

    Examples
    --------
    >>> fit = bm.sweep.TransferFit((bm.SRGB, bm.LINEAR), (1.1, 25.0))
    >>> fit.best, len(fit.possible)
    (Transfer(srgb), 1)
    """

    curves: Sequence[Transfer]
    left: Sequence[float]

    @property
    def possible(self) -> tuple[Transfer, ...]:
        """The curves that explain the streak, the best first; all if none does."""
        order = sorted(zip(self.left, self.curves, strict=True), key=lambda pair: pair[0])
        smallest, _ = order[0]
        limit = _MAX_INFLATION_RATIO * max(smallest, 1)
        if smallest > _MAX_EXPLAINED_INFLATION:
            limit = np.inf
        return tuple(curve for inflation, curve in order if inflation <= limit)

    @property
    def best(self) -> Transfer:
        """The curve that the pictures were decoded with if it is possible, else the likeliest."""
        return self.curves[0] if self.curves[0] in self.possible else self.possible[0]


def fit_transfer(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak | None = None,
    curves: Sequence[Transfer] = CURVES,
) -> TransferFit:
    """Try transfer curves on a streak.

    Parameters
    ----------
    image, plate : LinearImage
        Read from files with code values, with one curve; of the same size.
    streak : Streak, optional
        Where the object moved; the strongest of `find_streaks` if not given. It should be round and
        of one color.
    curves : sequence of Transfer
        Tried in addition to the curve that the pictures were decoded with.

    Returns
    -------
    TransferFit

    Raises
    ------
    PlateError
        If the pictures hold light that was never encoded, or were decoded with different curves.
    MotionError
        If nothing moved.

    Examples
    --------
    >>> fit = bm.sweep.fit_transfer(image, plate, streak, curves=(bm.SRGB, bm.LINEAR))
    >>> fit.best
    Transfer(srgb)
    """
    check_picture("image", image)
    check_picture("plate", plate)
    check_streak("streak", streak)
    for curve in curves:
        check_kind("a curve", curve, Transfer, TRANSFER_HINT)
    declared, other = image.meta.transfer, plate.meta.transfer
    if declared is None or other is None or declared.name != other.name:
        raise PlateError(
            "image and plate must be files of code values that were decoded with one curve, got "
            f"{declared} and {other}; give both with the same transfer"
        )
    if streak is None:
        streak = require_streaks(*with_noise(image, plate))[0]
    return _fitted(image, plate, streak, curves)


def _fitted(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak,
    curves: Sequence[Transfer],
    enough: float = 0.0,
) -> TransferFit:
    """The fit of curves; of that of the pictures alone if it leaves no more inflation than enough.

    Paths and shapes with the other curves are searched from those with that one.
    """
    declared, (search, disc) = image.meta.transfer, _disc_in(image, plate, streak)
    assert declared is not None
    tried, left = [declared], [_inflation_of_one_color(disc, search.bounds)]
    for curve in curves if left[0] > enough else ():
        if curve.name != declared.name:
            again = search.with_observations(partial(_decoded_with, curve, assumed=declared))
            other = again.of_one_paint.near(disc.family, disc.curve, disc.radius)
            tried.append(curve)
            left.append(_inflation_of_one_color(other, search.bounds))
    return TransferFit(tried, left)


def fit_of_doubted_curve(
    image: LinearImage, plate: LinearImage, moved: Bools, sweep: Sweep | None
) -> TransferFit | None:
    """The fit of curves if a disc of one color explains a streak, but not with that of the pictures.

    None if a sweep that was accepted is such a disc, before a guess, and for pictures of two curves.
    """
    curves = image.meta.transfer, plate.meta.transfer
    alike = None not in curves and len({curve.name for curve in curves if curve}) == 1
    if not alike or plate.is_guess:
        return None
    accepted = None if sweep is None or sweep.rejection else sweep
    shape = accepted.silhouette if accepted is not None and accepted.model.rank == 1 else None
    if shape is not None and shape.is_disc and not shape.has("rates"):
        return None
    fit = _fitted(image, plate, Streak(moved), CURVES, enough=_MAX_INFLATION_RATIO)
    return None if fit.best is fit.curves[0] else fit


def _disc_in(image: LinearImage, plate: LinearImage, streak: Streak) -> tuple[Multistart, State]:
    """The search for discs of any color in a streak, on cells of a wide one, and the best disc."""
    image, plate = with_noise(image, plate)
    size = FittingSize.of(streak)
    if size is not None:
        image, plate = size.pictures(image, plate, streak, measured=True)
        streak = size.streak(streak)
    search = Multistart.of(streak, image, plate, ColorPrior(np.eye(3)))
    return search, search.best_of_one_paint()


def _inflation_of_one_color(disc: State, bounds: tuple[float, float]) -> float:
    """Variance inflation of the residuals of a disc if all of its light has one direction."""
    one_color = replace(disc.observation.color, rank=1)
    disc = disc.on(replace(disc.observation, color=one_color))
    return minimize(disc, bounds).variance_inflation


def with_curve(
    image: LinearImage, plate: LinearImage, curve: Transfer
) -> tuple[LinearImage, LinearImage]:
    """Image and plate decoded with another curve than that of the image; their noise is measured."""
    declared = image.meta.transfer
    assert declared is not None
    plate = replace(plate, meta=replace(plate.meta, transfer=declared))
    return with_noise(_decoded_again(image, curve), _decoded_again(plate, curve))


def curve_covariance(
    state: State, others: Sequence[Observation], bounds: tuple[float, float]
) -> Array:
    """Covariance of path and shape by the curve of an image that does not state it.

    Where light is half the object's is elsewhere with another curve: the rim moves all along the path,
    and no residuals show it. The covariance is the mean of d dᵀ over the curves, where d is the change
    of the parameters. A curve that leaves residuals much more correlated than the assumed one is
    excluded.

    Parameters
    ----------
    state : State
        Fitted with the assumed curve.
    others : sequence of Observation
        The same pixels decoded with other curves; see `with_unstated_curves`.
    bounds : (float, float)
        Of the radius, pixels.

    Returns
    -------
    (n, n) float
    """
    first = minimize(state, bounds, tolerance=ROUGH_TOLERANCE)
    limit = _MAX_INFLATION_RATIO * first.variance_inflation
    changes = [np.zeros(first.size)]
    for observation in others:
        other = minimize(first.relit(observation), bounds, tolerance=ROUGH_TOLERANCE)
        if other.variance_inflation <= limit:
            changes.append(np.concatenate([other.path - first.path, other.shape - first.shape]))
    D = np.array(changes)
    return np.asarray(D.T @ D / len(D))


def with_unstated_curves(observation: Observation, assumed: Transfer) -> list[Observation]:
    """An observation decoded with each other curve that pictures without a stated one may have."""
    others = (curve for curve in UNSTATED_CURVES if curve.name != assumed.name)
    return [_decoded_with(curve, observation, assumed) for curve in others]


def _decoded_with(curve: Transfer, observation: Observation, assumed: Transfer) -> Observation:
    """An observation of pictures decoded with another curve than the assumed one.

    Noise and errors of color, being small, are multiplied by the slope of the change. It is smoothed
    as noise is, which must not depend on that of its own pixel.
    """

    def decoded(light: Array) -> tuple[Array, Array]:
        """The light, and the slope of its change."""
        again = np.asarray(curve.decode(assumed.encode(light)), float)
        slope = np.maximum(curve.slope(again), 1e-6) / np.maximum(assumed.slope(light), 1e-6)
        return np.ascontiguousarray(again), np.asarray(
            scipy.ndimage.gaussian_filter(slope, (2.0, 2.0, 0))
        )

    lights = observation.rgb(observation.C), observation.rgb(observation.B)
    (C, of_image), (B, of_plate) = map(decoded, lights)
    if observation.guess_error is not None:  # its channels have no curves of their own
        of_image, of_plate = (one.mean(axis=-1, keepdims=True) for one in (of_image, of_plate))
    error = observation.chroma_error
    return replace(
        observation,
        C=observation.of_rgb(C),
        B=observation.of_rgb(B),
        C_variance=of_image**2 * observation.C_variance,
        B_variance=of_plate**2 * observation.B_variance,
        chroma_error=None if error is None else of_image * error,
    )


def _decoded_again(picture: LinearImage, curve: Transfer) -> LinearImage:
    """The picture decoded with another curve; its noise is unknown."""
    declared = picture.meta.transfer
    assert declared is not None
    rgb = curve.decode(declared.encode(picture.rgb)).astype(picture.rgb.dtype)
    return LinearImage(
        np.asarray(rgb), valid=picture.valid, meta=replace(picture.meta, transfer=curve)
    )

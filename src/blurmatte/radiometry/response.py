"""fit_response: a camera's own curve, from pictures of one still scene with different exposures.

In this file v is a code value, 0…1, and G(v) the light that makes it, in any unit. A place of light x
has in a picture of exposure time t the code value

    v = f(t x) + noise,    f = G⁻¹,    G(v) = -b + ∫₀ᵛ exp(h),

where h is held to what cameras do (`response_prior`), b is the black level, and each t may be off by
a few percent. All are found together: x is eliminated place by place (variable projection), the rest
follows by Gauss-Newton from the residuals in code values. The posterior's covariance is the error.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Bools
from blurmatte.errors import ResponseError
from blurmatte.radiometry.bracket import Bracket, Places
from blurmatte.radiometry.image import LinearImage
from blurmatte.radiometry.response_prior import CELLS, ResponsePrior, response_prior
from blurmatte.radiometry.transfer import TABLE, Transfer

Array = npt.NDArray[np.float64]

_CODES = np.arange(CELLS + 1) / CELLS
_BLACK_STD = 0.003  # of full scale: what black levels of 0 to 16 of 255 are, and of log curves
_MARGIN = 4.0  # sigmas from the ends of the range, and from the neighbors
_REJECTED = 1e-4  # chance at which a good place is called an outlier
_ROUNDS = 25
_LONGEST = 2.0  # step, in standard deviations of the prior
_DONE = 0.02
_SEARCHED = 1500  # places on which all curves of the family are tried
_MOST_WRONG = 0.5  # share of places that may disagree
_CLEAR = 3.0  # sigmas by which the channels must differ to be called different
_GROUPS = 16  # of code values, for the residuals


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A camera's curve, and how well the pictures agree with it.

    Parameters
    ----------
    transfer : Transfer
        The curve; code value 1 is light 1.
    std : (256,) float
        Standard deviation of the light of the code values 0, 1/255 … 1, as a fraction of full scale.
    exposure_times : tuple of float
        Seconds, rising, as the pictures have them among themselves; their geometric mean is that of
        the given ones.
    noise : float
        Standard deviation of a code value, as a fraction of full scale.
    agreement : float
        Share of the places looked at that agree with the curve; the rest moved, or are no light.
    seen : tuple of two floats
        Lowest and highest code value that two pictures shared; beyond them the curve is a continuation.
    channel_difference : tuple of three floats
        How far the curve of each channel alone is from the common one at most, fraction of full scale.
    channels_agree : bool
        No channel differs by more than the errors.
    residuals : (pictures, 16) float
        Mean of code value minus what the curve says, for sixteenths of the code values; NaN: not seen.
    """

    transfer: Transfer
    std: Array
    exposure_times: tuple[float, ...]
    noise: float
    agreement: float
    seen: tuple[float, float]
    channel_difference: tuple[float, float, float]
    channels_agree: bool
    residuals: Array

    def __repr__(self) -> str:
        return (
            f"ResponseFit({len(self.exposure_times)} pictures, light known to "
            f"{np.max(self.std):.2%} of full scale, {self.agreement:.0%} of the places agree)"
        )


def fit_response(
    pictures: Sequence[LinearImage],
    exposure_times: Sequence[float] | None = None,
    time_std: float = 0.02,
) -> ResponseFit:
    """Measure a camera's curve from two or more pictures of one still scene, exposed differently.

    Aperture, ISO and white balance must be the same in all. One curve is found for all channels: a
    factor of each channel is white balance, and changes no alpha. The scale of light cannot be known;
    code value 1 is light 1.

    Parameters
    ----------
    pictures : sequence of LinearImage
        The same size; code values as they are, read with `read(path, LINEAR)`.
    exposure_times : sequence of float, optional
        Seconds, one for each picture; those of the files, if not given.
    time_std : float
        Relative standard deviation of the exposure times. Files tell nominal ones: 1/60 where a
        shutter that halves and doubles gives 1/64. 0: they are exact.

    Returns
    -------
    ResponseFit

    Raises
    ------
    ValueError, TypeError
        If there are fewer than two pictures, sizes differ, times are missing, alike or impossible.
    ResponseError
        If the pictures do not determine a curve: they are clipped, have no code values in common, or
        show no still scene.

    Notes
    -----
    The model of cameras is in the manner of [1]_. Ratios of exposure alone fix the curve [2]_: with
    times that are wrong by one power, 1/60 for 1/64 and 1 for 1, it is wrong by that power.

    References
    ----------
    .. [1] M. D. Grossberg, S. K. Nayar: Modeling the Space of Camera Response Functions.
       PAMI 26 (10), 2004.
    .. [2] M. D. Grossberg, S. K. Nayar: Determining the Camera Response from Images: What Is Knowable?
       PAMI 25 (11), 2003.
    """
    if not (np.isfinite(time_std) and 0 <= time_std <= 1):
        raise ValueError(f"time_std must lie between 0 and 1, got {time_std}")
    bracket = Bracket.of(pictures, exposure_times, time_std)
    channels = bracket.places()
    everything = Places.joined(channels)
    everything.check_shared(bracket)
    fit = _fit(everything, bracket)
    if fit.agreement < _MOST_WRONG:
        raise ResponseError(
            f"only {fit.agreement:.0%} of the places agree with any curve: the camera or the scene "
            "moved, the light changed, or the camera treats each picture differently; use a tripod, "
            "and set exposure, ISO and white balance by hand"
        )
    difference, agree = _compared(fit, channels, bracket)
    return ResponseFit(
        Transfer.from_table("response", np.interp(np.linspace(0, 1, TABLE), _CODES, fit.light)),
        fit.light_std,
        tuple((bracket.times * np.exp(fit.state.shifts - fit.state.shifts.mean())).tolist()),
        fit.noise,
        fit.agreement,
        fit.seen,
        difference,
        agree,
        fit.residuals,
    )


@dataclass(frozen=True, eq=False)
class _State:
    """All that is fitted: coefficients of h, black level in its standard deviations, log times."""

    prior: ResponsePrior
    z: Array
    black: float
    shifts: Array

    @property
    def slopes(self) -> Array:
        """(CELLS,) of G."""
        slopes: Array = np.exp(self.prior.mean + self.prior.basis @ self.z)
        return slopes

    @property
    def light(self) -> Array:
        """(CELLS + 1,) G at the code values between the cells."""
        rising = np.concatenate([[0], np.cumsum(self.slopes)]) / CELLS
        return np.asarray(rising - _BLACK_STD * self.black)

    @property
    def derivatives(self) -> Array:
        """(CELLS + 1, rank + 1) of G by z and black."""
        by_z = np.cumsum(self.prior.basis * self.slopes[:, None], axis=0) / CELLS
        by_z = np.concatenate([np.zeros((1, len(self.z))), by_z])
        return np.concatenate([by_z, np.full((CELLS + 1, 1), -_BLACK_STD)], axis=1)

    def moved(self, step: Array, time_std: float) -> "_State":
        rank = len(self.z)
        return _State(
            self.prior,
            self.z + step[:rank],
            self.black + float(step[rank]),
            self.shifts + time_std * step[rank + 1 :],
        )


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Code values as a state has them, the light of each place as they agree best."""

    codes: Array  # (N, pictures)
    slopes: Array  # (N, pictures) of G there
    flow: Array  # (N, pictures) change of light by log time


@dataclass(frozen=True, eq=False)
class _Fit:
    state: _State
    light: Array
    light_std: Array
    noise: float
    agreement: float
    seen: tuple[float, float]
    residuals: Array


def _predicted(state: _State, v: Array, times: Array, usable: Bools) -> _Prediction:
    """Least squares for the light of each place, in code values."""
    G, slopes, t = state.light, state.slopes, times * np.exp(state.shifts)

    def at(codes: Array) -> Array:
        return np.asarray(slopes[np.clip((codes * CELLS).astype(int), 0, CELLS - 1)])

    weight = np.where(usable, t / at(v), 0) ** 2
    total = np.maximum(weight.sum(axis=1), 1e-300)
    x = np.maximum(np.sum(weight * np.interp(v, _CODES, G) / t, axis=1) / total, 1e-9)
    codes = _encoded(x[:, None] * t, G, slopes)
    for _ in range(4):
        pull = np.where(usable, t / at(codes), 0)
        step = np.sum(pull * (v - codes), axis=1) / np.maximum(np.sum(pull**2, axis=1), 1e-300)
        x = np.clip(x + step, x / 2, x * 2)
        codes = _encoded(x[:, None] * t, G, slopes)
    return _Prediction(codes, at(codes), x[:, None] * t)


def _encoded(light: Array, G: Array, slopes: Array) -> Array:
    codes = np.interp(light, G, _CODES)
    codes = np.where(light > G[-1], 1 + (light - G[-1]) / slopes[-1], codes)
    return np.where(light < G[0], (light - G[0]) / slopes[0], codes)


def _squares(places: Places, codes: Array, usable: Bools) -> tuple[Array, Array]:
    """Sum of squared residuals of each place that two pictures share, and its degrees of freedom."""
    count = usable.sum(axis=1)
    residual = np.where(usable, places.codes - codes, 0)
    return np.sum(residual**2, axis=1)[count >= 2], count[count >= 2] - 1.0


def _quantile(dof: Array, share: float) -> Array:
    from scipy.special import gammaincinv

    return np.asarray(2 * gammaincinv(dof / 2, share))


def _start(places: Places, bracket: Bracket) -> _State:
    """The curve of the family that leaves the least."""
    prior = response_prior()
    some = places.some(_SEARCHED)
    usable = some.usable(_MARGIN * bracket.rounding)

    def left(state: _State) -> float:
        codes = _predicted(state, some.codes, bracket.ratios, usable).codes
        squares, _ = _squares(some, codes, usable)
        return float(np.sum(np.minimum(squares, 9 * np.median(squares))))

    still = np.zeros(len(bracket.ratios))
    return min((_State(prior, z, 0.0, still) for z in prior.members), key=left)


def _fit(places: Places, bracket: Bracket, start: _State | None = None) -> _Fit:
    state, margin = start or _start(places, bracket), _MARGIN * bracket.rounding
    for _ in range(_ROUNDS):
        usable = places.usable(margin)
        prediction = _predicted(state, places.codes, bracket.ratios, usable)
        squares, dof = _squares(places, prediction.codes, usable)
        if len(squares) == 0:
            raise ResponseError(
                "the pictures are too noisy, or show too much detail, to compare them; "
                "average several of each exposure, or photograph something with plain surfaces"
            )
        noise = max(float(np.median(squares / _quantile(dof, 0.5))) ** 0.5, bracket.rounding)
        good = squares <= noise**2 * _quantile(dof, 1 - _REJECTED)
        kept = np.flatnonzero(usable.sum(axis=1) >= 2)[good]
        step, covariance = _step(state, places, prediction, usable, kept, noise, bracket.time_std)
        size = float(np.abs(step).max())
        best = _shortened(
            state, step * min(1, _LONGEST / size), places, usable, kept, noise, bracket
        )
        margin, state = _MARGIN * noise, best
        if size < _DONE:
            break
    light, light_std = _normalized(state, covariance)
    shown = usable[kept]
    seen = places.codes[kept][shown]
    agreement = len(kept) / max(len(squares), 1)
    residuals = _grouped(places.codes[kept] - prediction.codes[kept], prediction.codes[kept], shown)
    ends = float(seen.min()), float(seen.max())
    return _Fit(state, light, light_std, noise, agreement, ends, residuals)


def _step(
    state: _State,
    places: Places,
    prediction: _Prediction,
    usable: Bools,
    kept: npt.NDArray[np.intp],
    noise: float,
    time_std: float,
) -> tuple[Array, Array]:
    """Gauss-Newton step in units of the prior, and the covariance of what is fitted."""
    weight = np.where(usable[kept], 1 / (prediction.slopes[kept] * noise), 0)
    table = state.derivatives
    where = np.clip(prediction.codes[kept], 0, 1) * CELLS
    cell = np.minimum(where.astype(int), CELLS - 1)
    part = (where - cell)[..., None]
    of_curve = table[cell] * (1 - part) + table[cell + 1] * part
    flow = prediction.flow[kept]
    of_times = -flow[..., None] * np.eye(flow.shape[1]) * time_std
    J = np.concatenate([of_curve, of_times], axis=-1) * weight[..., None]
    # What a change of the place's own light could do as well says nothing: project it out.
    along = flow * weight
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    J -= along[..., None] * np.einsum("nm,nmp->np", along, J)[:, None]
    residual = np.where(usable[kept], places.codes[kept] - prediction.codes[kept], 0) / noise
    residual -= along * np.sum(along * residual, axis=1, keepdims=True)
    J = J.reshape(-1, J.shape[-1])
    normal = J.T @ J + np.eye(J.shape[1])
    shifts = state.shifts / time_std if time_std else state.shifts
    now = np.concatenate([state.z, [state.black], shifts])
    return np.linalg.solve(normal, -(J.T @ residual.ravel()) - now), np.linalg.inv(normal)


def _shortened(
    state: _State,
    step: Array,
    places: Places,
    usable: Bools,
    kept: npt.NDArray[np.intp],
    noise: float,
    bracket: Bracket,
) -> _State:
    """Where the step leads, halved until less is left than before; the old state if nothing helps."""

    def cost(candidate: _State) -> float:
        v, shown = places.codes[kept], usable[kept]
        codes = _predicted(candidate, v, bracket.ratios, shown).codes
        shifts = candidate.shifts / (bracket.time_std or 1)
        away = np.sum(candidate.z**2) + candidate.black**2 + np.sum(shifts**2)
        return float(np.sum(np.where(shown, v - codes, 0) ** 2) / noise**2 + away)

    before = cost(state)
    for _ in range(8):
        candidate = state.moved(step, bracket.time_std)
        if cost(candidate) < before:
            return candidate
        step = step / 2
    return state


def _normalized(state: _State, covariance: Array) -> tuple[Array, Array]:
    """Light that is 1 at code value 1, and its standard deviation."""
    G, J = state.light, state.derivatives
    light = G / G[-1]
    J = (J - light[:, None] * J[-1]) / G[-1]
    count = J.shape[1]
    variance = np.einsum("kp,pq,kq->k", J, covariance[:count, :count], J)
    return light, np.sqrt(np.maximum(variance, 0))


def _grouped(residual: Array, codes: Array, shown: Bools) -> Array:
    """(pictures, groups) mean residual by code value; NaN where there is none."""
    group = np.clip((codes * _GROUPS).astype(int), 0, _GROUPS - 1)
    means = np.full((codes.shape[1], _GROUPS), np.nan)
    for picture, number in np.ndindex(*means.shape):
        inside = shown[:, picture] & (group[:, picture] == number)
        if inside.any():
            means[picture, number] = residual[inside, picture].mean()
    return means


def _compared(
    fit: _Fit, channels: Sequence[Places], bracket: Bracket
) -> tuple[tuple[float, float, float], bool]:
    """How far each channel's own curve is from the common one; whether that is within the errors."""
    if len(channels) == 1:
        return (0.0, 0.0, 0.0), True
    differences, agree = [], True
    for places in channels:
        own = _fit(places, bracket, fit.state) if places.shared() else fit
        difference = np.abs(own.light - fit.light)
        differences.append(float(difference.max()))
        agree &= bool(np.all(difference <= _CLEAR * np.hypot(own.light_std, fit.light_std) + 1e-12))
    red, green, blue = differences
    return (red, green, blue), agree

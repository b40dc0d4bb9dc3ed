"""fit_response: a camera's response, from pictures of one still scene with different exposures.

In this file v is a code value, 0…1, and G(v) its light, in any unit. A place of light x has in a
picture of exposure time t the code value

    v = f(t x) + noise,    f = G⁻¹,    G(v) = -b + ∫₀ᵛ exp(h),

where h has an empirical prior (`response_prior`), b is the black level, and each t has an error of a
few percent. All are fitted jointly: x is eliminated place by place (variable projection), the other
parameters follow by Gauss-Newton steps from the residuals of code values. The covariance of the
posterior gives the errors.

The prior is similar to that of M. D. Grossberg and S. K. Nayar, Modeling the Space of Camera Response
Functions, PAMI 26 (10), 2004. The curve is determined by ratios of exposure (the same authors,
Determining the Camera Response from Images: What Is Knowable? PAMI 25 (11), 2003): if all times are
wrong by a power, so is the curve.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.calibration.bracket import MIN_SHARED, Bracket, Places
from blurmatte.calibration.response_prior import CELLS, ResponsePrior, response_prior
from blurmatte.checks import Array, Bools, Floats
from blurmatte.errors import ResponseError
from blurmatte.radiometry import LinearImage, Transfer
from blurmatte.radiometry.transfer import TABLE
from blurmatte.statistics import chi_square_quantile

_CODES = np.arange(CELLS + 1) / CELLS


# Prior, rejection and convergence of the fit.
# Prior standard deviation of the black level, of full scale; video's is 0.004 (16 of 255), that
# of log curves 0.0004
_BLACK_STD = 0.002
# Standard deviations of the noise that code values keep from the ends of the range
_MARGIN_STD = 2.0
_REJECTED_PROBABILITY = 1e-4  # of an inlier to be rejected
_MAX_ITERATIONS = 25  # of Gauss-Newton
# Longest step, and the step at convergence, standard deviations of the prior
_MAX_STEP_STD = 2.0
_MIN_STEP_STD = 0.02
_START_PLACES = 500  # places on which the curves of the prior's family are compared
_MIN_AGREEMENT = 0.7  # fraction of the places that must agree with the curve
_MAX_NOISE = 6 / 255  # of a code value, fraction of full scale; more is motion
_CHANNEL_STD = 3.0  # standard deviations by which different channels must differ
# Groups of code values for mean residuals, and places in one
_GROUPS = 16
_MIN_GROUP_PLACES = 20


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A camera's response curve, and its agreement with the pictures.

    Parameters
    ----------
    transfer : Transfer
        The curve; code value 1 is light 1.
    std : (256,) float
        Standard deviation of the light at the code values 0, 1/255 … 1, as a fraction of full scale:
        from noise, exposure times, and the differences between the channels' curves.
    exposure_times : tuple of float
        Fitted times, seconds, ascending; their geometric mean is that of the given ones.
    noise : float
        Standard deviation of a code value, as a fraction of full scale.
    agreement : float
        Fraction of the places that agree with the curve.
    seen : tuple of two floats
        Lowest and highest code value that two pictures shared; beyond, the curve is extrapolated.
    channel_difference : tuple of three floats
        Largest difference of each channel's curve from the common one, fraction of full scale.
    channels_agree : bool
        True if no channel differs by more than its error.
    residuals : (pictures, 16) float
        Mean residual of code values, for sixteenths of the code values; NaN where there are few.

    Examples
    --------
    >>> light = np.linspace(0.02, 0.98, 64)[None, :, None] * np.ones((48, 1, 3))
    >>> half, full = (bm.LinearImage(bm.SRGB.encode(light * exposure)) for exposure in (0.5, 1))
    >>> fit = bm.calibration.fit_response([half, full], [1 / 120, 1 / 60])
    >>> print(f"{fit.agreement:.0%} of the places agree")
    100% of the places agree
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
    """Measure a camera's response from two or more pictures of one still scene, exposed differently.

    Aperture, ISO and white balance must be the same in all. One curve is fitted to all channels; a
    factor of a channel is white balance and does not change alpha. The scale of light is arbitrary:
    code value 1 is light 1.

    Parameters
    ----------
    pictures : sequence of LinearImage
        The same size; code values without decoding, read with `read(path, LINEAR)`.
    exposure_times : sequence of float, optional
        Seconds, one for each picture; by default those of the files.
    time_std : float
        Relative standard deviation of the exposure times. Files hold nominal ones: 1/60 where the
        shutter gives 1/64. 0: exact.

    Returns
    -------
    ResponseFit

    Raises
    ------
    ValueError, TypeError
        If there are fewer than two pictures, sizes differ, or times are missing, equal or not positive.
    ResponseError
        If the pictures do not determine a curve: they are clipped, have no code values in common, or
        the scene moved.

    Examples
    --------
    >>> light = np.linspace(0.02, 0.98, 64)[None, :, None] * np.ones((48, 1, 3))
    >>> half, full = (bm.LinearImage(bm.SRGB.encode(light * exposure)) for exposure in (0.5, 1))
    >>> fit = bm.calibration.fit_response([half, full], [1 / 120, 1 / 60])
    >>> decoded = bm.decode(np.full((8, 8, 3), 128, np.uint8), fit.transfer)
    """
    if not (np.isfinite(time_std) and 0 <= time_std <= 1):
        raise ValueError(f"time_std must lie between 0 and 1, got {time_std}")
    bracket = Bracket.of(pictures, exposure_times, time_std)
    channels = bracket.places()
    everything = Places.joined(channels)
    everything.check_shared(bracket)
    fit = _fit(everything, bracket)
    _check_agreement(fit)
    difference, agree, channel_std = _compared(fit, channels, bracket)
    return ResponseFit(
        Transfer.from_table("response", np.interp(np.linspace(0, 1, TABLE), _CODES, fit.light)),
        np.hypot(fit.light_std, channel_std),
        tuple((bracket.times * np.exp(fit.state.shifts - fit.state.shifts.mean())).tolist()),
        fit.noise,
        fit.agreement,
        fit.seen,
        difference,
        agree,
        fit.residuals,
    )


@dataclass(frozen=True, eq=False)
class _ResponseParameters:
    """Parameters: coefficients of h, black level in its standard deviations, log times."""

    prior: ResponsePrior
    z: Array
    black: float
    shifts: Array

    @property
    def slopes(self) -> Array:
        """(CELLS,) derivative of G in each cell."""
        slopes: Array = np.exp(self.prior.mean + self.prior.basis @ self.z)
        return slopes

    @property
    def light(self) -> Array:
        """(CELLS + 1,) G at the code values between the cells."""
        rising = np.concatenate([[0], np.cumsum(self.slopes)]) / CELLS
        return np.asarray(rising - _BLACK_STD * self.black)

    @property
    def derivatives(self) -> Array:
        """(CELLS + 1, rank + 1) derivatives of G by z and black."""
        by_z = np.cumsum(self.prior.basis * self.slopes[:, None], axis=0) / CELLS
        by_z = np.concatenate([np.zeros((1, len(self.z))), by_z])
        by_black = np.full((CELLS + 1, 1), -_BLACK_STD)
        return np.concatenate([by_z, by_black], axis=1)

    def moved(self, step: Array, time_std: float) -> "_ResponseParameters":
        """The state after a step of all parameters; times have a prior of this std."""
        rank = len(self.z)
        return _ResponseParameters(
            self.prior,
            self.z + step[:rank],
            self.black + float(step[rank]),
            self.shifts + time_std * step[rank + 1 :],
        )


@dataclass(frozen=True, eq=False)
class _Prediction:
    """Predicted code values, for the light of each place that fits best."""

    codes: Array  # (N, pictures)
    slopes: Array  # (N, pictures) of G there
    flow: Array  # (N, pictures) change of light by log time

    def of(self, some: npt.NDArray[np.intp]) -> "_Prediction":
        """The prediction for some of the samples."""
        return _Prediction(self.codes[some], self.slopes[some], self.flow[some])


@dataclass(frozen=True, eq=False)
class _ResponseState:
    state: _ResponseParameters
    light: Array
    light_std: Array
    noise: float
    agreement: float
    seen: tuple[float, float]
    residuals: Array


def _check_agreement(fit: _ResponseState) -> None:
    """Raise ResponseError if too few places agree with the curve, or the noise is too large."""
    if fit.agreement < _MIN_AGREEMENT or fit.noise > _MAX_NOISE:
        raise ResponseError(
            f"no curve explains these pictures: {fit.agreement:.0%} of the places agree with the best, "
            f"to {255 * fit.noise:.1f} of 255 code values; the camera or the scene moved, the light "
            "changed, or the camera treats each picture differently. Use a tripod, and set exposure, "
            "ISO and white balance by hand"
        )


def _predicted(state: _ResponseParameters, v: Floats, times: Array, usable: Bools) -> _Prediction:
    """The prediction of a state: the light of each place by least squares in code values."""
    G, slopes, t = state.light, state.slopes, times * np.exp(state.shifts)

    def at(codes: Floats) -> Array:
        """Slope of the curve at code values."""
        return np.asarray(slopes[np.clip((codes * CELLS).astype(int), 0, CELLS - 1)])

    weight = np.where(usable, t / at(v), 0) ** 2
    total = np.maximum(weight.sum(axis=1), 1e-300)
    x = np.maximum(np.sum(weight * np.interp(v, _CODES, G) / t, axis=1) / total, 1e-9)
    codes = _encoded(x[:, None] * t, G, slopes)
    for _ in range(3):
        pull = np.where(usable, t / at(codes), 0)
        step = np.sum(pull * (v - codes), axis=1) / np.maximum(np.sum(pull**2, axis=1), 1e-300)
        x = np.clip(x + step, x / 2, x * 2)
        codes = _encoded(x[:, None] * t, G, slopes)
    return _Prediction(codes, at(codes), x[:, None] * t)


def _encoded(light: Array, G: Array, slopes: Array) -> Array:
    codes = np.interp(light, G, _CODES)
    codes = np.where(light > G[-1], 1 + (light - G[-1]) / slopes[-1], codes)
    return np.where(light < G[0], (light - G[0]) / slopes[0], codes)


def _squares(places: Places, codes: Array, usable: Bools) -> tuple[Array, npt.NDArray[np.intp]]:
    """Sum of squared residuals of each place that two pictures share, and its degrees of freedom."""
    count = np.count_nonzero(usable, axis=1)
    residual = np.where(usable, places.codes - codes, 0)
    return np.sum(residual**2, axis=1)[count >= 2], count[count >= 2] - 1


def _quantile(dof: npt.NDArray[np.intp], probability: float) -> Array:
    """(N,) χ² quantiles for degrees of freedom that are few different integers."""
    return chi_square_quantile(probability, np.arange(dof.max() + 1))[dof]


def _start(places: Places, bracket: Bracket) -> _ResponseParameters:
    """The curve of the family with the least trimmed sum of squares."""
    prior = response_prior()
    some = places.some(_START_PLACES)
    usable = some.usable(_MARGIN_STD * max(bracket.rounding, some.scatter))

    def cost(state: _ResponseParameters) -> float:
        """Sum of squares, with a bound that limits outliers."""
        codes = _predicted(state, some.codes, bracket.ratios, usable).codes
        squares, _ = _squares(some, codes, usable)
        return float(np.sum(np.minimum(squares, 9 * np.median(squares)))) if len(squares) else 0.0

    still = np.zeros(len(bracket.ratios))
    return min((_ResponseParameters(prior, z, 0.0, still) for z in prior.members), key=cost)


def _fit(places: Places, bracket: Bracket, start: _ResponseState | None = None) -> _ResponseState:
    """The likeliest curve.

    Inliers are selected again after each step, so that there is no one cost to descend.
    """
    state = start.state if start else _start(places, bracket)
    margin = _MARGIN_STD * (start.noise if start else max(bracket.rounding, places.scatter))
    for _ in range(_MAX_ITERATIONS):
        usable = places.usable(margin)
        prediction = _predicted(state, places.codes, bracket.ratios, usable)
        squares, dof = _squares(places, prediction.codes, usable)
        if len(squares) < MIN_SHARED:
            raise ResponseError(
                "the pictures are too noisy, or show too much detail, to compare them; "
                "average several of each exposure, or photograph something with plain surfaces"
            )
        noise = max(float(np.median(squares / _quantile(dof, 0.5))) ** 0.5, bracket.rounding)
        good = squares <= noise**2 * _quantile(dof, 1 - _REJECTED_PROBABILITY)
        kept = np.flatnonzero(np.count_nonzero(usable, axis=1) >= 2)[good]
        data = _UsedCodes(places.codes[kept], usable[kept], noise, bracket)
        prediction = prediction.of(kept)
        step, covariance = _step(state, data, prediction)
        size = float(np.abs(step).max())
        state = _shortened(state, step * min(1, _MAX_STEP_STD / size), data, prediction)
        margin = _MARGIN_STD * noise
        if size < _MIN_STEP_STD:
            break
    return _ResponseState(
        state,
        *_normalized(state, covariance),
        noise,
        len(kept) / len(squares),
        data.seen,
        _grouped(data, prediction),
    )


@dataclass(frozen=True, eq=False)
class _UsedCodes:
    """Inliers: code values, where they are usable, and their noise."""

    codes: Floats  # (N, pictures)
    usable: Bools
    noise: float
    bracket: Bracket

    @property
    def seen(self) -> tuple[float, float]:
        """Smallest and largest usable code value."""
        codes = self.codes[self.usable]
        return float(codes.min()), float(codes.max())

    def residuals(self, codes: Array) -> Array:
        """Residuals from predicted codes, in standard deviations."""
        return np.where(self.usable, self.codes - codes, 0) / self.noise

    def cost(self, state: _ResponseParameters, codes: Array) -> float:
        """−2 log posterior."""
        return float(np.sum(self.residuals(codes) ** 2) + np.sum(self.prior_residuals(state) ** 2))

    def prior_residuals(self, state: _ResponseParameters) -> Array:
        """Parameters, in standard deviations of the prior."""
        shifts = state.shifts / (self.bracket.time_std or 1)
        return np.concatenate([state.z, [state.black], shifts])


def _step(
    state: _ResponseParameters, data: _UsedCodes, prediction: _Prediction
) -> tuple[Array, Array]:
    """Gauss-Newton step in units of the prior, and the covariance of the parameters."""
    weight = np.where(data.usable, 1 / (prediction.slopes * data.noise), 0)
    table = state.derivatives
    where = np.clip(prediction.codes, 0, 1) * CELLS
    cell = np.minimum(where.astype(int), CELLS - 1)
    part = (where - cell)[..., None]
    of_curve = table[cell] * (1 - part) + table[cell + 1] * part
    flow = prediction.flow
    of_times = -flow[..., None] * np.eye(flow.shape[1]) * data.bracket.time_std
    J = np.concatenate([of_curve, of_times], axis=-1) * weight[..., None]
    # Variable projection: remove what a change of the place's light explains.
    along = flow * weight
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    J -= along[..., None] * np.einsum("nm,nmp->np", along, J)[:, None]
    residual = data.residuals(prediction.codes)
    residual -= along * np.sum(along * residual, axis=1, keepdims=True)
    J = J.reshape(-1, J.shape[-1])
    normal = J.T @ J + np.eye(J.shape[1])
    pull = J.T @ residual.ravel() + data.prior_residuals(state)
    return -np.linalg.solve(normal, pull), np.linalg.inv(normal)


def _shortened(
    state: _ResponseParameters, step: Array, data: _UsedCodes, prediction: _Prediction
) -> _ResponseParameters:
    """The state after the step, halved until the cost decreases; else the old state."""
    before = data.cost(state, prediction.codes)
    for _ in range(8):
        candidate = state.moved(step, data.bracket.time_std)
        codes = _predicted(candidate, data.codes, data.bracket.ratios, data.usable).codes
        if data.cost(candidate, codes) < before:
            return candidate
        step = step / 2
    return state


def _normalized(state: _ResponseParameters, covariance: Array) -> tuple[Array, Array]:
    """Light scaled to 1 at code value 1, and its standard deviation."""
    G, J = state.light, state.derivatives
    light = G / G[-1]
    J = (J - light[:, None] * J[-1]) / G[-1]
    count = J.shape[1]
    variance = np.einsum("kp,pq,kq->k", J, covariance[:count, :count], J)
    return light, np.sqrt(np.maximum(variance, 0))


def _grouped(data: _UsedCodes, prediction: _Prediction) -> Array:
    """(pictures, groups) mean residual by code value; NaN where there are few."""
    groups = _GROUPS
    group = np.clip((prediction.codes * groups).astype(int), 0, groups - 1)
    residual = data.codes - prediction.codes
    means = np.full((residual.shape[1], groups), np.nan)
    for picture, number in np.ndindex(*means.shape):
        inside = data.usable[:, picture] & (group[:, picture] == number)
        if np.count_nonzero(inside) >= _MIN_GROUP_PLACES:
            means[picture, number] = residual[inside, picture].mean()
    return means


def _compared(
    fit: _ResponseState, channels: Sequence[Places], bracket: Bracket
) -> tuple[tuple[float, float, float], bool, Array]:
    """Each channel's largest distance from the common curve, and whether all agree with it.

    Last (CELLS + 1,) the standard deviation of the common curve, from the distances.
    """
    if len(channels) == 1:
        return (0.0, 0.0, 0.0), True, np.zeros(CELLS + 1)
    apart, agree = [], True
    for places in channels:
        own = _fit(places, bracket, fit) if places.shared() else fit
        apart.append(np.abs(own.light - fit.light))
        allowed = _CHANNEL_STD * np.hypot(own.light_std, fit.light_std)
        agree &= bool(np.all(apart[-1] <= allowed + 1e-12))
    red, green, blue = (float(difference.max()) for difference in apart)
    return (red, green, blue), agree, np.sqrt(np.sum(np.square(apart), axis=0) / 2)

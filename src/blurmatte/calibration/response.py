"""fit_response: a camera's response, from pictures of one still scene with different exposures.

In this file v is a code value, 0…1, and G(v) its light, in any unit. A place of light x has in a
picture of exposure time t the code value

    v = f(t x) + noise,    f = G⁻¹,    G(v) = -b + ∫₀ᵛ exp(h),

where h has an empirical prior (`response_prior`), b is the black level, and each t has an error of a
few percent. All are fitted jointly: x is eliminated place by place (variable projection), the other
parameters θ, in standard deviations of their prior, follow by least squares from the residuals of code
values. The covariance of the posterior gives the errors. SciPy's least squares serves here, not
`descent`, as it stops at a relative decrease of their squares: that does not depend on the noise, which
is fitted too.

The prior is similar to that of M. D. Grossberg and S. K. Nayar, Modeling the Space of Camera Response
Functions, PAMI 26 (10), 2004. The curve is determined by ratios of exposure (the same authors,
Determining the Camera Response from Images: What Is Knowable? PAMI 25 (11), 2003): if all times are
wrong by a power, so is the curve.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from blurmatte.calibration.response_inputs import CELLS, MIN_SHARED, Bracket, Places, response_prior
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
_MAX_SELECTIONS = 25  # of inliers
_MIN_CHANGE_STD = 0.02  # of parameters at convergence, standard deviations of the prior
_MIN_DECREASE = 1e-4  # of the sum of squares at convergence, relative
_START_PLACES = 200  # places on which the curves of the prior's family are compared
_TRIMMED = 0.25  # fraction of these places that may be outliers
_MIN_AGREEMENT = 0.7  # fraction of the places that must agree with the curve
_MAX_NOISE = 6 / 255  # of a code value, fraction of full scale; more is motion
_CHANNEL_STD = 3.0  # standard deviations by which different channels must differ
# Groups of code values for mean residuals, and places in one
_GROUPS = 16
_MIN_GROUP_PLACES = 20  # of a mean residual


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
    difference, agree, channel_std = _compared(fit, channels)
    return ResponseFit(
        Transfer.from_table("response", np.interp(np.linspace(0, 1, TABLE), _CODES, fit.light)),
        np.hypot(fit.light_std, channel_std),
        tuple(fit.data.times(fit.theta).tolist()),
        fit.data.noise,
        fit.agreement,
        fit.data.seen,
        difference,
        agree,
        _mean_residuals(fit.theta, fit.data),
    )


@dataclass(frozen=True, eq=False)
class _ResponseCurve:
    """G at the code values between the cells."""

    light: Array  # (CELLS + 1,) G
    slopes: Array  # (CELLS,) of G in each cell

    @classmethod
    def of(cls, theta: Array) -> "_ResponseCurve":
        """The curve of parameters: coefficients of h, then the black level."""
        prior = response_prior()
        *z, black = theta[: prior.basis.shape[1] + 1]
        slopes = np.exp(prior.mean + prior.basis @ z)
        return cls(np.append(0, np.cumsum(slopes)) / CELLS - _BLACK_STD * black, slopes)

    @property
    def derivatives(self) -> Array:
        """(CELLS + 1, rank + 1) of G by the coefficients of h and the black level."""
        by_z = np.cumsum(response_prior().basis * self.slopes[:, None], axis=0) / CELLS
        by_black = np.full(CELLS + 1, -_BLACK_STD)
        return np.column_stack([np.pad(by_z, ((1, 0), (0, 0))), by_black])

    def encoded(self, light: Array) -> Array:
        """Code values of light, extrapolated linearly beyond 0 and 1."""
        G, slopes = self.light, self.slopes
        codes = np.interp(light, G, _CODES)
        codes = np.where(light > G[-1], 1 + (light - G[-1]) / slopes[-1], codes)
        return np.where(light < G[0], (light - G[0]) / slopes[0], codes)

    def slope(self, codes: Floats) -> Array:
        """Slope of G at code values."""
        return np.asarray(self.slopes[np.clip((codes * CELLS).astype(int), 0, CELLS - 1)])

    def normalized(self, covariance: Array) -> tuple[Array, Array]:
        """Light scaled to 1 at code value 1, and its standard deviation."""
        light = self.light / self.light[-1]
        derivatives = self.derivatives
        J = (derivatives - light[:, None] * derivatives[-1]) / self.light[-1]
        count = J.shape[1]
        variance = np.einsum("kp,pq,kq->k", J, covariance[:count, :count], J)
        return light, np.sqrt(np.maximum(variance, 0))


@dataclass(frozen=True, eq=False)
class _SharedCodes:
    """Places that two pictures share: code values, where they are usable, and their noise."""

    codes: Floats  # (N, pictures)
    usable: Bools
    bracket: Bracket
    noise: float

    @classmethod
    def of(cls, places: Places, bracket: Bracket, noise: float) -> "_SharedCodes":
        """The places whose codes are far from the ends of the range in two pictures."""
        usable = places.usable(_MARGIN_STD * noise)
        shared = np.count_nonzero(usable, axis=1) >= 2
        return cls(places.codes[shared], usable[shared], bracket, noise)

    @property
    def seen(self) -> tuple[float, float]:
        """Smallest and largest usable code value."""
        codes = self.codes[self.usable]
        return float(codes.min()), float(codes.max())

    def times(self, theta: Array) -> Array:
        """(pictures,) exposure times of the last parameters, whose mean log is that of the files."""
        logs = self.bracket.time_std * theta[-len(self.bracket.times) :]
        return np.asarray(self.bracket.times * np.exp(logs - logs.mean()))


@dataclass(frozen=True, eq=False)
class _FittedCurve:
    theta: Array
    light: Array  # (CELLS + 1,)
    light_std: Array
    data: _SharedCodes  # the inliers
    agreement: float


def _check_agreement(fit: _FittedCurve) -> None:
    """Raise ResponseError if too few places agree with the curve, or the noise is too large."""
    if fit.agreement < _MIN_AGREEMENT or fit.data.noise > _MAX_NOISE:
        raise ResponseError(
            f"no curve explains these pictures: {fit.agreement:.0%} of the places agree with the best, "
            f"to {255 * fit.data.noise:.1f} of 255 code values; the camera or the scene moved, the "
            "light changed, or the camera treats each picture differently. Use a tripod, and set "
            "exposure, ISO and white balance by hand"
        )


def _predicted(theta: Array, data: _SharedCodes) -> tuple[_ResponseCurve, Array]:
    """The curve of parameters, and (N, pictures) the light that fits the code values best."""
    curve, t, v = _ResponseCurve.of(theta), data.times(theta), data.codes
    weight = np.where(data.usable, t / curve.slope(v), 0) ** 2
    G = np.interp(v, _CODES, curve.light)
    x = np.maximum(np.sum(weight * G / t, axis=1) / np.sum(weight, axis=1), 1e-9)
    codes = curve.encoded(x[:, None] * t)
    for _ in range(3):
        pull = np.where(data.usable, t / curve.slope(codes), 0)
        step = np.sum(pull * (v - codes), axis=1) / np.sum(pull**2, axis=1)
        x = np.clip(x + step, x / 2, x * 2)
        codes = curve.encoded(x[:, None] * t)
    return curve, x[:, None] * t


def _residuals(theta: Array, data: _SharedCodes) -> Array:
    """(N, pictures) residuals from predicted code values, 0 where they are not usable."""
    curve, light = _predicted(theta, data)
    return np.where(data.usable, data.codes - curve.encoded(light), 0)


def _squares(theta: Array, data: _SharedCodes) -> Array:
    """(N,) sums of squared residuals of the places."""
    return np.asarray(np.sum(_residuals(theta, data) ** 2, axis=1))


def _start(places: Places, bracket: Bracket) -> Array:
    """Parameters of the curve of the family with the least trimmed sum of squares."""
    some = places.some(_START_PLACES)
    data = _SharedCodes.of(some, bracket, max(bracket.rounding, some.scatter))
    kept = int((1 - _TRIMMED) * len(data.codes))
    others = np.zeros(1 + len(bracket.times))
    starts = [np.concatenate([z, others]) for z in response_prior().members]
    return min(starts, key=lambda theta: float(np.sum(np.sort(_squares(theta, data))[:kept])))


def _fit(places: Places, bracket: Bracket, start: _FittedCurve | None = None) -> _FittedCurve:
    """The likeliest curve; its inliers are selected again until they give the same curve."""
    theta = start.theta if start else _start(places, bracket)
    noise = start.data.noise if start else max(bracket.rounding, places.scatter)
    for _ in range(_MAX_SELECTIONS):
        data, agreement = _inliers(theta, _SharedCodes.of(places, bracket, noise))
        found = scipy.optimize.least_squares(
            _standardized_residuals, theta, _jacobian, ftol=_MIN_DECREASE, args=(data,)
        )
        change, theta, noise = np.abs(found.x - theta).max(), found.x, data.noise
        if change < _MIN_CHANGE_STD:
            break
    covariance = np.linalg.inv(found.jac.T @ found.jac)
    return _FittedCurve(theta, *_ResponseCurve.of(theta).normalized(covariance), data, agreement)


def _inliers(theta: Array, data: _SharedCodes) -> tuple[_SharedCodes, float]:
    """The places that agree with a curve to their noise, and their fraction."""
    if len(data.codes) < MIN_SHARED:
        raise ResponseError(
            "the pictures are too noisy, or show too much detail, to compare them; "
            "average several of each exposure, or photograph something with plain surfaces"
        )
    squares, dof = _squares(theta, data), np.count_nonzero(data.usable, axis=1) - 1
    ratios = squares / chi_square_quantile(0.5, dof)
    noise = max(float(np.median(ratios)) ** 0.5, data.bracket.rounding)
    good = squares <= noise**2 * chi_square_quantile(1 - _REJECTED_PROBABILITY, dof)
    inliers = _SharedCodes(data.codes[good], data.usable[good], data.bracket, noise)
    return inliers, float(np.mean(good))


def _standardized_residuals(theta: Array, data: _SharedCodes) -> Array:
    """Residuals of code values and parameters from their prior, in standard deviations."""
    return np.concatenate([_residuals(theta, data).ravel() / data.noise, theta])


def _jacobian(theta: Array, data: _SharedCodes) -> Array:
    """Derivatives of `_standardized_residuals`, the light of each place being the best."""
    curve, flow = _predicted(theta, data)  # the change of light by log time is the light
    codes = curve.encoded(flow)
    weight = np.where(data.usable, 1 / (curve.slope(codes) * data.noise), 0)
    cell, part = np.divmod(np.clip(codes, 0, 1 - 1e-9) * CELLS, 1)
    derivatives, rise = curve.derivatives, np.diff(curve.derivatives, axis=0)
    cell = cell.astype(int)
    of_curve = derivatives[cell] + rise[cell] * part[..., None]
    of_times = -flow[..., None] * np.eye(flow.shape[1]) * data.bracket.time_std
    J = np.concatenate([of_curve, of_times], axis=-1) * weight[..., None]
    # Variable projection: remove what a change of the place's light explains.
    along = flow * weight
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    J -= along[..., None] * np.einsum("nm,nmp->np", along, J)[:, None]
    return np.concatenate([J.reshape(-1, len(theta)), np.eye(len(theta))])


def _mean_residuals(theta: Array, data: _SharedCodes) -> Array:
    """(pictures, groups) mean residual by predicted code value; NaN where there are few."""
    curve, light = _predicted(theta, data)
    codes = curve.encoded(light)
    means = np.full((codes.shape[1], _GROUPS), np.nan)
    group = np.clip((codes * _GROUPS).astype(int), 0, _GROUPS - 1)
    for picture, number in np.ndindex(*means.shape):
        inside = data.usable[:, picture] & (group[:, picture] == number)
        if np.count_nonzero(inside) >= _MIN_GROUP_PLACES:
            means[picture, number] = (data.codes - codes)[inside, picture].mean()
    return means


def _compared(
    fit: _FittedCurve, channels: Sequence[Places]
) -> tuple[tuple[float, float, float], bool, Array]:
    """Each channel's largest distance from the common curve, and whether all agree with it.

    Last (CELLS + 1,) the standard deviation of the common curve, from the distances.
    """
    if len(channels) == 1:
        return (0.0, 0.0, 0.0), True, np.zeros(CELLS + 1)
    apart, agree = [], True
    for places in channels:
        own = _fit(places, fit.data.bracket, fit) if places.shared() else fit
        apart.append(np.abs(own.light - fit.light))
        allowed = _CHANNEL_STD * np.hypot(own.light_std, fit.light_std)
        agree &= bool(np.all(apart[-1] <= allowed + 1e-12))
    red, green, blue = (float(difference.max()) for difference in apart)
    return (red, green, blue), agree, np.sqrt(np.sum(np.square(apart), axis=0) / 2)

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

from blurmatte.checks import Bools, Floats
from blurmatte.errors import ResponseError
from blurmatte.radiometry.bracket import ENOUGH, Bracket, Places
from blurmatte.radiometry.image import LinearImage
from blurmatte.radiometry.response_prior import CELLS, ResponsePrior, response_prior
from blurmatte.radiometry.transfer import TABLE, Transfer

Array = npt.NDArray[np.float64]

_CODES = np.arange(CELLS + 1) / CELLS
_BLACK_STD = 0.002  # of full scale; 16 of 255 is 0.004 in video, makers' log curves have 0.0004
_MARGIN = 2.0  # sigmas of a place, beside those of its neighbors, from the ends of the range
_REJECTED = 1e-4  # chance at which a good place is called an outlier
_ROUNDS = 25
_LONGEST = 2.0  # step, in standard deviations of the prior
_DONE = 0.02
_SEARCHED = 500  # places on which all curves of the family are tried
_LEAST_RIGHT = 0.7  # share of places that must agree
_NOISIEST = 6 / 255  # code values: no camera's noise; something moved everywhere
_CLEAR = 3.0  # sigmas by which the channels must differ to be called different
_GROUPS, _SOME = 16, 20  # of code values, for the residuals; places that make a mean


@dataclass(frozen=True, eq=False)
class ResponseFit:
    """A camera's curve, and how well the pictures agree with it.

    Parameters
    ----------
    transfer : Transfer
        The curve; code value 1 is light 1.
    std : (256,) float
        Standard deviation of the light of the code values 0, 1/255 … 1, as a fraction of full scale:
        from noise and exposure times, and from how far the channels' own curves are apart.
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
        Mean of code value minus what the curve says, for sixteenths of the code values; NaN: hardly
        seen.
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
    if fit.agreement < _LEAST_RIGHT or fit.noise > _NOISIEST:
        raise ResponseError(
            f"no curve explains these pictures: {fit.agreement:.0%} of the places agree with the best, "
            f"to {255 * fit.noise:.1f} of 255 code values; the camera or the scene moved, the light "
            "changed, or the camera treats each picture differently. Use a tripod, and set exposure, "
            "ISO and white balance by hand"
        )
    alone = _compared(fit, channels, bracket)
    return ResponseFit(
        Transfer.from_table("response", np.interp(np.linspace(0, 1, TABLE), _CODES, fit.light)),
        np.hypot(fit.light_std, alone.std),
        tuple((bracket.times * np.exp(fit.state.shifts - fit.state.shifts.mean())).tolist()),
        fit.noise,
        fit.agreement,
        fit.seen,
        alone.difference,
        alone.agree,
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

    def of(self, some: npt.NDArray[np.intp]) -> "_Prediction":
        return _Prediction(self.codes[some], self.slopes[some], self.flow[some])


@dataclass(frozen=True, eq=False)
class _Fit:
    state: _State
    light: Array
    light_std: Array
    noise: float
    agreement: float
    seen: tuple[float, float]
    residuals: Array


def _predicted(state: _State, v: Floats, times: Array, usable: Bools) -> _Prediction:
    """Least squares for the light of each place, in code values."""
    G, slopes, t = state.light, state.slopes, times * np.exp(state.shifts)

    def at(codes: Floats) -> Array:
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


def _quantile(dof: npt.NDArray[np.intp], share: float) -> Array:
    """Of chi²."""
    from scipy.special import gammaincinv

    return np.asarray(2 * gammaincinv(np.arange(dof.max() + 1) / 2, share))[dof]


def _start(places: Places, bracket: Bracket) -> _State:
    """The curve of the family that leaves the least."""
    prior = response_prior()
    some = places.some(_SEARCHED)
    usable = some.usable(_MARGIN * max(bracket.rounding, some.scatter))

    def left(state: _State) -> float:
        codes = _predicted(state, some.codes, bracket.ratios, usable).codes
        squares, _ = _squares(some, codes, usable)
        return float(np.sum(np.minimum(squares, 9 * np.median(squares)))) if len(squares) else 0.0

    still = np.zeros(len(bracket.ratios))
    return min((_State(prior, z, 0.0, still) for z in prior.members), key=left)


def _fit(places: Places, bracket: Bracket, start: _Fit | None = None) -> _Fit:
    state = start.state if start else _start(places, bracket)
    margin = _MARGIN * (start.noise if start else max(bracket.rounding, places.scatter))
    for _ in range(_ROUNDS):
        usable = places.usable(margin)
        prediction = _predicted(state, places.codes, bracket.ratios, usable)
        squares, dof = _squares(places, prediction.codes, usable)
        if len(squares) < ENOUGH:
            raise ResponseError(
                "the pictures are too noisy, or show too much detail, to compare them; "
                "average several of each exposure, or photograph something with plain surfaces"
            )
        noise = max(float(np.median(squares / _quantile(dof, 0.5))) ** 0.5, bracket.rounding)
        good = squares <= noise**2 * _quantile(dof, 1 - _REJECTED)
        kept = np.flatnonzero(np.count_nonzero(usable, axis=1) >= 2)[good]
        data = _Data(places.codes[kept], usable[kept], noise, bracket)
        prediction = prediction.of(kept)
        step, covariance = _step(state, data, prediction)
        size = float(np.abs(step).max())
        state = _shortened(state, step * min(1, _LONGEST / size), data, prediction)
        margin = _MARGIN * noise
        if size < _DONE:
            break
    return _Fit(
        state,
        *_normalized(state, covariance),
        noise,
        len(kept) / len(squares),
        data.seen,
        _grouped(data, prediction),
    )


@dataclass(frozen=True, eq=False)
class _Data:
    """What is believed: code values, where they are usable, their noise."""

    codes: Floats  # (N, pictures)
    usable: Bools
    noise: float
    bracket: Bracket

    @property
    def seen(self) -> tuple[float, float]:
        codes = self.codes[self.usable]
        return float(codes.min()), float(codes.max())

    def left(self, codes: Array) -> Array:
        """Residuals of predicted codes, in standard deviations."""
        return np.where(self.usable, self.codes - codes, 0) / self.noise

    def cost(self, state: _State, codes: Array) -> float:
        """Twice the negative logarithm of the posterior."""
        return float(np.sum(self.left(codes) ** 2) + np.sum(self.away(state) ** 2))

    def away(self, state: _State) -> Array:
        """What is fitted, in standard deviations of the prior."""
        shifts = state.shifts / (self.bracket.time_std or 1)
        return np.concatenate([state.z, [state.black], shifts])


def _step(state: _State, data: _Data, prediction: _Prediction) -> tuple[Array, Array]:
    """Gauss-Newton step in units of the prior, and the covariance of what is fitted."""
    weight = np.where(data.usable, 1 / (prediction.slopes * data.noise), 0)
    table = state.derivatives
    where = np.clip(prediction.codes, 0, 1) * CELLS
    cell = np.minimum(where.astype(int), CELLS - 1)
    part = (where - cell)[..., None]
    of_curve = table[cell] * (1 - part) + table[cell + 1] * part
    flow = prediction.flow
    of_times = -flow[..., None] * np.eye(flow.shape[1]) * data.bracket.time_std
    J = np.concatenate([of_curve, of_times], axis=-1) * weight[..., None]
    # What a change of the place's own light could do as well says nothing: project it out.
    along = flow * weight
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    J -= along[..., None] * np.einsum("nm,nmp->np", along, J)[:, None]
    residual = data.left(prediction.codes)
    residual -= along * np.sum(along * residual, axis=1, keepdims=True)
    J = J.reshape(-1, J.shape[-1])
    normal = J.T @ J + np.eye(J.shape[1])
    pull = J.T @ residual.ravel() + data.away(state)
    return -np.linalg.solve(normal, pull), np.linalg.inv(normal)


def _shortened(state: _State, step: Array, data: _Data, prediction: _Prediction) -> _State:
    """Where the step leads, halved until less is left than before; the old state if nothing helps."""
    before = data.cost(state, prediction.codes)
    for _ in range(8):
        candidate = state.moved(step, data.bracket.time_std)
        codes = _predicted(candidate, data.codes, data.bracket.ratios, data.usable).codes
        if data.cost(candidate, codes) < before:
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


def _grouped(data: _Data, prediction: _Prediction) -> Array:
    """(pictures, groups) mean residual by code value; NaN where there are hardly any."""
    group = np.clip((prediction.codes * _GROUPS).astype(int), 0, _GROUPS - 1)
    residual = data.codes - prediction.codes
    means = np.full((residual.shape[1], _GROUPS), np.nan)
    for picture, number in np.ndindex(*means.shape):
        inside = data.usable[:, picture] & (group[:, picture] == number)
        if np.count_nonzero(inside) >= _SOME:
            means[picture, number] = residual[inside, picture].mean()
    return means


@dataclass(frozen=True, eq=False)
class _Channels:
    """What the channels alone say."""

    difference: tuple[float, float, float]  # largest from the common curve
    agree: bool
    std: Array  # (CELLS + 1,) of the common curve, as the channels disagree


def _compared(fit: _Fit, channels: Sequence[Places], bracket: Bracket) -> _Channels:
    """Each channel's own curve against the common one."""
    if len(channels) == 1:
        return _Channels((0.0, 0.0, 0.0), True, np.zeros(CELLS + 1))
    apart, agree = [], True
    for places in channels:
        own = _fit(places, bracket, fit) if places.shared() else fit
        apart.append(np.abs(own.light - fit.light))
        agree &= bool(np.all(apart[-1] <= _CLEAR * np.hypot(own.light_std, fit.light_std) + 1e-12))
    red, green, blue = (float(difference.max()) for difference in apart)
    return _Channels((red, green, blue), agree, np.sqrt(np.sum(np.square(apart), axis=0) / 2))

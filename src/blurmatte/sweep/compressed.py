"""What a sweep becomes of the light before its file compressed it, where the file says how it did.

`chroma` subtracts what the file made of the picture that a sweep tells. So far as the file kept nothing
of the picture, that puts the sweep itself back into the light, and what is found there agrees with
it, whatever it is: doing so again and again ends at the answer, but slowly, and seems surer than it
is. In this file θ are the parameters of a state, g(θ) is the gradient of its cost in the light that θ
tells, and H its curvature there. F = H⁻¹ dg/dθ is what the file kept of each parameter: 1 all, 0
nothing. Steps −(HF)⁻¹g end where g is 0, and HF is what is known of θ.

What is rounded besides, to whole codes in plate and image, hangs together over whole blocks before
plain walls, and no sum of residuals beside a streak tells that. It is part of the covariance.
"""

from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry import Compression, Transfer
from blurmatte.sweep.chroma import Bled
from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State, descend, moved, relit, sharp
from blurmatte.sweep.search import Search
from blurmatte.sweep.side_by_side import side_by_side
from blurmatte.sweep.verdict import overstated

Array = npt.NDArray[np.float64]

_NEARBY = 2.0  # by which factor another radius may come out
_STEPS = 4  # each leaves a tenth or less of what is left
_FAR, _TURN = 0.1, 0.02  # of alpha, radians: over which a file's steps are not seen singly
_LEAST_KEPT = 0.05  # of a parameter: of what is kept less, nothing is known
_ENOUGH = 0.05  # standard deviations
_ROUNDING = 12**-0.5 / 255  # standard deviation of what is rounded off code values
_CHROMA = np.array([[0, -0.344136, 1.772], [1.402, -0.714136, 0]])  # R'G'B' by Cb and Cr [T.871]


def before_compression(
    search: Search, state: State, bled: Bled
) -> tuple[Search, State, Array | None]:
    """The light before the file, where a state ends there, and how well its parameters are known.

    Parameters
    ----------
    search : Search
        Whose data know their compression.
    state : State
        Of one paint or a plane, in these data.
    bled : Bled
        What the file made of their light.

    Returns
    -------
    Search, State
        A rim that still is soft was blurred by the lens.
    (size, size) float, or None
        Covariance of the state's parameters, but for `student.VARIANCE`; None if it has not converged.
    """
    data = search.data
    bounds = state.shape[0] / _NEARBY, state.shape[0] * _NEARBY
    state = sharp(data, state)
    for _ in range(2):
        before = _told_by(data, state, bled)
        search = replace(search, data=before, bounds=bounds)
        state = search.softened(descend(before, relit(before, state), bounds))
    before, state = _again(data, state, bled)
    if not state.converged:
        return replace(search, data=before), state, None
    left, H = _gradient(before, state), _kept(data, before, state, bled)
    for _ in range(_STEPS):
        step = -np.linalg.solve(H, left)
        off = -float(left @ step)
        near = moved(before, state, np.asarray(step), bounds)
        there = _again(data, replace(near, converged=True), bled)
        still = _gradient(*there)
        if off < _ENOUGH**2 or still @ np.linalg.solve(H, still) > off:
            break
        (before, state), left = there, still
    inverse = np.linalg.inv(H)
    by_noise = overstated(before, state) * inverse
    by_rounding = inverse @ _by_rounding(before, state, bled.transfer) @ inverse
    return replace(search, data=before), state, np.asarray(by_noise + by_rounding)


def _told_by(data: Data, state: State, bled: Bled) -> Data:
    """The light before the file, if that was what a state says."""
    return data.with_light(bled.before(state.swept.alpha, state.frame.within))


def _again(data: Data, state: State, bled: Bled) -> tuple[Data, State]:
    """The light that a state tells, and the state in it."""
    before = _told_by(data, state, bled)
    return before, replace(relit(before, state), converged=state.converged)


def _gradient(data: Data, state: State) -> Array:
    return state.information(data)[1]


def _kept(data: Data, before: Data, state: State, bled: Bled) -> Array:
    """(size, size) HF, symmetric: what files do to one parameter they do to others alike."""
    H, g = state.information(before)

    def changed(near: tuple[float, State]) -> Array:
        far, there = near
        other = _told_by(data, there, bled)
        return (_gradient(other, relit(other, state)) - g) / far

    lost = np.stack(side_by_side(changed, _near(before, state)), axis=1)
    values, ways = np.linalg.eigh(H)
    root = np.sqrt(np.maximum(values, 1e-9 * values.max()))
    lost = (ways / root).T @ lost @ (ways / root)
    shares, axes = np.linalg.eigh(np.eye(len(H)) + (lost + lost.T) / 2)
    back = (ways * root) @ axes
    return np.asarray((back * np.clip(shares, _LEAST_KEPT, 1)) @ back.T)


def _near(data: Data, state: State) -> list[tuple[float, State]]:
    """States with one parameter a little further, how far: alpha by a tenth, or the color by 1°."""
    steepest = np.abs(state.swept.by_parameters).max(axis=(0, 1))
    distances = [*(_FAR / np.maximum(steepest, 1e-6)), _TURN, _TURN]
    steps = np.diag(distances)
    there = side_by_side(lambda step: moved(data, state, step, (0, np.inf)), steps)
    return list(zip(distances, there, strict=True))


def _by_rounding(data: Data, state: State, transfer: Transfer) -> Array:
    """(size, size) covariance of the gradient by chroma that is off in each block by a constant.

    The plate's is, too, by one for all of it that is seen through the object.
    """
    assert data.compression is not None
    e, weights, alpha = state.e[:2], state.weights(data), state.swept.alpha
    blocks = _blocks(data.compression, alpha.shape)
    slopes = [(there.e[:2] - e) / far for far, there in _near(data, state)]
    through = np.where(alpha > 0, 1 - alpha, 0)[..., None]
    whole, total = np.zeros_like(blocks), np.zeros((state.size, state.size))
    for color in _CHROMA * _ROUNDING:
        for light, places in (
            (transfer.slope(data.C) * color, blocks),
            (through * transfer.slope(data.B) * color, whole),
        ):
            other = relit(data.with_light(data.C + light), state)
            by = weights * (other.e[:2] - e)
            sums = [np.bincount(places.ravel(), (by * s).sum(axis=0).ravel()) for s in slopes]
            total += np.array(sums) @ np.array(sums).T
    return total


def _blocks(compression: Compression, shape: tuple[int, ...]) -> npt.NDArray[np.int64]:
    """(h, w) numbers of the blocks that share their coefficients of chroma."""
    y, x = (
        (np.arange(n) + at) // size - at // size
        for n, at, size in zip(shape, compression.origin[::-1], compression.mcu[::-1], strict=True)
    )
    return np.asarray(y[:, None] * (x[-1] + 1) + x)

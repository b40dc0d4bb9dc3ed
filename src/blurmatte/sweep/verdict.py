"""Does a sweep explain the streak? What its residuals and its light say."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import numpy.typing as npt

from blurmatte.radiometry import block_squares
from blurmatte.streaks import widened
from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State, relit

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

MAX_MISFIT = 1.2  # of a sweep that is believed; what is explained leaves about 1
_MOST_CONTESTED = 0.2  # of alpha: by what another answer may differ from a disc
HOPELESS = 6.0  # misfit on large pixels of what small ones do not save
OPAQUE = 0.999  # alpha: of the plate nothing to speak of is seen, nor of a shape

_BLOCK = 4  # pixels: residuals of a wrong shape hang together over this and more
_SIZES = 4, 8, 16  # pixels: compression has blocks of up to 16
_BESIDE = 3  # pixels around a sweep that it must explain too
_WORST = 0.1  # of the blocks: a hole or a post in front is no fault of the shape
_OTHERS = 0.3  # of the blocks beside: something else may move there
_MEDIANS = {1: 1.386, 2: 0.455, 3: 2.366}  # of χ², by rank of the colors
_REPEATED = 0.3  # χ² beside a streak, where noise of its own in each pixel leaves 0.5 to 2.4
_MOST_NOISE = 0.3  # of the change that a streak is, pixel by pixel
_DOUBTFUL = 13.8  # χ² of two that noise exceeds in one of a thousand pixels
_MOST_DOUBTFUL = 0.25  # of the pixels of a sweep that is right
_MOST_HIDDEN = 0.5  # of alpha: what is seen less could go on as it likes
_MOST_UNCLAIMED = 0.05  # of the light of a streak: right planes left up to 0.01 beyond noise
_HANGS = 1.3  # from where on noise hangs together: what made it so does more where colors change
_HARDLY = 2.0  # times: rims that were blurred left up to 1.5, a sharp one that seemed to be 4
# Where pairs of pixels share color it is 0.8; of 3000 pixels chance makes it 1 ± 0.02.
_SMOOTH = 0.9
_LEAST_USUAL = 0.1  # of variance: what rounding leaves where a file spares all noise
_MOST_USUAL = {4: 10.0, 8: 25.0}  # that noise hangs together; where more does, something else moves
_ANY_COLORS = 15.0  # by which a field of colors overstates evidence: it stands for what is painted
_APART = 0.05  # radians
_NEGATIVE = 0.1  # of the brightest channel, what noise may make of a dark one
_MOMENTS, _ASTRAY = 129, 0.01  # moments of the exposure, and the part of them a path may be astray
_BACK = 3.5  # radians: half a circle, and rounding
BRIGHTEST = 1.2  # mean light of an object in a picture whose brightest is 1


def coherence(data: Data, state: State) -> float:
    """How much residuals within the streak hang together; 1 for noise of its own in each pixel.

    The square of the sum over a block, over the sum of the variances, in the mean of all blocks, of
    the size for which that is largest; with residuals limited as the fit limits them.
    """
    within, _ = _places(data, state)
    return max(_in_blocks(_limited(state), within, 0, size) for size in _SIZES)


def coherence_beside(data: Data, state: State) -> float:
    """The same beside the streak, where only noise is, but for the places in which more moved."""
    _, beside = _places(data, state)
    return max(_in_blocks(_limited(state), beside, _OTHERS, size) for size in _SIZES)


def overstated(data: Data, state: State) -> float:
    """By how much a likelihood overstates the evidence in residuals that hang together, 1 or more."""
    return max(coherence(data, state), _ANY_COLORS if state.frame.rank == 3 else 1.0)


def misfit(data: Data, state: State) -> float:
    """What a sweep leaves beyond noise; see `left_beyond_noise`.

    Infinite if the descent found no end, for what cannot be, where many pixels contradict, where
    something else gave much of the light, and for what is contested by much.
    """
    if is_contested(state) or objection(data, state):
        return np.inf
    return left_beyond_noise(data, state)


def is_contested(state: State) -> bool:
    """Whether another answer differs by more than an error covers.

    Of outlines by anything: free as they are, there may be more that differ by more.
    """
    return state.contested > (_MOST_CONTESTED if state.silhouette.bulges == 1 else 0.0)


def left_beyond_noise(data: Data, state: State) -> float:
    """How much more residuals hang together within the streak than noise does beside it.

    Compared with the residuals of single pixels, so that it does not matter how well the noise is
    known: 1 for a sweep that explains all there is, more for a wrong shape; what chance makes of few
    blocks, one standard deviation, is taken off. Where noise hangs together at all, it does within the
    streak at least as much as colors that pixels share, for compression spares plain surroundings;
    larger blocks tell as much then. And it takes noise away from single pixels sooner than from blocks:
    blocks that hold no more than the noise of the picture are explained, however little their pixels
    do.
    """
    e = _limited(state)
    within, beside = _places(data, state)
    usual = _usual(e, beside)
    blocks = max(np.count_nonzero(within) / _BLOCK**2, 1.0) * _channels(state)
    chance = 1 + float(np.sqrt(2 / blocks))
    # A plane that nobody gave takes up all but the place in which two things met.
    worst = 0.0 if state.frame.rank == 2 and data.known is None else _WORST
    if usual < _HANGS:
        return _together(e, within, worst, _BLOCK) / max(usual, 1) / chance
    of_pixels = [
        _together(e, within, worst, size) / _usual_in_files(e, beside, size, data.scale)
        for size in _MOST_USUAL
    ]
    of_noise = [
        _in_blocks(e, within, worst, size) / shared_coherence(size, data.scale)
        for size in _MOST_USUAL
    ]
    least = min(float(np.exp(np.mean(np.log(ratios)))) for ratios in (of_pixels, of_noise))
    return least / chance


def beyond_file(data: Data, state: State, others: Sequence[Data]) -> float:
    """How much more of what a sweep leaves hangs together than its file makes of noise.

    Parameters
    ----------
    data : Data
    state : State
    others : sequence of Data
        With pictures of what the sweep says that went through the same file.

    Returns
    -------
    float
        About 1 for a sweep that is right. What noise hangs together beside the streak more than there,
        as of a camera that smooths it, is taken off.
    """
    found = _in_both(data, state)
    usual = np.mean([_in_both(other, relit(other, state)) for other in others], axis=0)
    within, beside = np.sqrt(np.prod(found / np.maximum(usual, _LEAST_USUAL), axis=1))
    return float(within / max(beside, 1))


def _in_both(data: Data, state: State) -> Array:
    """(2, 2) how much residuals hang together, in blocks of both sizes, in the streak and beside."""
    e, places = _limited(state), zip(_places(data, state), (_WORST, _OTHERS), strict=True)
    return np.array([[_in_blocks(e, use, w, size) for size in _MOST_USUAL] for use, w in places])


def objection(data: Data, state: State) -> str:
    """Why a state cannot be the answer, whatever it leaves, as words about it; empty if it can."""
    if not state.converged:
        return "is one of many: its size or its path is not determined"
    if not can_be(data, state):
        return "leaves the streak, goes to and fro, or would need light that no object has"
    if not mostly_seen(data, state):
        return "lies mostly where a picture is clipped, or tells nothing"
    doubtful = doubtful_share(data, state)
    if doubtful > _MOST_DOUBTFUL:
        return f"is contradicted by {doubtful:.0%} of its pixels"
    # A plane explains light of its colors where nothing was, too.
    unclaimed = unclaimed_light(data, state) if state.frame.rank == 2 else 0.0
    if unclaimed > _MOST_UNCLAIMED:
        return f"leaves {unclaimed:.0%} of what changed in the streak to something else"
    return ""


def unclaimed_light(data: Data, state: State) -> float:
    """Share of what changed in the streak, beyond noise, that is where the sweep says nothing was."""
    e = (data.C - data.B) / np.sqrt(data.C_variance + data.B_variance)
    use, was = data.streak & data.valid, state.swept.alpha > 0
    within, beside = (
        float(np.maximum(block_squares(e, use & where, _BLOCK) - 1, 0).sum())
        for where in (was, ~was)
    )
    return beside / max(within + beside, 1e-9)


def coherence_of_noise(data: Data, state: State, size: float) -> float:
    """How much noise hangs together within a streak over so many pixels, as `coherence` tells it."""
    e = _limited(state)
    _, beside = _places(data, state)
    if _usual(e, beside) < _HANGS:
        return 1.0
    nearest = min(_MOST_USUAL, key=lambda known: abs(known - size))
    return _usual_in_files(e, beside, nearest, data.scale)


def is_told_by_noise(data: Data, state: State) -> bool:
    """Whether what is left, where noise hangs together, hangs together hardly more than that does.

    Where noise does not, what a likelihood gains is evidence, whatever is left.
    """
    noise = coherence_of_noise(data, state, _BLOCK)
    return noise == 1 or coherence(data, state) <= _HARDLY * noise


def understated(data: Data, state: State) -> float:
    """By how much the variance of noise is understated if a sweep is right, 1 or more.

    Codecs repeat what stands still as it was, and its noise says nothing then of what moves: many
    pixels of any sweep contradict. 1 where noise beside the streak is that of single pixels, or of a
    fine file, and where what is left is too much of the change to be noise.
    """
    if data.of_fine_file or doubtful_share(data, state) <= _MOST_DOUBTFUL:
        return 1.0
    _, beside = _places(data, state)
    repeated = beside.any() and np.median(state.chi2[beside]) < _REPEATED
    if not repeated and _usual(_limited(state), beside) < _HANGS:
        return 1.0
    inside = (state.swept.alpha > 0) & (state.swept.alpha < OPAQUE) & data.valid
    if not inside.any():
        return 1.0
    by = float(np.median(state.chi2[inside])) / _MEDIANS[state.frame.rank]
    noise = by * float(np.mean((data.C_variance + data.B_variance)[inside]))
    change = float(np.mean((data.C - data.B)[inside] ** 2))
    return by if by > 1 and noise < _MOST_NOISE**2 * change else 1.0


def colors_ran_together(data: Data, state: State) -> bool:
    """Whether noise of color is smoother than of single pixels beside the streak, as files make it.

    A lens blurs no noise. Light that changed slowly changes nothing about that.
    """
    _, beside = _places(data, state)
    e = (data.C - data.B) / np.sqrt(data.C_variance + data.B_variance)
    color = e - e.mean(axis=-1, keepdims=True)
    near, far = (_of_pairs(color, beside, apart) for apart in (1, 2))
    return bool(near < _SMOOTH * far)


def _of_pairs(values: Array, use: Bools, apart: int) -> float:
    """Sum of squared differences of pixels so far apart, 1 or 2, of three in a row or column."""
    total = 0.0
    for x, told in ((values, use), (values.swapaxes(0, 1), use.T)):
        all_three = told[2:] & told[1:-1] & told[:-2]
        total += float(np.sum((x[apart:][: len(all_three)] - x[:-2])[all_three] ** 2))
    return total


@cache
def shared_coherence(size: int, scale: float) -> float:
    """How much noise of colors hangs together that 2 by 2 pixels of a file share.

    Between the centers of two such blocks colors are interpolated linearly, as for 4:2:0.

    Parameters
    ----------
    size : int
        Of the blocks of pixels over which it is summed.
    scale : float
        Of the pixels, in pixels of the file.
    """
    pixels = size * int(scale)
    at = (np.arange(4 * pixels) - 0.5) / 2
    weights = np.maximum(1 - np.abs(at[:, None] - np.arange(2 * pixels)), 0)
    of_pixels = weights.reshape(-1, int(scale), weights.shape[1]).mean(axis=1)[size:-size]
    of_blocks = of_pixels.reshape(-1, size, weights.shape[1]).sum(axis=1)
    return float((of_blocks**2).sum() / (of_pixels**2).sum()) ** 2


def can_be(data: Data, state: State) -> bool:
    """Whether a state means something, and of an object no brighter than anything in a picture.

    A shape that is too small needs too much light, a wrong path a color of negative light.
    """
    light = mean_light(data, state)
    possible = light.max() <= BRIGHTEST and light.min() >= -_NEGATIVE * light.max()
    return bool(possible) and means_something(data, state)


def means_something(data: Data, state: State) -> bool:
    """Whether path and color can be told from what is not the object, and something goes that way."""
    return _apart_from_plate(data, state) and stays(data, state) and not _wriggles(state)


def _wriggles(state: State) -> bool:
    """Whether the path turns back twice, or all around, within the object's own width.

    It would go over the same ground several times: whatever noise says can be told that way. Nor does
    it bounce where it goes no further than its radius before and after: a line leaves the same.
    """
    steps = np.diff(state.curve, axis=0) @ np.array([1, 1j])
    turned = float(np.abs(np.angle(steps[1:] * steps[:-1].conj())).sum())
    kink = state.family.kink(state.path)
    if kink is not None:
        xy, _ = state.family.at(state.path, np.array([0, kink, 1]))
        if np.linalg.norm(np.diff(xy, axis=0), axis=1).max() < state.shape[0]:
            return True
    return turned > _BACK and float(np.abs(steps).sum()) < 2 * state.shape[0] * turned


def _apart_from_plate(data: Data, state: State) -> bool:
    """Whether the plate has other colors than the model.

    A plane of the object's and the plate's color explains any picture of theirs, whatever alpha is.
    """
    if state.frame.rank != 2:
        return True
    B = data.B[data.streak & data.valid]
    sines = (B @ state.frame.across) / np.linalg.norm(B, axis=1, keepdims=True)
    return bool(np.median(np.abs(sines)) > _APART)


def stays(data: Data, state: State) -> bool:
    """Whether the path leaves the streak nowhere but where it leaves the picture."""
    xy, _ = state.family.at(state.path, np.linspace(0, 1, _MOMENTS))
    visible = np.all((xy > -0.5) & (xy < np.array(data.size) - 0.5), axis=1)
    at = (xy[visible] - data.origin) / data.scale
    h, w = data.near.shape
    x, y = np.clip(np.rint(at), 0, (w - 1, h - 1)).astype(int).T
    # Large pixels may not reach the picture's end: one of them beyond is still within.
    beyond = np.any((at < -1) | (at > (w, h)), axis=1)
    astray = np.count_nonzero(beyond | ~data.near[y, x])
    return bool(astray <= _ASTRAY * _MOMENTS)


def mostly_seen(data: Data, state: State) -> bool:
    """Whether less than half of a sweep lies where nothing is to be believed."""
    alpha = state.swept.alpha
    return bool(alpha[~data.valid].sum() < _MOST_HIDDEN * alpha.sum())


def doubtful_share(data: Data, state: State) -> float:
    """Share of the streak's pixels that the sweep does not explain."""
    inside = (state.swept.alpha > 0) & data.valid
    return float(np.mean(state.chi2[inside] > _DOUBTFUL)) if inside.any() else 1.0


def _limited(state: State) -> Array:
    """Residuals as the fit limits them; of noise the mean of their squares is 1.

    Across the model is as much noise as it leaves channels; impossible light is more than noise.
    """
    return np.asarray(state.e * np.sqrt(state.belief * len(state.e) / _channels(state)))


def _channels(state: State) -> int:
    """Across the model, or all if it is of any colors."""
    return 3 - state.frame.rank or 3


def _places(data: Data, state: State) -> tuple[Bools, Bools]:
    """Where the sweep and the streak are, but for what any shape explains; and all beside it."""
    near = widened((state.swept.alpha > 0) | data.streak, _BESIDE)
    return near & data.valid & (state.swept.alpha < OPAQUE), ~near & data.valid


def _usual(e: Array, beside: Bools) -> float:
    """How much noise hangs together beside a sweep."""
    return _together(e, beside, _OTHERS, _BLOCK)


def _usual_in_files(e: Array, beside: Bools, size: int, scale: float) -> float:
    """The same for blocks of a size, at least that of shared colors, where noise hangs together."""
    usual = min(_together(e, beside, _OTHERS, size), _MOST_USUAL[size])
    return max(usual, shared_coherence(size, scale))


def _together(e: Array, use: Bools, worst: float, size: int) -> float:
    """Coherence of blocks over that of pixels; 1 where there is nothing."""
    if not use.any():
        return 1.0
    blocks, pixels = (
        _in_blocks(e, use, worst, size),
        _mean_but_worst((e**2).mean(axis=0)[use], worst),
    )
    return blocks / pixels if pixels > 0 else 1.0


def _in_blocks(e: Array, use: Bools, worst: float, size: int) -> float:
    squares = block_squares(np.moveaxis(e, 0, -1), use, size)
    if len(squares) == 0:
        return 1.0
    return _mean_but_worst(squares.mean(axis=1), worst)


def _mean_but_worst(values: Array, worst: float) -> float:
    return float(np.mean(np.sort(values)[: max(int(np.ceil((1 - worst) * len(values))), 1)]))


def mean_light(data: Data, state: State) -> Array:
    """(3,) mean light of the object."""
    alpha = state.swept.alpha * data.weight
    P = data.weight[..., None] * (data.C - (1 - state.swept.alpha)[..., None] * data.B)
    return np.asarray((alpha[..., None] * P).sum(axis=(0, 1)) / max(float((alpha**2).sum()), 1e-9))

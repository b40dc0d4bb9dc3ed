"""The color line from the streak itself: hue variation and feasibility.

In this file, per pixel of the streak, C is the image's light, B the plate's, l a candidate for the
unit direction of the color line, w = B − (B·l) l the plate's part across it, and

    α = 1 − C·w / |w|²          k = (C − (1 − α)B)·l          P = k l

are the closed form's answers. What that cannot explain is the part of C along n = l × B / |l × B|,

    r = n·C = l·(B × C) / |l × B|          s² = Σ n²(σ_C² + (1 − α)²σ_B²).

*Hue variation*: with the true l, r / s is a standard normal at every pixel, whatever α and k. The
published sum of squares of l·(B × C) lacks the denominators; noise makes its minimum the plate's own
color. Divided by what noise alone would cause, no direction is preferred.
*Feasibility*: 0 <= α <= 1, and P is not negative and not brighter than a bound.

Both are likelihoods, so they add. They are evaluated on a grid of directions that adapts to what is
possible; the answer is the mean of what is left, its covariance the spread. A plate of one hue
leaves an arc from the plate's color to the truth and beyond: then there is no answer, and
`ColorModelError` says so.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import check_same_size
from blurmatte.color.model import ColorModel
from blurmatte.errors import ColorModelError
from blurmatte.radiometry import LinearImage, with_noise
from blurmatte.streaks import Streak, require_streaks, shift_variance

Array = npt.NDArray[np.float64]

_MAX_ANGLE_STD = 3.0  # degrees: an answer less certain than this is none
_MAX_SCALE_STD = 0.2  # of the angle to the plate's hue: alpha is uncertain by about this fraction
_MAX_UNEXPLAINED = 0.15  # of the change between plate and image: more is not one paint's
_MAX_IMPOSSIBLE = 0.05  # of the pixels: more cannot be noise
_MAX_PIXELS = 2500  # a regular selection of so many speaks for the streak
_OUTLIER = 3.0  # sigma: beyond, a residual counts linearly, not squared
_TOLERANCE = 2.0  # sigma: an infeasible alpha within this may be noise
_SLACK = 0.02  # of the exposure: an alpha this far outside may be a plate that is not quite right
_BLOCK = 16  # pixels: noise of neighbours this near may be the same noise (JPEG, its halved color)


@dataclass(frozen=True, eq=False)
class _Pixels:
    """The streak's pixels as columns: light, variances and the block each lies in, in its order."""

    C: Array  # (n, 3)
    B: Array  # (n, 3)
    vC: Array  # (n, 3)
    vB: Array  # (n, 3)
    block: npt.NDArray[np.intp]  # (n,)
    neighbors: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]  # blocks that lie side by side

    def every(self, step: int) -> "_Pixels":
        columns = (self.C, self.B, self.vC, self.vB)
        C, B, vC, vB = (a[::step] for a in columns)
        return _Pixels(C, B, vC, vB, self.block[::step], self.neighbors)


def fit_color(
    image: LinearImage,
    plate: LinearImage,
    streak: Streak | None = None,
    max_brightness: float = np.inf,
) -> ColorModel:
    """Find the object's line of colors from its streak alone (in place of [GC07 §3.1]).

    Parameters
    ----------
    image, plate : LinearImage
        The same size; noise that is not known is measured.
    streak : Streak, optional
        Where the object moved; the strongest of `find_streaks` if not given.
    max_brightness : float
        The brightest that the object's largest channel can be, linear light, 1 = sensor white. An
        object that would be clipped if it stood still is brighter than 1, so the default is no bound.

    Returns
    -------
    ColorModel
        Rank 1, with the covariance of its direction and what each kind of evidence says.

    Raises
    ------
    ColorModelError
        If the streak leaves a whole family of colors possible, or no single line explains it. The
        message says what would help.
    MotionError
        If no streak was given and nothing moved.
    """
    check_same_size("image", image.size, "plate", plate.size)
    refuse_gray(image, plate)
    if not max_brightness > 0:
        raise ValueError(f"max_brightness must be positive, got {max_brightness}")
    image, plate = with_noise(image, plate)
    if streak is None:
        streak = require_streaks(image, plate)[0]
    pixels = _streak_pixels(image, plate, streak)
    kinds = {
        name: _Evidence(hue, feasibility, max_brightness)
        for name, hue, feasibility in (
            ("together", True, True), ("hue variation", True, False), ("feasibility", False, True)
        )
    }  # fmt: skip
    spread = {name: _posterior(evidence, pixels) for name, evidence in kinds.items()}
    l, covariance = spread.pop("together")
    evidence = {name: ColorModel(m[:, None], c).angle_std for name, (m, c) in spread.items()}
    model = ColorModel(l[:, None], covariance, evidence)
    _refuse_the_open(model, pixels)
    _refuse_the_unfit(model, pixels)
    return model


def refuse_gray(image: LinearImage, plate: LinearImage) -> None:
    """Raise ColorModelError if either picture has one channel: alpha is told from color."""
    for picture in (image, plate):
        if picture.meta.gray:
            raise ColorModelError(
                f"{picture.meta.source or 'a picture'} is gray: alpha is told from color, so image "
                "and plate must both have it"
            )


def _streak_pixels(image: LinearImage, plate: LinearImage, streak: Streak) -> _Pixels:
    """A regular selection of the streak's usable pixels, ordered by block."""
    height, width = streak.mask.shape
    x0, y0, x1, y1 = streak.box
    box = (
        max(0, x0 - _BLOCK),
        max(0, y0 - _BLOCK),
        min(width, x1 + _BLOCK),
        min(height, y1 + _BLOCK),
    )
    image, plate = image.crop(box), plate.crop(box)
    inside = streak.mask[box[1] : box[3], box[0] : box[2]]
    usable = image.valid & plate.valid
    used = inside & usable
    # Noise that was cut off at black has another mean, which looks like color. The image's noise,
    # for a plate of many frames has little left, but was cut off before.
    for picture in (image, plate):
        used &= (picture.rgb > 2 * np.sqrt(image.variance)).all(axis=-1)
    y, x = np.nonzero(used)
    if len(y) < 20:
        raise ColorModelError(
            f"only {len(y)} pixels of the streak are neither clipped nor before a black plate, 20 are "
            "the least; give the color (--color, model=), or expose otherwise"
        )
    step = max(1, -(-len(y) // _MAX_PIXELS))
    y, x = y[::step], x[::step]
    # Blocks on the grid that JPEG has too, which starts at the picture's corner.
    tile = np.stack([(y + box[1]) // _BLOCK, (x + box[0]) // _BLOCK], axis=1)
    tiles, block = np.unique(tile, axis=0, return_inverse=True)
    order = np.argsort(block, kind="stable")
    y, x = y[order], x[order]
    C, B, vC, vB = (
        np.asarray(a[y, x], dtype=float)
        for a in (
            image.rgb, plate.rgb, image.variance,
            plate.variance + shift_variance(image, plate, usable & ~inside),
        )
    )  # fmt: skip
    least = 1e-12  # float32 light is no better known
    apart = np.abs(tiles[:, None] - tiles[None]).sum(axis=-1)
    first, second = np.nonzero(np.triu(apart == 1))
    return _Pixels(C, B, vC + least, vB + least, block[order], (first, second))


@dataclass(frozen=True, eq=False)
class _Answers:
    """The closed form for every direction and pixel, (directions, pixels) each."""

    n: Array  # (3, directions, pixels) unit vectors across l and B
    r: Array  # what no alpha explains, light
    r_std: Array
    alpha: Array
    alpha_std: Array
    k: Array
    k_std: Array


def _closed_form(l: Array, p: _Pixels) -> _Answers:
    B_l, C_l = l @ p.B.T, l @ p.C.T
    across = np.stack([np.cross(l, axis) for axis in np.eye(3)])  # l × B = Σ B_c (l × e_c)
    n = np.einsum("cgi,pc->igp", across, p.B)  # (3, directions, pixels)
    length = np.sqrt(np.sum(n**2, axis=0)) + 1e-15
    n /= length
    alpha = 1 - (np.sum(p.C * p.B, axis=1) - C_l * B_l) / length**2
    k = C_l - (1 - alpha) * B_l
    through2 = (1 - np.clip(alpha, 0, 1)) ** 2
    w = (p.B.T[:, None, :] - l.T[:, :, None] * B_l) / length
    r_std, w_std, l_std = (
        np.sqrt(
            np.einsum("igp,pi->gp", d**2, p.vC) + through2 * np.einsum("igp,pi->gp", d**2, p.vB)
        )
        for d in (n, w, np.broadcast_to(l.T[:, :, None], n.shape))
    )
    r = (l @ np.cross(p.B, p.C).T) / length
    alpha_std = w_std / length
    return _Answers(n, r, r_std, alpha, alpha_std, k, np.hypot(l_std, B_l * alpha_std))


@dataclass(frozen=True)
class _Evidence:
    """Which kinds of evidence to listen to."""

    hue: bool
    feasibility: bool
    max_brightness: float

    def cost(self, a: _Answers, l: Array) -> Array:
        """(directions, pixels) −2 log likelihood, with tails that outliers may sit in."""
        cost = np.zeros_like(a.r)
        if self.hue:
            cost += _bounded(a.r / a.r_std)
        if self.feasibility:
            cost += _infeasibility(a, l, self.max_brightness)
        return cost


def _infeasibility(a: _Answers, l: Array, max_brightness: float) -> Array:
    """(directions, pixels) how far beyond noise α, P or the brightness leave what is possible."""
    beyond = [(np.maximum(-a.alpha, a.alpha - 1) - _SLACK) / a.alpha_std, -a.k / a.k_std]
    if np.isfinite(max_brightness):
        excess = a.k * l.max(axis=1)[:, None] - max_brightness * a.alpha
        beyond.append(excess / np.hypot(a.k_std, max_brightness * a.alpha_std))
    return _bounded(np.sqrt(sum(np.maximum(z - _TOLERANCE, 0) ** 2 for z in beyond)))


def _bounded(z: Array) -> Array:
    """z² for small z; grows only like |z| for outliers."""
    return np.asarray(2 * _OUTLIER**2 * (np.sqrt(1 + (z / _OUTLIER) ** 2) - 1))


def _posterior(evidence: _Evidence, pixels: _Pixels) -> tuple[Array, Array]:
    """Mean direction and (3, 3) covariance of what the cost leaves possible.

    A grid of directions around the best one is turned and stretched until it reaches four standard
    deviations either way along both axes of the spread. Where the spread is a narrow valley, as
    before a plate of one hue, the grid first finds its width and then grows along it.
    """
    best = _best_direction(evidence, pixels)
    phi = _misfit(best, pixels)
    center, axes, half = best, _tangent(best), np.full(2, np.radians(1.0))
    widest = best, np.zeros((3, 3))
    for _ in range(60):
        grid = np.vstack([best, _patch(center, axes, half)])
        mean, covariance = _moments(grid, _implausibility(evidence, grid, pixels, phi))
        spread, turned = np.linalg.eigh(axes.T @ covariance @ axes)
        reach = half[_order(turned)]
        std = np.sqrt(np.maximum(spread, (half.max() / 1e6) ** 2))
        aside = np.abs((mean - center) @ axes @ turned)
        if np.all((std > reach / 8) & (std < reach / 3) & (aside < reach / 4)):
            return mean, covariance
        if np.trace(covariance) > np.trace(widest[1]):
            widest = mean, covariance
        if half.max() > 1:
            break
        center, axes = _moved(axes @ turned, mean)
        half = np.clip(4 * std, reach / 4, 3 * reach)
    return widest  # a valley too long or too narrow for any grid: what was seen of it


def _order(turned: Array) -> npt.NDArray[np.intp]:
    """Which old axis each new one mostly is."""
    order: npt.NDArray[np.intp] = np.argmax(np.abs(turned), axis=0)
    return order


def _moved(axes: Array, to: Array) -> tuple[Array, Array]:
    """The new center, and the axes made perpendicular to it."""
    first = _unit(axes[:, 1] - (axes[:, 1] @ to) * to)
    return to, np.stack([np.cross(to, first), first], axis=1)


def _best_direction(evidence: _Evidence, pixels: _Pixels) -> Array:
    """The least cost over all directions of non-negative light: a grid, then a polish."""
    few = pixels.every(max(1, len(pixels.C) // 500))
    grid = _octant(2.0)
    total = evidence.cost(_closed_form(grid, few), grid).sum(axis=1)
    found = []
    for _ in range(3):
        start = grid[np.argmin(total)]
        total[grid @ start > np.cos(np.radians(15))] = np.inf
        found.append(_polished(evidence, few, start, 1.5))
    return _polished(evidence, pixels, min(found, key=lambda f: f[1])[0], 0.1)[0]


def _polished(
    evidence: _Evidence, pixels: _Pixels, start: Array, reach: float
) -> tuple[Array, float]:
    """The direction of least cost near another one, about `reach` degrees around; and that cost."""
    from scipy.optimize import minimize

    tangent = _tangent(start)

    def cost(x: Array) -> float:
        l = _unit(start + tangent @ x)[None]
        return float(evidence.cost(_closed_form(l, pixels), l).sum()) if l.min() >= 0 else np.inf

    simplex = np.radians(reach) * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    options = {"initial_simplex": simplex, "xatol": 1e-8, "fatol": 1e-4}
    found = minimize(cost, np.zeros(2), method="Nelder-Mead", options=options)
    return _unit(start + tangent @ found.x), float(found.fun)


def _octant(step: float) -> Array:
    """(g, 3) unit directions of non-negative light about `step` degrees apart."""
    theta = np.radians(np.arange(step / 2, 90, step))  # from the blue axis
    count = np.maximum(1, np.rint(90 * np.sin(theta) / step)).astype(int)
    t = np.repeat(theta, count)
    nth = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    phi = (nth + 0.5) * np.pi / 2 / np.repeat(count, count)
    return np.stack([np.sin(t) * np.cos(phi), np.sin(t) * np.sin(phi), np.cos(t)], axis=1)


def _tangent(l: Array) -> Array:
    return np.asarray(np.linalg.svd(l[:, None])[0][:, 1:])


def _patch(center: Array, axes: Array, half: Array, count: int = 17) -> Array:
    """Directions around one, `half` to either side along the two axes, within non-negative light.

    Great circles are straight lines here, and so are the valleys that a plate of one hue leaves.
    """
    steps = np.linspace(-1, 1, count)
    u, v = np.meshgrid(half[0] * steps, half[1] * steps)
    moved = center + np.stack([u.ravel(), v.ravel()], axis=1) @ axes.T
    grid = moved[(moved >= 0).all(axis=1)]
    return np.asarray(grid / np.linalg.norm(grid, axis=1, keepdims=True))


def _moments(grid: Array, cost: Array) -> tuple[Array, Array]:
    """Mean direction and covariance under exp(−cost / 2)."""
    weight = np.asarray(np.exp(-0.5 * (cost - cost.min())))
    weight /= weight.sum()
    center = _unit(weight @ grid)
    away = grid - center
    return center, np.asarray((away * weight[:, None]).T @ away)


def _implausibility(evidence: _Evidence, l: Array, p: _Pixels, phi: float) -> Array:
    """(directions,) χ² against each direction, next to the best of them.

    The excess Δ of a direction's cost over the least comes from a true difference λ and from noise
    of variance V that has nothing to do with it: two directions see one pixel's noise differently,
    with a correlation ρ. If that direction were the truth, Δ would be −λ with the variance 4λ + V.
    The λ that speaks least against it gives

        χ² = Δ² / V          for Δ < V / 2
             Δ − V / 4       beyond,                  V = Σ 4(1 − ρ²).

    Both are widened by φ, `phi`, see `_misfit`.
    """
    a = _closed_form(l, p)
    cost = evidence.cost(a, l)
    best = np.argmin(cost.sum(axis=1))
    delta = np.sum(cost - cost[best], axis=1)
    if not evidence.hue:
        return np.asarray(delta / phi)
    through = 1 - np.clip(a.alpha, 0, 1)
    both = a.n * a.n[:, best : best + 1]
    shared = np.einsum("igp,pi->gp", both, p.vC)
    shared += through * through[best] * np.einsum("igp,pi->gp", both, p.vB)
    rho = shared / (a.r_std * a.r_std[best])
    V = 4 * phi * np.sum(np.maximum(1 - rho**2, 0), axis=1) + 1e-12
    return np.asarray(np.where(delta < V / 2, delta**2 / V, delta - V / 4) / phi)


def _misfit(l: Array, p: _Pixels) -> float:
    """By how much to widen a variance, for residuals that are not independent noise; 1 or more.

    The sums of z = r / s over m blocks scatter φ times as much as for independent pixels, where
    neighbours share noise (JPEG) or the model misses something (a highlight, a second paint, a
    shadow). What it misses is alike from block to block, so more blocks do not average it away: the
    correlation of blocks side by side, and one standard deviation of it to be safe, says how much
    of it all of them share.
    """
    answers = _closed_form(l[None], p)
    z = np.clip(answers.r / answers.r_std, -_OUTLIER, _OUTLIER)[0]
    sums = np.bincount(p.block, z)
    phi = max(1.0, float(np.sum(sums**2)) / len(z))
    first, second = p.neighbors
    shared = np.sum(sums[first] * sums[second])
    both = np.sqrt(np.sum(sums[first] ** 2) * np.sum(sums[second] ** 2)) + 1e-12
    correlation = float(shared / both) + 1 / np.sqrt(max(len(first), 1))
    alike = min(max(correlation, 0.0), 1.0) * min(phi - 1, 1)
    return float(phi * (1 + (len(sums) - 1) * alike))


def _refuse_the_open(model: ColorModel, pixels: _Pixels) -> None:
    B = pixels.B / np.linalg.norm(pixels.B, axis=1, keepdims=True)
    near = float(np.degrees(np.sqrt(np.mean(np.arccos(np.clip(B @ model.pole, -1, 1)) ** 2))))
    if model.angle_std <= min(_MAX_ANGLE_STD, _MAX_SCALE_STD * near):
        return
    spread = np.degrees(np.sqrt(np.mean(1 - np.clip(B @ _unit(B.mean(axis=0)), -1, 1) ** 2)))
    said = ", ".join(f"{name} leaves {std:.1f}°" for name, std in model.evidence.items())
    why = f"{said}; the plate's hue is {near:.0f}° away and varies by {spread:.1f}° behind it"
    if _misfit(model.pole, pixels) > 9:
        why += "; the colors do not lie on one line: a highlight, a second color, or a shadow"
    raise ColorModelError(
        f"the streak leaves the object's color open by {model.angle_std:.1f}° ({why}): give the "
        "color (--color, model=), pick pixels of the object where it is sharp or opaque, or bound "
        "its brightness"
    )


def _refuse_the_unfit(model: ColorModel, pixels: _Pixels) -> None:
    a = _closed_form(model.basis.T, pixels)
    unexplained = float(np.sum(a.r**2 - a.r_std**2))
    moved = float(np.sum((pixels.C - pixels.B) ** 2 - pixels.vC - pixels.vB))
    impossible = np.maximum(-a.alpha, a.alpha - 1) > np.maximum(3 * a.alpha_std, 2 * _SLACK)
    if unexplained > _MAX_UNEXPLAINED**2 * moved or np.mean(impossible) > _MAX_IMPOSSIBLE:
        raise ColorModelError(
            "no single line of colors explains the streak: the best leaves "
            f"{np.sqrt(max(unexplained / moved, 0)):.0%} of the change, and {np.mean(impossible):.0%} "
            "of the pixels with an alpha below 0 or above 1; give the colors of the object (--color, "
            "model=; two with rank 2), or choose a region with one object and without its shadow"
        )


def _unit(v: Array) -> Array:
    return np.asarray(v / np.linalg.norm(v))

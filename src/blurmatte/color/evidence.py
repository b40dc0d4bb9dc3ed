"""How plausible a direction of the color line is, from the pixels of a streak.

In this file, per pixel of the streak, C is the image's light, B the plate's, l a candidate for the
unit direction of the color line, w = B − (B·l) l the plate's part across it, and

    α = 1 − C·w / |w|²          k = (C − (1 − α)B)·l          P = k l

are the closed form's answers. What that cannot explain is the part of C along n = l × B / |l × B|,

    r = n·C = l·(B × C) / |l × B|          s² = Σ n²(σ_C² + (1 − α)²σ_B²).

*Hue variation*: with the true l, r / s is a standard normal at every pixel, whatever α and k. The
published sum of squares of l·(B × C) lacks the denominators; noise makes its minimum the plate's own
color. Divided by what noise alone would cause, no direction is preferred.
*Feasibility*: 0 <= α <= 1, and P is not negative and not brighter than a bound.

Both are likelihoods, so they add.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

_OUTLIER = 3.0  # sigma: beyond, a residual counts linearly, not squared
_EFFICIENCY = 1.131  # E[ψ′] / E[ψ²] over normal z, with ψ half the slope of that loss
_TOLERANCE = 2.0  # sigma: an infeasible alpha within this may be noise
SLACK = 0.02  # of the exposure: an alpha this far outside may be a plate that is not quite right
_NOISE_DOUBT = 0.3  # of the plate's noise variance: it may be measured wrong by this fraction


@dataclass(frozen=True, eq=False)
class Pixels:
    """The streak's pixels as columns: light, variances, the block and the tile that each lies in.

    They are in the order of blocks, and within these of tiles.
    """

    C: Array  # (n, 3)
    B: Array  # (n, 3)
    vC: Array  # (n, 3)
    vB: Array  # (n, 3)
    block: npt.NDArray[np.intp]  # (n,) over which noise may be the same
    tile: npt.NDArray[np.intp]  # (n,) over which alpha is much the same
    neighbors: tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]  # blocks that lie side by side

    def every(self, step: int) -> "Pixels":
        """Every so many of them."""
        columns = (self.C, self.B, self.vC, self.vB)
        C, B, vC, vB = (a[::step] for a in columns)
        return Pixels(C, B, vC, vB, self.block[::step], self.tile[::step], self.neighbors)


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
    through: Array  # 1 − α as the weights know it


def closed_form(l: Array, p: Pixels) -> _Answers:
    """What every direction l, (directions, 3), makes of every pixel."""
    B_l, C_l = l @ p.B.T, l @ p.C.T
    across = np.stack([np.cross(l, axis) for axis in np.eye(3)])  # l × B = Σ B_c (l × e_c)
    n = np.einsum("cgi,pc->igp", across, p.B)  # (3, directions, pixels)
    length = np.sqrt(np.sum(n**2, axis=0)) + 1e-15
    n /= length
    alpha = 1 - (np.sum(p.C * p.B, axis=1) - C_l * B_l) / length**2
    k = C_l - (1 - alpha) * B_l
    through = 1 - np.clip(_means(alpha, length**2, p.tile), 0, 1)
    through2 = through**2
    w = (p.B.T[:, None, :] - l.T[:, :, None] * B_l) / length
    r_std, w_std, l_std = (
        np.sqrt(
            np.einsum("igp,pi->gp", d**2, p.vC) + through2 * np.einsum("igp,pi->gp", d**2, p.vB)
        )
        for d in (n, w, np.broadcast_to(l.T[:, :, None], n.shape))
    )
    r = (l @ np.cross(p.B, p.C).T) / length
    alpha_std = w_std / length
    return _Answers(n, r, r_std, alpha, alpha_std, k, np.hypot(l_std, B_l * alpha_std), through)


def _means(alpha: Array, weight: Array, tile: npt.NDArray[np.intp]) -> Array:
    """(directions, pixels) weighted mean of α over each pixel's tile.

    A pixel's own α, cut off at 0 and 1, would make the variance too small wherever it is noisy: for
    some directions more than for others, which looks like evidence. So would that of pixels further
    away, where α is another.
    """
    first = np.flatnonzero(np.diff(tile, prepend=-1))
    sums, weights = (np.add.reduceat(x, first, axis=1) for x in (alpha * weight, weight))
    return np.repeat(sums / (weights + 1e-30), np.diff(first, append=len(tile)), axis=1)


@dataclass(frozen=True)
class Evidence:
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
    beyond = [(np.maximum(-a.alpha, a.alpha - 1) - SLACK) / a.alpha_std, -a.k / a.k_std]
    if np.isfinite(max_brightness):
        brightest = l.max(axis=1)[:, None]
        excess = a.k * brightest - max_brightness * np.maximum(a.alpha, 0)
        beyond.append(excess / np.hypot(a.k_std * brightest, max_brightness * a.alpha_std))
    return _bounded(np.sqrt(sum(np.maximum(z - _TOLERANCE, 0) ** 2 for z in beyond)))


def _bounded(z: Array) -> Array:
    """z² for small z, like |z| for outliers; scaled so that its spread is right for normal z."""
    return np.asarray(_EFFICIENCY * 2 * _OUTLIER**2 * (np.sqrt(1 + (z / _OUTLIER) ** 2) - 1))


def implausibility(evidence: Evidence, l: Array, p: Pixels, phi: float) -> Array:
    """(directions,) χ² against each direction, next to the best of them.

    The excess Δ of a direction's cost over the least comes from a true difference λ and from noise
    of variance V that has nothing to do with it: two directions see one pixel's noise differently,
    with a correlation ρ. If that direction were the truth, Δ would be −λ with the variance 4λ + V.
    The λ that speaks least against it gives

        χ² = Δ² / V          for Δ < V / 2
             Δ − V / 4       beyond,                  V = Σ 4(1 − ρ²).

    Both are widened by φ, `phi`, see `misfit`.
    """
    a = closed_form(l, p)
    cost = evidence.cost(a, l)
    best = np.argmin(cost.sum(axis=1))
    delta = np.sum(cost - cost[best], axis=1)
    if not evidence.hue:
        return np.asarray(delta / phi)
    both = a.n * a.n[:, best : best + 1]
    shared = np.einsum("igp,pi->gp", both, p.vC)
    shared += a.through * a.through[best] * np.einsum("igp,pi->gp", both, p.vB)
    rho = shared / (a.r_std * a.r_std[best])
    V = 4 * phi * np.sum(np.maximum(1 - rho**2, 0), axis=1) + 1e-12
    # A wrong measure of the plate's noise errs alike for all pixels, and looks like evidence.
    plate = a.through**2 * np.einsum("igp,pi->gp", a.n**2, p.vB) / a.r_std**2
    V += (_NOISE_DOUBT * np.sum(plate - plate[best], axis=1)) ** 2
    return np.asarray(np.where(delta < V / 2, delta**2 / V, delta - V / 4) / phi)


def misfit(l: Array, p: Pixels) -> float:
    """By how much to widen a variance, for residuals that are not independent noise; 1 or more.

    The sums of z = r / s over m blocks scatter φ times as much as for independent pixels, where
    neighbors share noise (JPEG) or the model misses something (a highlight, a second paint, a
    shadow). What it misses is alike from block to block, so more blocks do not average it away: the
    correlation of blocks side by side, and one standard deviation of it to be safe, says how much
    of it all of them share.
    """
    answers = closed_form(l[None], p)
    z = np.clip(answers.r / answers.r_std, -_OUTLIER, _OUTLIER)[0]
    sums = np.bincount(p.block, z)
    phi = max(1.0, float(np.sum(sums**2)) / len(z))
    first, second = p.neighbors
    shared = np.sum(sums[first] * sums[second])
    both = np.sqrt(np.sum(sums[first] ** 2) * np.sum(sums[second] ** 2)) + 1e-12
    correlation = float(shared / both) + 1 / np.sqrt(max(len(first), 1))
    beyond_chance = np.clip(phi - 1 - 2 * np.sqrt(2 / len(sums)), 0, 1)
    alike = min(max(correlation, 0.0), 1.0) * beyond_chance
    return float(phi * (1 + (len(sums) - 1) * alike))

"""Statistical constants and small estimators, each once.

Demosaicing, compression and chroma subsampling correlate the noise of neighbors. Here the variance
inflation of a block is the variance of its sum over that of independent pixels: 1 for white noise, the
number of pixels if all of them have the same error. It is n / effective n.
"""

from collections.abc import Sequence
from itertools import combinations

import numpy as np
import numpy.typing as npt
import scipy

from blurmatte.checks import Array, Bools, Floats

# Units of log likelihood, about 150 to 1: decisive on the scale of Kass and Raftery (1995).
DECISIVE_LOG_BAYES_FACTOR = 5.0
MEDIAN_1 = 0.455  # median of χ² with one degree of freedom
MEDIAN_3 = 2.366  # median of χ² with three degrees of freedom, one for each channel
QUANTILE_999_1, QUANTILE_999_3 = 10.83, 16.27  # 99.9 % quantiles of both
MAD_TO_STD = 1.4826  # 1 / Φ⁻¹(3/4): standard deviation of normal numbers over their median size
MAX_RESIDUAL_STD = 4.0  # beyond, pixels are outliers: they determine no gain or match of a picture
UNIFORM_VARIANCE = 1 / 12  # of a number with equal density over one unit
UNKNOWN_FRACTION = float(np.sqrt(1 / 3))  # root mean square of a fraction of which nothing is known
BLOCK_SIZES = (2, 4, 8, 16)  # pixels: compressed files have blocks of up to 16
# Widths of blocks of pixels over which the correlation of noise and of residuals is measured: the noise
# of files and the residuals of wrong shapes correlate over such distances
CORRELATED_PX = (4, 8)
_CORE, _CORE_MEAN = 0.9, 0.623  # lower fraction of χ² of one degree of freedom, and its mean


def chi_square_quantile(probability: float, degrees_of_freedom: npt.ArrayLike) -> Array:
    """Value below which χ² of (...) degrees of freedom, above 0, lies with a probability."""
    return np.asarray(
        2 * scipy.special.gammaincinv(np.asarray(degrees_of_freedom) / 2, probability)
    )


def robust_std(deviations: Floats) -> float:
    """Standard deviation of normal numbers about zero, from the median of their absolute values.

    There is at least one deviation. Up to half may be outliers, if these are on both sides.
    """
    return MAD_TO_STD * float(np.median(np.abs(deviations)))


def student_loss(chi2: Array, freedom: float, count: npt.ArrayLike) -> Array:
    """Minus the log likelihood (Student's t) of χ², the squared residuals of `count` numbers each.

    It is 0 without residuals. The fewer degrees of freedom, the more outliers are expected.
    """
    return np.asarray((freedom + np.asarray(count)) / 2 * np.log1p(chi2 / freedom))


def student_weight(chi2: Array, freedom: float, count: npt.ArrayLike) -> Array:
    """Weight of χ² in iteratively reweighted least squares: twice the slope of `student_loss`."""
    return np.asarray((freedom + np.asarray(count)) / (freedom + chi2))


def block_sums(values: Floats, size: int) -> Floats:
    """(H // size, W // size, ...) sums over blocks; an incomplete last row or column is dropped."""
    h, w = (side // size * size for side in values.shape[:2])
    cut = values[:h, :w]
    if size == 1:
        return cut
    # Rows, then columns: several times as fast as a sum over two axes.
    rows = cut[::size].copy()
    for i in range(1, size):
        rows += cut[i::size]
    sums = rows[:, ::size].copy()
    for i in range(1, size):
        sums += rows[:, i::size]
    return sums


def cell_means(values: Floats, side: int) -> Floats:
    """(H // side, W // side, ...) means over blocks; an incomplete last row or column is dropped."""
    sums = block_sums(values, side)
    return sums if side == 1 else np.asarray(sums / side**2)


def seen_means(values: Floats, seen: Bools, size: int) -> tuple[Array, Array]:
    """(h, w, channels) means over the pixels of blocks that are seen, 0 for none, and their number."""
    count = block_sums(seen.astype(float), size)
    sums = block_sums(np.where(seen[..., None], values, 0), size)
    return np.asarray(sums / np.maximum(count, 1)[..., None]), np.asarray(count, float)


def window_sums(values: Floats | Bools, width: int, mode: str = "reflect") -> Array:
    """(H, W) sums over a window around each pixel; beyond the picture by a mode of SciPy."""
    return np.asarray(
        scipy.ndimage.uniform_filter(values.astype(float), width, mode=mode) * width**2
    )


def block_squares(e: Floats, use: Bools, size: int) -> Array:
    """(K, channels) squared block sums, each over the number of pixels summed.

    Their mean is the variance of a pixel if pixels are independent. Only blocks count of which more
    than half is used; an incomplete last row or column is dropped.

    e (H, W, channels): noise, of mean zero.
    use (H, W): the pixels to sum.
    size: width of a block, pixels.
    """
    count = block_sums(use.astype(float), size)
    full = count > size**2 / 2
    squares: Floats = block_sums(np.where(use[..., None], e, 0), size)[full] ** 2
    return squares / count[full][:, None]


def mean_of_blocks(e: Floats, use: Bools, size: int, channels: int, trimmed: float = 0.0) -> float:
    """Mean of the `block_squares` of one channel, without the largest; 1 if there is no block."""
    squares = block_squares(e, use, size)
    return trimmed_mean(squares.sum(axis=1) / channels, trimmed) if len(squares) else 1.0


def trimmed_mean(values: Array, trimmed: float) -> float:
    """Mean without this fraction of the values, the largest."""
    kept = max(int(np.ceil((1 - trimmed) * len(values))), 1)
    return float(np.mean(np.sort(values)[:kept]))


def variance_inflation(e: Floats, use: Bools) -> Array:
    """(channels, 4) variance inflation over blocks of `BLOCK_SIZES`.

    1 for blocks larger than the region used. The parameters are those of `block_squares`.
    """
    single = block_squares(e, use, 1).mean(axis=0) if use.any() else np.zeros(e.shape[-1])
    columns = []
    for size in BLOCK_SIZES:
        squares = block_squares(e, use, size)
        known = (single > 0) & (len(squares) > 0)
        total = squares.mean(axis=0) if len(squares) else np.ones_like(single)
        columns.append(np.where(known, total / np.where(known, single, 1), 1.0))
    return np.stack(columns, axis=-1)


def relative_difference(a: Array, b: Array) -> float:
    """Root mean square difference of two maps, of the larger root mean square of both."""
    energy = max(float((a**2).sum()), float((b**2).sum()), 1e-9)
    return float(np.sqrt(((a - b) ** 2).sum() / energy))


def core_mean_square(squares: Floats) -> float:
    """Variance of normal numbers from the lower 90 % of their squares; 1 if there are none.

    Up to a tenth of the squares may be of outliers.
    """
    if len(squares) == 0:
        return 1.0
    last = int(np.ceil(_CORE * len(squares)))
    return float(np.partition(squares, last - 1)[:last].mean()) / _CORE_MEAN


def significant_inflation(squares: Floats, independent: int) -> float:
    """Variance inflation from squared standardized block sums; 1 if not significant.

    squares (N,): squares of block sums over their standard deviation for independent pixels.
    independent: how many of them are statistically independent.
    """
    if independent == 0 or len(squares) == 0:
        return 1.0
    factor = core_mean_square(squares)
    # By 2.5 standard deviations of the mean square.
    return factor if factor > 1 + 2.5 * np.sqrt(2 / independent) else 1.0


def pooled_log_odds(odds: Sequence[tuple[float, float]], mistake_probability: float) -> Array:
    """(2,) sums of log Bayes factors of frames, each of which may mislead: that bounds what it says."""
    each = np.array(odds, float).reshape(-1, 2)
    mistake, right = np.log(mistake_probability), np.log1p(-mistake_probability)
    bounded = np.logaddexp(right + each, mistake) - np.logaddexp(right, mistake + each)
    return np.asarray(bounded.sum(axis=0))


def nonnegative_least_squares(A: Array, y: Array) -> Array:
    """(k,) x >= 0 that minimizes |A x − y|, for few columns (n, k): the best of all sets of them.

    Columns beyond the rank of the others have the coefficient 0. `scipy.optimize` has the same for
    many columns, but takes a third of a second to import.
    """
    scale = np.linalg.norm(A, axis=0)
    unit = A / np.where(scale > 0, scale, 1)
    best, least = np.zeros(A.shape[1]), float(y @ y)
    for count in range(1, A.shape[1] + 1):
        for some in map(list, combinations(range(A.shape[1]), count)):
            x, _, rank, _ = np.linalg.lstsq(unit[:, some], y, rcond=None)
            rest = unit[:, some] @ x - y
            if rank == count and x.min() >= 0 and rest @ rest < least:
                best, least = np.zeros(A.shape[1]), float(rest @ rest)
                best[some] = x / scale[some]
    return best


def scaled_inverse(matrix: Array) -> Array:
    """Inverse of a symmetric matrix (k, k) whose rows have different units, such as an information.

    In directions in which it is 0, as those of parameters that are fixed, the inverse is 0 too. Rows
    are scaled to a diagonal of 1 before that is decided.
    """
    scale = np.sqrt(np.abs(np.diag(matrix)))
    scale = np.where(scale > 0, scale, 1.0)
    inverse = np.linalg.pinv(matrix / scale / scale[:, None], hermitian=True)
    return np.asarray(inverse / scale / scale[:, None], float)


def larger_covariance(one: Array, other: Array) -> Array:
    """The covariance (n, n) that has the larger variance of two along each direction of both.

    Along these directions, the eigenvectors of one in units of the sum, both are diagonal.
    """
    total = one + other
    scale = np.sqrt(np.maximum(np.diag(total), np.finfo(float).tiny))
    values, axes = np.linalg.eigh(total / np.outer(scale, scale))
    known = values > len(values) * np.finfo(float).eps * values.max()
    lengths, axes = np.sqrt(values[known]), axes[:, known]
    root, inverse = scale[:, None] * axes * lengths, axes / scale[:, None] / lengths
    part, directions = np.linalg.eigh(inverse.T @ one @ inverse)
    root = (root @ directions) * np.sqrt(np.maximum(part, 1 - part))
    return np.asarray(root @ root.T)

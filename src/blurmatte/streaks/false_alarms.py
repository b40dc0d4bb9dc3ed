"""How many streaks as strong as one that was found the noise or compression of a picture yields.

The picture is divided into tiles. The largest T of a tile where nothing moved has an extreme-value
distribution; that of compression has a heavy tail, so that log T is taken as Gumbel (T as Fréchet).
Its two parameters follow from two quantiles of the tiles, and the expected number of tiles of the
picture above a T from these.
"""

from collections.abc import Sequence

import numpy as np

from blurmatte.checks import Bools, Floats

MAX_EXPECTED = 0.05  # false streaks in a picture: a streak with fewer is significant
_TILE_CELLS = 8, 32  # at least: T is correlated over fewer; at most
_TILES_PER_SIDE = 16  # between these limits
_QUANTILES = 0.5, 0.95  # of the tiles' largest T; above it is what did move


def expected_false(T: Floats, parts: Sequence[Bools]) -> list[float]:
    """For each part of the cells, the number of equally strong ones that are due to noise.

    T (h, w): the test statistic, see `evidence`. parts: masks (h, w), at least one. Noise does not fill
    a tile: a larger part counts as 0, and its tiles are left out, as are those of the strongest part.
    """
    tile = int(np.clip(np.sqrt(T.size) / _TILES_PER_SIDE, *_TILE_CELLS))
    tops = _largest(T, tile)
    strongest = max(float(T[part].sum()) for part in parts)
    large = [
        np.count_nonzero(part) > tile**2 or float(T[part].sum()) == strongest for part in parts
    ]
    moved = np.zeros(tops.shape, bool)
    for part in (part for part, is_large in zip(parts, large, strict=True) if is_large):
        moved |= _largest(part, tile)
    still = np.log(np.maximum(tops[~moved], 1e-3))
    if still.size < 2:
        return [0.0] * len(parts)
    low, high = np.quantile(still, _QUANTILES)
    reduced = [-np.log(-np.log(q)) for q in _QUANTILES]
    spread = max(float(high - low) / (reduced[1] - reduced[0]), 1e-3)
    middle = float(low) - spread * reduced[0]
    excess = [(np.log(float(T[part].max())) - middle) / spread for part in parts]
    expected = [float(tops.size * -np.expm1(-np.exp(-one))) for one in excess]
    return [0.0 if is_large else e for is_large, e in zip(large, expected, strict=True)]


def _largest(values: Floats | Bools, tile: int) -> Floats:
    """The largest value of each tile; those at the right and lower border may be smaller."""
    rows = np.maximum.reduceat(values, np.arange(0, values.shape[0], tile), axis=0)
    return np.asarray(np.maximum.reduceat(rows, np.arange(0, values.shape[1], tile), axis=1))

"""A curve through the middle of a streak, and the half width of it: where a fit can begin."""

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]
Bools = npt.NDArray[np.bool_]

_POINTS = 33


def center_curve(mask: Bools) -> tuple[Array, float]:
    """Points (m, 2) equally far from each other along a streak, and its half width, pixels.

    The middle of the pixels at equal distance from one end, on ways within the mask; the ends lie a
    half width inside those of the mask.
    """
    from scipy.ndimage import binary_fill_holes, distance_transform_edt

    mask = np.pad(binary_fill_holes(mask), 1)
    depth = distance_transform_edt(mask)
    half_width = float(depth.max())
    along = _distance_from_an_end(mask)
    steps = np.arange(0, np.nanmax(along) + 1, max(half_width / 4, 1))
    which = np.digitize(along[mask], steps)
    y, x = np.nonzero(mask)
    count = np.bincount(which)
    points = np.stack([np.bincount(which, v)[count > 0] / count[count > 0] for v in (x, y)], axis=1)
    return _trimmed(points - 1, half_width), half_width


def _distance_from_an_end(mask: Bools) -> Array:
    """(h, w) length of the shortest way within the mask from the pixel farthest from any one."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    index = np.full(mask.shape, -1)
    index[mask] = np.arange(np.count_nonzero(mask))
    ways = [(0, 1, 1.0), (1, 0, 1.0), (1, 1, np.sqrt(2)), (1, -1, np.sqrt(2))]
    rows, columns, lengths = [], [], []
    for dy, dx, length in ways:
        a = index[: mask.shape[0] - dy, max(0, -dx) : mask.shape[1] - max(0, dx)]
        b = index[dy:, max(0, dx) : mask.shape[1] - max(0, -dx)]
        both = (a >= 0) & (b >= 0)
        rows.append(a[both])
        columns.append(b[both])
        lengths.append(np.full(np.count_nonzero(both), length))
    n = np.count_nonzero(mask)
    graph = coo_array(
        (np.concatenate(lengths), (np.concatenate(rows), np.concatenate(columns))), (n, n)
    )
    graph = graph.tocsr()
    first = dijkstra(graph, directed=False, indices=0)
    end = int(np.argmax(np.where(np.isfinite(first), first, -1)))
    distance = dijkstra(graph, directed=False, indices=end)
    along = np.full(mask.shape, np.nan)
    along[mask] = np.where(np.isfinite(distance), distance, 0)
    return along


def _trimmed(points: Array, by: float) -> Array:
    """Equally spaced points of a polyline, shorter by so much at both ends, but never turned."""
    s = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    cut = min(by, 0.45 * s[-1])
    at = np.linspace(cut, s[-1] - cut, _POINTS)
    return np.stack([np.interp(at, s, points[:, i]) for i in (0, 1)], axis=1)

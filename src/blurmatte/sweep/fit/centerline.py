"""Curves through the middle of a streak, from which fits start."""

import numpy as np

from blurmatte.checks import Array, Bools


def depth_of(mask: Bools) -> Array:
    """(h + 2, w + 2) distance of each pixel of a streak and its holes from the outside, pixels.

    Padded by one pixel; the largest is the radius of the largest disc that fits.
    """
    from scipy.ndimage import binary_fill_holes, distance_transform_edt

    return np.asarray(distance_transform_edt(np.pad(binary_fill_holes(mask), 1)))


def center_curve(depth: Array, radius: float) -> Array:
    """Equally spaced points (m, 2) of a path of a disc of this radius within the streak.

    A disc lies within the streak if its center lies in the streak's core, the pixels as deep as its
    radius. The curve joins the means of the pixels at equal geodesic distance from one end of the core;
    a core without length gives a short line.
    """
    from scipy.ndimage import label

    parts, _ = label(depth >= min(radius, float(depth.max())))
    core = parts == np.argmax(np.bincount(parts[parts > 0]))
    along = _distance_from_an_end(core)
    steps = np.arange(0, np.nanmax(along) + 1, max(radius / 4, 1))
    which = np.digitize(along[core], steps)
    y, x = np.nonzero(core)
    count = np.bincount(which)
    points = np.stack([np.bincount(which, v)[count > 0] / count[count > 0] for v in (x, y)], axis=1)
    length = float(np.sum(np.linalg.norm(np.diff(points, axis=0), axis=1)))
    if length < radius / 2:
        points = _along_main_axis(depth > 0, radius / 2)
    return _evenly(points - 1)


def _distance_from_an_end(mask: Bools) -> Array:
    """(h, w) geodesic distance within the mask from one of its ends, pixels."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import dijkstra

    index = np.full(mask.shape, -1)
    index[mask] = np.arange(np.count_nonzero(mask))
    edges = [(0, 1, 1.0), (1, 0, 1.0), (1, 1, np.sqrt(2)), (1, -1, np.sqrt(2))]
    rows, columns, lengths = [], [], []
    for dy, dx, length in edges:
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


def _along_main_axis(mask: Bools, length: float) -> Array:
    """Both ends (2, 2) of a line through the middle of a region."""
    y, x = np.nonzero(mask)
    points = np.stack([x, y], axis=1).astype(float)
    middle = points.mean(axis=0)
    spread = np.cov(points.T) if len(points) > 1 else np.eye(2)
    axis = np.linalg.eigh(spread)[1][:, 1]
    return np.stack([middle - length / 2 * axis, middle + length / 2 * axis])


def _evenly(points: Array) -> Array:
    """Equally spaced points of a polyline."""
    s = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0, s[-1], 33)
    return np.stack([np.interp(at, s, points[:, i]) for i in (0, 1)], axis=1)

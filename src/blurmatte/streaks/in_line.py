"""Parts of one streak: on one curve, of one width, with weak evidence between them.

A streak loses its contrast where the plate has the object's color, and is then found in parts. In this
file parts are (n, 2) arrays of the x and y of their cells, and a curve is v = a + b u + c u² along the
principal axis u of two parts.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from blurmatte.checks import Array, Bools, Floats
from blurmatte.streaks.evidence import SMOOTHING
from blurmatte.streaks.morphology import dilated

_MIN_ELONGATION = 2.0  # length over width from which a part has a direction
_MAX_WIDTH_RATIO = 2.0  # of two parts of one streak
_PARABOLA = 3  # parameters: of fewer cells it is not determined
_STILL_QUANTILE = 0.95  # of T where nothing moved: the corridor's median exceeds it


@dataclass(frozen=True)
class Curve:
    """A parabola through two parts that follow each other, and the corridor between them."""

    frame: Array  # (2, 2) unit vectors along u and v
    origin: Array  # (2,) the center of both parts
    bend: Array  # (3,) c, b, a
    gap: tuple[float, float]  # of u, between the parts
    half_width: float

    @classmethod
    def through(cls, one: Array, other: Array) -> "Curve | None":
        """The curve of two parts; None unless they lie in line."""
        both = np.concatenate([one, other])
        origin, frame = both.mean(axis=0), _axes(both)
        first, second = sorted(((p - origin) @ frame.T for p in (one, other)), key=_start)
        gap = (float(first[:, 0].max()), float(second[:, 0].min()))
        if gap[0] >= gap[1] or not (_is_elongated(first) and _is_elongated(second)):
            return None
        spreads = [_spread(part) for part in (first, second)]
        if max(spreads) > _MAX_WIDTH_RATIO * min(spreads):
            return None
        u, v = np.concatenate([first, second]).T
        bend = np.polyfit(u, v, 2)
        for part, spread in zip((first, second), spreads, strict=True):
            offset = float(np.mean((part[:, 1] - np.polyval(bend, part[:, 0])) ** 2)) - spread**2
            if offset > spread**2:
                return None
        return cls(frame, origin, bend, gap, float(np.sqrt(3) * np.mean(spreads)))

    def corridor(self, shape: tuple[int, ...]) -> Bools:
        """(h, w) the cells between the two parts."""
        y, x = np.indices(shape, sparse=True)
        (ux, uy), (vx, vy) = self.frame
        x, y = x - self.origin[0], y - self.origin[1]
        u, v = ux * x + uy * y, vx * x + vy * y
        inside = (u > self.gap[0]) & (u < self.gap[1])
        return np.asarray(inside & (np.abs(v - np.polyval(self.bend, u)) <= self.half_width))


def _start(part: Array) -> float:
    return float(part[:, 0].mean())


def _axes(part: Array) -> Array:
    """(2, 2) unit vectors along and across a part."""
    return np.asarray(np.linalg.eigh(np.cov((part - part.mean(axis=0)).T))[1].T[::-1])


def _spread(part: Array) -> float:
    """Standard deviation across a part, about its own parabola; at least that of one cell."""
    u, v = part.T
    u = u - u.mean()
    return max(float(np.std(v - np.polyval(np.polyfit(u, v, 2), u))), 12**-0.5)


def _is_elongated(part: Array) -> bool:
    """Whether a part, along its first axis, is longer than wide: only then it has a direction."""
    # A strip of constant density has the width √12 times its spread.
    along, least = float(np.ptp(part[:, 0])), _MIN_ELONGATION * np.sqrt(12)
    return bool(along >= least * 12**-0.5 and along >= least * _spread(part))


def join_in_line(parts: Sequence[Bools], T: Floats) -> list[Bools]:
    """Join the parts of one streak, with the corridors between them.

    parts: (h, w) masks of cells; T (h, w): the evidence of every cell.

    Two parts are joined if they are elongated, lie on one parabola, are about equally wide, and the
    median evidence between them exceeds that of nearly all cells in which nothing moved.
    """
    moved = np.logical_or.reduce(parts) if parts else np.zeros(T.shape, bool)
    halo = int(3 * max(SMOOTHING))  # of a part in the smoothed evidence

    def is_streak(corridor: Bools) -> bool:
        """Whether its median T exceeds that of most cells where nothing moved."""
        still = T[~dilated(moved | corridor, halo)]
        most = np.quantile(still, _STILL_QUANTILE) if still.size else np.inf
        return bool(np.median(T[corridor]) > most)

    return _joined(list(parts), is_streak)


def _joined(parts: list[Bools], is_streak: Callable[[Bools], bool]) -> list[Bools]:
    """The parts after all possible joins, each the first that is found."""
    short = [part for part in parts if not _has_direction(_cells(part))]
    waiting = [part for part in parts if not any(part is other for other in short)]
    done: list[tuple[Bools, Array]] = []
    while waiting:
        part = waiting.pop(0)
        cells = _cells(part)
        for k, (other, places) in enumerate(done):
            curve = Curve.through(places, cells)
            corridor = None if curve is None else curve.corridor(part.shape)
            if corridor is not None and corridor.any() and is_streak(corridor):
                del done[k]
                waiting.insert(0, other | part | corridor)
                break
        else:
            done.append((part, cells))
    return [*(part for part, _ in done), *short]


def _has_direction(cells: Array) -> bool:
    """Whether a part is elongated along its own axis, and so may be along that of two parts."""
    return len(cells) > _PARABOLA and _is_elongated((cells - cells.mean(axis=0)) @ _axes(cells).T)


def _cells(part: Bools, most: int = 4000) -> Array:
    """(n, 2) x and y of at most about so many cells of a part."""
    y, x = np.nonzero(part)
    step = max(1, len(x) // most)
    return np.stack([x[::step], y[::step]], axis=-1).astype(float)

"""Where descents to outlines begin: from a disc, and from the best outline that was found."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State, main_colors, seen, state_at
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.path import ARC, LINE, PathFamily
from blurmatte.sweep.silhouette import Silhouette

Array = npt.NDArray[np.float64]

_BULGES = 6
_RATIOS = 0.5, 1.7, 3.0  # of an ellipse's radii along and across its way
_TURNS = (-1.0, 1.0)  # radians that a search starts from
_WAYS = 0.6, 1.6  # of the way, that something longer or shorter may have gone
_AROUND = 90  # points of a rim


def straighter(data: Data, disc: State, best: State) -> Iterable[State]:
    """The disc's way as a line and as an arc."""
    for family in (LINE, ARC):
        if family is not disc.family:
            yield shaped(data, on_path(data, disc, family), bulgy(disc))


def stretched(data: Data, disc: State, best: State) -> Iterable[State]:
    """Ellipses longer or shorter along the disc's way, that went less far or further."""
    silhouette, radius = bulgy(disc), disc.shape[0]
    ends = on_path(data, disc, LINE).curve[[0, -1]]
    way = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
    angle = np.arctan2(way[1], way[0])
    for ratio in _RATIOS:
        out = (1 - ratio) * radius * way
        if (ends[1] - ends[0] + 2 * out) @ way <= 0:
            continue
        shape = silhouette.like(disc.silhouette, disc.shape)
        shape[0] = radius * np.sqrt(ratio)
        shape[1:3] = 0.5 * np.log(ratio) * np.array([np.cos(2 * angle), np.sin(2 * angle)])
        longer = np.linspace(ends[0] - out, ends[1] + out, 33)
        yield _recolored(data, disc.frame, LINE, longer, silhouette, shape)


def crosswise(data: Data, disc: State, best: State) -> Iterable[State]:
    """An ellipse as long as the disc's way, that went a little along or across it."""
    xy, _ = disc.family.at(disc.path, np.linspace(0, 1, 65))
    middle, spread = xy.mean(axis=0), np.cov(xy.T)
    variances, axes = np.linalg.eigh(spread)
    width, silhouette = disc.shape[0], bulgy(disc)
    length = width + np.sqrt(3 * variances[1])
    angle, stretch = np.arctan2(axes[1, 1], axes[0, 1]), 0.5 * np.log(length / width)
    shape = silhouette.like(disc.silhouette, disc.shape)
    shape[0] = 0.85 * np.sqrt(length * width)
    shape[1:3] = stretch * np.cos(2 * angle), stretch * np.sin(2 * angle)
    for way in axes.T:
        path = LINE.starts(middle + np.linspace(-0.4, 0.4, 33)[:, None] * width * way)[0]
        yield state_at(data, LINE, path, silhouette, shape, disc.frame)


def turning(data: Data, disc: State, best: State) -> Iterable[State]:
    """The best found, and discs on the same path, that turn."""
    yield shaped(data, best, replace(bulgy(disc), turns=True))
    for family in dict.fromkeys((best.family, LINE, ARC)):
        yield from _turned(data, shaped(data, on_path(data, disc, family), bulgy(disc)))


def exchanged(data: Data, state: State, bounds: tuple[float, float]) -> Iterable[State]:
    """Its way for a side, and that for its way: alpha is the same but for scale.

    A parallelogram that moves is three lines, each drawn out along the others, in whatever order. One
    that turns a little leaves nearly the same.
    """
    ends = on_path(data, state, LINE).curve[[0, -1]]
    middle, way = ends.mean(axis=0), ends[1] - ends[0]
    rim = state.silhouette.outline(state.shape, _AROUND)
    corner = rim[np.argmax(np.linalg.norm(rim, axis=1))]
    next_corner = rim[np.argmax(rim @ [-corner[1], corner[0]])]
    sides = np.stack([corner + next_corner, next_corner - corner])
    # Bulges round corners off, but keep the area.
    sides *= np.sqrt(state.silhouette.area(state.shape) / abs(np.linalg.det(sides)))
    for i, side in enumerate(sides):
        other = sides.copy()
        other[i] = way
        other[i] *= np.sign(np.linalg.det(other))
        by = np.linalg.solve(sides, other).T
        if not bounds[0] < state.shape[0] * np.sqrt(np.linalg.det(by)) < bounds[1]:
            continue
        shape = state.silhouette.mapped(state.shape, by)
        along = middle + np.linspace(-0.5, 0.5, 33)[:, None] * side
        for family in (LINE, ARC):
            found = _recolored(data, state.frame, family, along, state.silhouette, shape)
            yield found
            if state.silhouette.bulges > 1 and not state.silhouette.turns:
                yield from _turned(data, found)


def rescaled(data: Data, state: State, bounds: tuple[float, float]) -> Iterable[State]:
    """Longer along its way, and gone less far, or shorter and further.

    Alpha is much the same but for scale; before a plate of one color that tells nothing, and an outline
    that is free takes up the rest.
    """
    xy = state.curve
    ends = xy[[0, -1]]
    far = float(np.linalg.norm(ends[1] - ends[0]))
    if far == 0:
        return
    way = (ends[1] - ends[0]) / far
    rim = state.silhouette.outline(state.shape, _AROUND) @ way
    width = rim.max() - rim.min()
    for part in _WAYS:
        by = 1 + (1 - part) * far / width
        if by <= 0:
            continue
        stretch = np.eye(2) + (by - 1) * np.outer(way, way)
        if not bounds[0] < state.shape[0] * np.sqrt(by) < bounds[1]:
            continue
        shape = state.silhouette.mapped(state.shape, stretch)
        curve = xy.mean(axis=0) + part * (xy - xy.mean(axis=0))
        for family in dict.fromkeys((state.family, LINE, ARC)):
            yield _recolored(data, state.frame, family, curve, state.silhouette, shape)


def _turned(data: Data, state: State) -> Iterable[State]:
    """The same, that turns either way."""
    silhouette = replace(state.silhouette, turns=True)
    start = shaped(data, state, silhouette)
    for turn in _TURNS:
        shape = start.shape.copy()
        shape[2 * silhouette.bulges - 1] = turn
        yield seen(data, replace(start, shape=shape))


def _recolored(
    data: Data,
    frame: Frame,
    family: PathFamily,
    curve: Array,
    silhouette: Silhouette,
    shape: Array,
) -> State:
    """A shape on its way, of the color of the light that its alpha leaves, or of the known one."""
    path = family.starts(curve)[0]
    if data.known is None:
        alpha = silhouette.sweep(family, path, shape, data).alpha
        frame = main_colors(data, alpha, 1)
    return state_at(data, family, path, silhouette, shape, frame)


def bulgy(disc: State) -> Silhouette:
    """Outlines with a rim as soft as that of a disc."""
    return replace(disc.silhouette, bulges=_BULGES)


def shaped(data: Data, state: State, silhouette: Silhouette) -> State:
    """The same shape, as far as the silhouette can have it."""
    shape = silhouette.like(state.silhouette, state.shape)
    return state_at(data, state.family, state.path, silhouette, shape, state.frame)


def on_path(data: Data, state: State, family: PathFamily) -> State:
    """The same on a path of another family that goes about the same way."""
    if family is state.family:
        return state
    path = family.starts(state.curve)[0]
    return state_at(data, family, path, state.silhouette, state.shape, state.frame)

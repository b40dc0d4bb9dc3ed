"""Where fits of outlines start: from a disc, and from the best outline that was found."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from blurmatte.sweep.model.path import ARC, LINE
from blurmatte.sweep.model.silhouette import Silhouette
from blurmatte.sweep.model.state import State, state_at

Array = npt.NDArray[np.float64]

FIRST_ORDER = 6
_RATIOS = 0.5, 1.7, 3.0  # of an ellipse's radii along and across its path
_TURNS_RAD = (-1.0, 1.0)  # that fits start from


def straighter(disc: State, best: State) -> Iterable[State]:
    """The disc's path as a line and as an arc."""
    for family in (LINE, ARC):
        if family is not disc.family:
            yield disc.along(family).of_kind(outlined(disc))


def stretched(disc: State, best: State) -> Iterable[State]:
    """Ellipses longer or shorter along the disc's path, that went less far or further."""
    silhouette, radius = outlined(disc), disc.shape[0]
    ends = disc.along(LINE).curve[[0, -1]]
    direction = (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-9)
    angle = np.arctan2(direction[1], direction[0])
    for ratio in _RATIOS:
        out = (1 - ratio) * radius * direction
        if (ends[1] - ends[0] + 2 * out) @ direction <= 0:
            continue
        shape = silhouette.like(disc.silhouette, disc.shape)
        shape[0] = radius * np.sqrt(ratio)
        shape[1:3] = 0.5 * np.log(ratio) * np.array([np.cos(2 * angle), np.sin(2 * angle)])
        longer = np.linspace(ends[0] - out, ends[1] + out, 33)
        yield state_at(disc.observation, LINE, LINE.starts(longer)[0], silhouette, shape)


def crosswise(disc: State, best: State) -> Iterable[State]:
    """An ellipse as long as the disc's path, that went a little along or across it."""
    xy, _ = disc.family.at(disc.path, np.linspace(0, 1, 65))
    middle, spread = xy.mean(axis=0), np.cov(xy.T)
    variances, axes = np.linalg.eigh(spread)
    width, silhouette = disc.shape[0], outlined(disc)
    length = width + np.sqrt(3 * variances[1])
    angle, stretch = np.arctan2(axes[1, 1], axes[0, 1]), 0.5 * np.log(length / width)
    shape = silhouette.like(disc.silhouette, disc.shape)
    shape[0] = 0.85 * np.sqrt(length * width)
    shape[1:3] = stretch * np.cos(2 * angle), stretch * np.sin(2 * angle)
    for axis in axes.T:
        path = LINE.starts(middle + np.linspace(-0.4, 0.4, 33)[:, None] * width * axis)[0]
        yield state_at(disc.observation, LINE, path, silhouette, shape)


def turning(disc: State, best: State) -> Iterable[State]:
    """The best found, and discs on the same path, that turn."""
    yield best.of_kind(replace(outlined(disc), turns=True))
    for family in dict.fromkeys((best.family, LINE, ARC)):
        yield from _turned(disc.along(family).of_kind(outlined(disc)))


def _turned(state: State) -> Iterable[State]:
    """The same, turning in either direction."""
    silhouette = replace(state.silhouette, turns=True)
    start = state.of_kind(silhouette)
    for turn in _TURNS_RAD:
        shape = start.shape.copy()
        shape[2 * silhouette.order - 1] = turn
        yield start.moved(start.path, shape)


def changing(disc: State, best: State) -> Iterable[State]:
    """The best found, and discs on the same path and on a line, whose proportions may change.

    How they change needs no start: from several rates fits go to the same ones.
    """
    yield best.of_kind(replace(best.silhouette, changes=True))
    for family in dict.fromkeys((best.family, LINE)):
        yield disc.along(family).of_kind(replace(outlined(disc), changes=True))


def outlined(disc: State) -> Silhouette:
    """Outlines of the first order that is tried, with a rim as soft as that of a disc."""
    return replace(disc.silhouette, order=FIRST_ORDER)

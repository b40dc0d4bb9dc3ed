"""The blur of an object's straight color by its motion, as a sparse matrix.

The premultiplied light of a streak is linear in the object's straight color o,

    P(p) = ∫ χ(Lₜ⁻¹ (p − cₜ)) o(Lₜ⁻¹ (p − cₜ)) dt = (A o)(p),

with the silhouette χ, its center cₜ and its map Lₜ at exposure fraction t. The coverage of a pixel is
exact at every moment; only o is interpolated. To interpolate the product χ o instead would blur the rim
and make alpha wrong by several percent. Rows of A sum to alpha.

This file has the poses, and when pixels see the object. A is that of its nodes: see `lattice`.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy

from blurmatte.checks import AnyArray, Array, Ints32, Ints64
from blurmatte.deblurring import sphere_kernel
from blurmatte.deblurring.spin import Spin
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.sweep import Sweep

Sparse = Any  # scipy.sparse.csr_matrix
# Of pixels in a ball's light: the first entry of each; moment, weight and normals of each entry
Entries = tuple[Ints64, Ints32, Array, Array]

MAX_STEP_PX = 0.5  # motion between two moments


class Blur(NamedTuple):
    """The operator A (pixels, n), and alpha (pixels,)."""

    A: Sparse
    alpha: Array


@dataclass(frozen=True, eq=False)
class Poses:
    """Moments of a part of the exposure.

    Parameters
    ----------
    t, durations : (T,) float
        Exposure fractions, and the parts of the exposure that they stand for.
    xy : (T, 2) float
        Centers, pixels of the picture.
    maps : (T, 2, 2) float
        From the body to the picture.
    spin : Spin
        Of a ball that turns in space.
    """

    t: Array
    durations: Array
    xy: Array
    maps: Array
    spin: Spin


def moment_count(
    sweep: Sweep, part: float = 1.0, step: float = MAX_STEP_PX, spin: Spin | None = None
) -> int:
    """Moments of a part of the exposure such that no point moves further than `step` between them."""
    speed = sweep.trajectory.top_speed + sweep.silhouette.rim_motion(sweep.shape)
    speed += 0.0 if spin is None else spin.rate * sweep.radius
    return max(1, int(np.ceil(part * speed / step)))


def poses_of(
    sweep: Sweep,
    start: float = 0.0,
    end: float = 1.0,
    spin: Spin | None = None,
    count: int | None = None,
) -> Poses:
    """Poses at the middles of equal parts of the exposure from `start` to `end`.

    Durations sum to the opacity. Their number is that of `moment_count`, unless it is given. If
    `start` equals `end`, the pose at that moment.
    """
    count = moment_count(sweep, end - start, spin=spin) if count is None else count
    t = start + (end - start) * (np.arange(count) + 0.5) / count
    xy = sweep.family.at(sweep.path, t)[0]
    maps = sweep.silhouette.map_at(sweep.shape, t)
    durations = np.full(count, sweep.silhouette.opacity / count)
    return Poses(t, durations, xy, maps, spin or Spin(np.zeros(3)))


def sparse(rows: tuple[AnyArray, AnyArray, Array], columns: int) -> Sparse:
    """The matrix of compressed sparse rows of a kernel."""
    first, column, values = rows
    return scipy.sparse.csr_matrix((values, column, first), shape=(len(first) - 1, columns))


class SeenMoments(NamedTuple):
    """When the pixels of a box, `width` wide, see the object: covered moments in their order.

    In these pixels xy (T, 2) are the centers, and to_disc (T, 2, 2) maps the picture to the unit disc.
    The rim is that of a shape.
    """

    covered: tuple[Ints64, Ints32, Array]
    xy: Array
    to_disc: Array
    width: int
    shape: Array
    rim: tuple[Any, ...]

    @property
    def normals(self) -> Array:
        """(m, 3) unit normals of a ball at the covered moments."""
        normal: Array = sphere_kernel.normals_of(self.covered, self.xy, self.to_disc, self.width)
        return normal

    def alpha(self, durations: Array) -> Array:
        """(pixels,) fraction of the exposure."""
        first, moment, part = self.covered
        return row_sums(first, durations[moment] * part, np.ones((len(part), 1)))[:, 0]


def seen_moments(
    sweep: Sweep, pixels: Pixels, poses: Poses, near: SeenMoments | None = None
) -> SeenMoments:
    """The moments at which pixels, or blocks of them, see the object: those of a near motion."""
    from blurmatte.deblurring import operator_kernel  # loads scipy.special

    xy, soft = (poses.xy - np.array(pixels.origin)) / pixels.scale, sweep.softness / pixels.scale
    same = near is not None and np.array_equal(near.shape, sweep.shape)
    rim = near.rim if near and same else sweep.silhouette.rim(sweep.shape, pixels.scale)
    motion = xy, poses.maps, rim, soft, pixels.shape
    if near is None:
        pixel, moment, part = operator_kernel.covered_moments(*motion)
        shape = int(np.prod(pixels.shape)), len(xy)
        by_pixel = scipy.sparse.csr_matrix((part, (pixel, moment)), shape=shape)
        covered = by_pixel.indptr.astype(np.int64), by_pixel.indices, by_pixel.data
    else:
        covered = operator_kernel.covered_again(*motion, *near.covered)
    to_disc = np.linalg.inv(poses.maps) * (pixels.scale / sweep.radius)
    return SeenMoments(covered, xy, np.asarray(to_disc, float), pixels.shape[1], sweep.shape, rim)


def row_sums(first: Ints64, weight: Array, values: Array) -> Array:
    """(pixels, k) weighted sums of values (m, k) over the entries of each pixel."""
    return np.asarray(sparse((first, np.arange(len(weight)), weight), len(weight)) @ values)

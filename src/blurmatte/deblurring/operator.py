"""The blur of an object's straight color by its motion, as a sparse matrix.

The premultiplied light of a streak is linear in the object's straight color o,

    P(p) = ∫ χ(Lₜ⁻¹ (p − cₜ)) o(Lₜ⁻¹ (p − cₜ)) dt = (A o)(p),

with the silhouette χ, its center cₜ and its map Lₜ at exposure fraction t. The coverage of a pixel is
exact at every moment; only o is interpolated. To interpolate the product χ o instead would blur the rim
and make alpha wrong by several percent. Rows of A sum to alpha.

`Poses` are all that A knows of the motion: a body that turns in space would map each node separately.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.deblurring.lattice import Lattice
from blurmatte.sweep.model.pixels import Pixels
from blurmatte.sweep.sweep import Sweep

Array = npt.NDArray[np.float64]
Sparse = Any  # scipy.sparse.csr_matrix

MAX_STEP_PX = 0.5  # motion between two moments


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
    """

    t: Array
    durations: Array
    xy: Array
    maps: Array


def poses_of(
    sweep: Sweep, start: float = 0.0, end: float = 1.0, step: float = MAX_STEP_PX
) -> Poses:
    """Poses at the middles of equal parts of the exposure from `start` to `end`; durations sum to 1.

    No point moves further than `step` pixels in a part. If `start` equals `end`, the pose at that
    moment.
    """
    speed = sweep.trajectory.top_speed + sweep.silhouette.rim_motion(sweep.shape)
    count = max(1, int(np.ceil((end - start) * speed / step)))
    t = start + (end - start) * (np.arange(count) + 0.5) / count
    xy = sweep.family.at(sweep.path, t)[0]
    maps = sweep.silhouette.map_at(sweep.shape, t)
    return Poses(t, np.full(count, 1 / count), xy, maps)


def blur_operator(
    sweep: Sweep, lattice: Lattice, pixels: Pixels, poses: Poses | None = None
) -> Sparse:
    """A (h w, n) of the pixels of a box: nodes of the straight color → premultiplied light."""
    from scipy.sparse import csr_matrix

    from blurmatte.deblurring import operator_kernel as kernel  # numba takes half a second

    poses = poses_of(sweep) if poses is None else poses
    first, columns, values = kernel.rows_of(*_moments(sweep, lattice, pixels, poses))
    shape = (pixels.shape[0] * pixels.shape[1], lattice.size)
    return csr_matrix((values, columns, first), shape=shape)


def blurred(
    values: Array, sweep: Sweep, lattice: Lattice, pixels: Pixels, poses: Poses
) -> tuple[Array, Array]:
    """Alpha (h w,), and the operator times values of the nodes (n, c): (h w, c)."""
    from blurmatte.deblurring import operator_kernel as kernel  # numba takes half a second

    moments = _moments(sweep, lattice, pixels, poses)
    alpha, sums = kernel.sums_of(*moments, np.ascontiguousarray(values))
    return np.asarray(alpha), np.asarray(sums)


def _moments(sweep: Sweep, lattice: Lattice, pixels: Pixels, poses: Poses) -> tuple[Any, ...]:
    """Arguments of the kernels: the poses on the lattice, and where they cover pixels."""
    from blurmatte.deblurring import operator_kernel as kernel  # numba takes half a second

    xy = poses.xy - np.array(pixels.origin)
    rim, soft = sweep.silhouette.rim(sweep.shape), sweep.softness
    covered = kernel.covered_moments(xy, poses.maps, rim, soft, pixels.shape)
    to_lattice = np.linalg.inv(poses.maps) * (lattice.radius / sweep.radius / lattice.pitch)
    width = pixels.shape[1]
    return poses.durations, xy, to_lattice, lattice.corner, lattice.node, width, covered

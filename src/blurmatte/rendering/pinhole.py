"""A pinhole camera: how a sphere looks that is not on the optical axis, and how depth changes a path.

A sphere of radius R at depth 1 and slope (u, v) from the axis, with L² = 1 + u² + v², is seen within
a cone of rays; the picture plane cuts it in an ellipse. Of focal length f,

    its center is        f (u, v) / (1 - R²),
    its semi-axes are    f R √(L² - R²) / (1 - R²)  along (u, v)   and   f R / √(1 - R²)  across.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.rendering.pose import View
from blurmatte.trajectory import Trajectory

Array = npt.NDArray[np.float64]

_KNOTS = 129  # of a path in depth: straight pieces leave its timing by 1e-4 of its length at most


@dataclass(frozen=True)
class Pinhole:
    """A camera near enough to see perspective.

    Parameters
    ----------
    focal : float
        Focal length, pixels.
    center : (float, float), optional
        Principal point, pixels: where the optical axis meets the picture. The middle of the picture
        if not given.

    Raises
    ------
    ValueError
        If the focal length is not positive or the center no finite point.
    """

    focal: float
    center: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not (np.isfinite(self.focal) and self.focal > 0):
            raise ValueError(f"focal must be a positive number of pixels, got {self.focal}")
        if self.center is not None and (
            np.shape(self.center) != (2,) or not np.all(np.isfinite(self.center))
        ):
            raise ValueError(f"center must be two finite numbers of pixels, got {self.center}")

    def view(self, point: Array, size: tuple[int, int]) -> View:
        """From where it sees a body whose center is at `point` (2,) of a picture of this size."""
        middle = (np.array(size) - 1) / 2 if self.center is None else np.array(self.center)
        u, v = ((point - middle) / self.focal).tolist()
        return View((u, v), self.focal)


def sphere_outline(view: View, radius: float) -> tuple[Array, Array]:
    """Ellipse in which a view shows a sphere.

    Parameters
    ----------
    view : View
    radius : float
        Focal length times radius over depth, pixels; less than the focal length.

    Returns
    -------
    center : (2,) float
        Of the ellipse, from the image of the sphere's center, pixels.
    axes : (2, 2) float
        Symmetric map of the unit circle to the ellipse, pixels.
    """
    slope, f, R = np.array(view.slope), view.focal, radius / view.focal
    squared = slope @ slope
    along = f * R * np.sqrt(1 + squared - R**2) / (1 - R**2)
    across = f * R / np.sqrt(1 - R**2)
    radial = np.outer(slope, slope) / squared if squared > 0 else np.zeros((2, 2))
    center = f * slope * R**2 / (1 - R**2)
    return center, across * np.eye(2) + (along - across) * radial


def rim_magnification(view: View, reach: float) -> float:
    """By how much a point within `reach` pixels of a body's center moves faster than it, at most.

    At a slope s from the optical axis the picture plane is stretched along the radius by 1 + s².
    """
    slope = float(np.linalg.norm(view.slope))
    return (1 + (slope + reach / view.focal) ** 2) / (1 + slope**2)


def path_in_depth(
    start: npt.ArrayLike, end: npt.ArrayLike, depth: tuple[float, float]
) -> Trajectory:
    """Straight motion of constant speed in space, as a pinhole camera sees it.

    The picture of the path is straight, and faster where the body is nearer; `Change.depth` changes
    the body's size accordingly. It depends on neither focal length nor principal point.

    Parameters
    ----------
    start, end : (2,) float
        Pixels.
    depth : (float, float)
        At the start and at the end; only their ratio matters.

    Raises
    ------
    ValueError
        If a depth is not positive.
    """
    near = np.asarray(depth, dtype=float)
    if near.shape != (2,) or not np.all(np.isfinite(near) & (near > 0)):
        raise ValueError(f"depth must be two positive numbers, got {depth}")
    ends = np.array([start, end], dtype=float)
    t = np.arange(_KNOTS) / (_KNOTS - 1)
    shares = np.stack([(1 - t) * near[0], t * near[1]], axis=1)
    return Trajectory(shares @ ends / shares.sum(axis=1, keepdims=True), t)

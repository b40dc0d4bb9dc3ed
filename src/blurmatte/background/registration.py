"""register_frames: where each frame of a moving camera looks, in the pixels of one of them.

Every frame is predicted from the one before by the shift between both, and then fitted to the canvas,
all that the frames before have shown. Both fits are those of a plate (`alignment`), so that what moves
in the scene has little weight. A rolling shutter that shears a frame is part of its homography, and
one that bends it is fitted in addition.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import overload

import numpy as np

from blurmatte.background.alignment import (
    HOMOGRAPHY,
    MAX_PIXELS,
    SHIFT,
    Alignment,
    ComparedPair,
    fit_level,
    levels,
    residuals_and_slopes,
)
from blurmatte.background.camera_motion import likely_shifts
from blurmatte.background.robust_mean_kernel import UNSEEN
from blurmatte.background.warp import (
    PixelGrid,
    Warp,
    centered,
    composed,
    inverse,
    warped,
    warped_linearly,
    warped_mask,
)
from blurmatte.checks import Array, Bools, Box, Floats
from blurmatte.errors import PlateError
from blurmatte.radiometry import LinearImage
from blurmatte.statistics import MAD_TO_STD, cell_means

# When a frame is registered.
_MIN_OVERLAP = 0.3  # of a frame with the canvas
# Residual of most points over the standard deviation of the frame: with less no other prediction is
# tried, and another scene leaves more
_GOOD_RESIDUAL = 0.015
MAX_RELATIVE_RESIDUAL = 0.5
_MAX_SHIFT_STD_PX = 0.5  # with more, the frame has too little texture
_MAX_CANVAS_RATIO = 16.0  # of its area to that of a frame
_MIN_REGISTERED = 0.5  # of the frames; with fewer, it is no clip of one scene

# The lens term.
_LENS_FRAMES = 6
_LENS_MIN_OVERLAP = 0.4  # with the reference
_LENS_STEP = 1e-4  # of its numerical derivative
_MAX_LENS = 0.3

_BEND_ROUNDS = 4  # of a step of a rolling shutter's bend and a fit of the homography, at most
_MIN_FINE = 0.95  # of the standard deviation of an even frame: that of noise between neighbors
_ROUNDING = 1e-6  # of 32-bit floats; white is 1
# When the lens term and the bend are certain.
_MIN_CERTAIN_STD = 4.0  # standard deviations that each must differ from 0 by
_MIN_MOVED_PX = 0.1  # and the displacement: of the corners, or of the last row of a compared frame


@dataclass(frozen=True)
class ParallaxRegion:
    """A part of the scene at another depth than the rest.

    Parameters
    ----------
    box : (x0, y0, x1, y1)
        Pixels of the picture or of the canvas.
    shift : float
        Median of its displacement, pixels.
    """

    box: Box
    shift: float

    def __str__(self) -> str:
        return f"{','.join(map(str, self.box))} (by {self.shift:.1f} pixels)"


@dataclass(frozen=True, eq=False)
class CameraPath:
    """Where each frame of a moving camera looks.

    Parameters
    ----------
    size : (int, int)
        (width, height) of the frames, pixels.
    views : tuple of Warp or str
        From the pixels of each frame to those of the reference frame; or why it is not registered.
    canvas : PixelGrid
        All that the frames show, in pixels of the reference frame.
    reference : int or None
        Index of that frame; None if a plate was given.
    parallax : tuple of ParallaxRegion
        Parts of the canvas at another depth than the rest.
    """

    size: tuple[int, int]
    views: tuple[Warp | str, ...]
    canvas: PixelGrid
    reference: int | None = None
    parallax: tuple[ParallaxRegion, ...] = ()

    @property
    def lens(self) -> float:
        """Lens term of all frames, 0 if there is none."""
        return next((view.lens for view in _known(self.views)), 0.0)

    @property
    def registered(self) -> list[int]:
        """Indices of the frames that have a view."""
        return [k for k, view in enumerate(self.views) if isinstance(view, Warp)]

    @property
    def unregistered(self) -> list[tuple[int, str]]:
        """Indices of the others, each with its reason."""
        return [(k, why) for k, why in enumerate(self.views) if isinstance(why, str)]

    @property
    def reach(self) -> float:
        """Largest displacement of a corner of a frame against the reference frame, pixels."""
        corners = np.array(list(product(*((0.0, n - 1.0) for n in self.size))))
        at = None if self.reference is None else self.views[self.reference]
        start = at.points(corners) if isinstance(at, Warp) else corners
        seen = [view.points(corners) - start for view in _known(self.views)]
        return float(np.linalg.norm(seen, axis=2).max())

    @property
    def delay_std(self) -> float:
        """Error of the time when a frame shows a place, root mean square, intervals between frames.

        0 unless frames are bent. A rolling shutter whose camera shakes shows the place in other rows
        than the frames before and after, which are read at other times: to read a frame takes between
        none and all of an interval.
        """
        seen = _known(self.views)
        if not any(view.bends.any() for view in seen) or len(seen) < 3:
            return 0.0
        center, across = (np.array([self.size]) - 1) / 2, int(seen[0].upright)
        rows = np.array([view.points(center)[0, across] for view in seen]) / self.size[across]
        shakes = rows[1:-1] - (rows[:-2] + rows[2:]) / 2
        return float(np.sqrt(np.mean(shakes**2) / 3))

    def view(self, k: int) -> Warp:
        """That of a frame; PlateError, with the reason, if it has none."""
        view = self.views[k]
        if isinstance(view, str):
            raise PlateError(f"the camera moved, and the frame is not registered: {view}")
        return view

    def to_canvas(self, k: int, xy: Array) -> Array:
        """Points (n, 2) of a frame in pixels of the canvas."""
        return self.view(k).points(xy) - self.canvas.origin

    def to_frame(self, k: int, xy: Array) -> Array:
        """Points (n, 2) of the canvas in pixels of a frame."""
        return self.view(k).inverse.points(xy + self.canvas.origin)

    def plate_at(self, k: int, plate: LinearImage) -> LinearImage:
        """The part of a plate on the canvas that a frame shows, in the frame's pixels."""
        return seen_through(replace(self.view(k), source=self.canvas), plate)

    def on_canvas(self, k: int, frame: LinearImage) -> LinearImage:
        """A frame on the canvas; what it does not show is not valid, and its light is UNSEEN."""
        how = replace(self.view(k).inverse, target=self.canvas)
        rgb = warped(frame.rgb, how)
        rgb[~warped_mask(np.ones_like(frame.valid), how)] = UNSEEN
        return LinearImage(rgb, valid=warped_mask(frame.valid, how), meta=frame.meta)


def _known(views: Iterable[Warp | str]) -> list[Warp]:
    """The views of the frames that are registered."""
    return [view for view in views if isinstance(view, Warp)]


def seen_through(how: Warp, plate: LinearImage) -> LinearImage:
    """A plate under a warp; what it does not show is not valid."""
    noise = None
    if plate.noise is not None:
        noise = warped_linearly(np.asarray(plate.variance, np.float32), how)
    rgb, valid = warped(plate.rgb, how), warped_mask(plate.valid, how)
    return LinearImage(rgb, noise, valid, plate.meta)


def register_frames(frames: Sequence[LinearImage], plate: LinearImage | None = None) -> CameraPath:
    """Register the frames of a clip, or of a burst, whose camera moves, to the one in the middle.

    Parameters
    ----------
    frames : sequence of LinearImage
        Of one size.
    plate : LinearImage, optional
        Of that size, or of a canvas that is larger: frames are registered to it, and it is the canvas.

    Returns
    -------
    CameraPath

    Raises
    ------
    PlateError
        If less than half of the frames can be registered.
    """
    cell = int(np.ceil(np.sqrt(np.prod(frames[0].size) / MAX_PIXELS)))
    if plate is not None:
        return _checked(_registered_to(plate, frames, cell))
    path = _checked(_registered(frames, cell, 0.0))
    lens, std = _lens(frames, path, cell)
    corner = float(np.hypot(*frames[0].size)) / 2
    if abs(lens) > _MIN_CERTAIN_STD * std and abs(lens) * corner > _MIN_MOVED_PX:
        bent = _registered(frames, cell, lens)
        more, _ = _lens(frames, bent, cell)
        bent = _registered(frames, cell, lens + more) if abs(more) > std else bent
        if len(bent.registered) >= len(path.registered):
            return bent
    return path


def _checked(path: CameraPath) -> CameraPath:
    """The path; PlateError if it is that of less than half of the frames."""
    if len(path.registered) >= _MIN_REGISTERED * len(path.views):
        return path
    (first, why), *_ = path.unregistered
    raise PlateError(
        f"the camera moves, and only {len(path.registered)} of {len(path.views)} frames show one "
        f"scene from one place: frame {first}: {why}; give a part of the clip (--frames)"
    )


@dataclass(frozen=True, eq=False)
class FramesOnCanvas(Sequence[LinearImage]):
    """The registered frames of a moving camera, warped to the canvas when they are read.

    Parameters
    ----------
    frames : sequence of LinearImage
        All frames of the clip.
    path : CameraPath
    numbers : sequence of int
        Indices of those that these are, rising.
    plate : (H, W, 3) float, optional
        On the canvas. What frames differ from it by is interpolated instead of their own light, which
        loses less of fine structure: back-projection [Irani and Peleg 1991].
    gains : sequence of (3,) float, optional
        Light of these frames over that of the plate.
    """

    frames: Sequence[LinearImage]
    path: CameraPath
    numbers: Sequence[int]
    plate: Floats | None = None
    gains: Sequence[Floats] = ()

    @classmethod
    def of(cls, frames: Sequence[LinearImage], path: CameraPath, most: int) -> FramesOnCanvas:
        """At most so many, at equal distances."""
        known = path.registered
        return cls(frames, path, known[:: -(-len(known) // most) or 1])

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[LinearImage]:
        places = {k: place for place, k in enumerate(self.numbers)}
        for k, frame in enumerate(self.frames):  # files are decoded in order
            if k in places:
                yield self._shown(places[k], frame)

    @overload
    def __getitem__(self, which: int) -> LinearImage: ...
    @overload
    def __getitem__(self, which: slice) -> FramesOnCanvas: ...

    def __getitem__(self, which: int | slice) -> LinearImage | FramesOnCanvas:
        if isinstance(which, slice):
            return replace(self, numbers=self.numbers[which], gains=self.gains[which])
        return self._shown(which, self.frames[self.numbers[which]])

    def _shown(self, place: int, frame: LinearImage) -> LinearImage:
        k = self.numbers[place]
        if self.plate is None:
            return self.path.on_canvas(k, frame)
        expected = self.plate * self.gains[place].astype(np.float32)
        rest = frame.rgb - warped(expected, replace(self.path.view(k), source=self.path.canvas))
        shown = self.path.on_canvas(k, replace(frame, rgb=rest.astype(np.float32)))
        return replace(shown, rgb=np.where(shown.rgb == UNSEEN, UNSEEN, shown.rgb + expected))


@dataclass(frozen=True, eq=False)
class _CanvasFit:
    """A frame fitted to what the canvas shows there."""

    alignment: Alignment
    residual: float
    image_std: float
    is_even: bool  # the frame shows noise alone


def _levels(image: LinearImage, seen: LinearImage) -> Iterator[ComparedPair]:
    """The pyramid of a frame and what is known of the scene there."""
    filled = np.where(seen.valid[..., None], seen.rgb, image.rgb).astype(np.float32)
    return levels(image, LinearImage(filled, valid=seen.valid))


def _fit(image: LinearImage, seen: LinearImage, coarse: bool = True) -> _CanvasFit:
    pyramid = list(_levels(image, seen))
    fine, start = pyramid[0], pyramid[0].identity
    for level in reversed(pyramid[1:] if coarse else []):
        start = fit_level(level, start, SHIFT)
        bent = fit_level(level, start, HOMOGRAPHY)
        start = bent if bent.scale < start.scale else start
    fit = fit_level(fine, start, HOMOGRAPHY)
    inside = np.isfinite(fit.residuals)
    rest = np.abs(fit.residuals * fine.sigma)[inside]
    residual = MAD_TO_STD * float(np.median(rest)) if rest.size else np.inf
    C = fine.C[fine.xy[:, 1], fine.xy[:, 0]]
    return _CanvasFit(fit, residual, float(C.std(axis=0).mean()), _is_even(image))


def _is_even(image: LinearImage) -> bool:
    """Whether a frame varies no more from end to end than from one pixel to the next."""
    light = image.rgb.mean(axis=-1)
    fine = np.diff(light, axis=1).std() / np.sqrt(2)
    return bool(_MIN_FINE * light.std() <= fine + _ROUNDING)


def _refusal(fit: _CanvasFit, size: tuple[int, int]) -> str:
    """Why a fit does not register a frame; "" if it does."""
    if fit.residual > MAX_RELATIVE_RESIDUAL * fit.image_std:
        if fit.is_even:
            return "it shows nothing: its light is even"
        rest = fit.residual / max(fit.image_std, 1e-9)
        return f"it does not look like the frames before: {rest:.0%} of its contrast are not theirs"
    std = np.sqrt(np.diag(fit.alignment.covariance())[[2, 5]]) * max(size) / 2
    if not np.all(std < _MAX_SHIFT_STD_PX):
        return f"it has too little texture: its place is known to {std.max():.1f} px only"
    return ""


def _registered(frames: Sequence[LinearImage], cell: int, lens: float) -> CameraPath:
    """All frames that can be registered, from the first that others agree with."""
    size = frames[0].size
    best: list[Warp | str] = []
    for first in dict.fromkeys((0, len(frames) // 2)):
        found = _chained(frames, first, cell, lens)
        if len(_known(found)) > len(_known(best)):
            best = found
        if len(_known(best)) >= _MIN_REGISTERED * len(frames):
            break
    known = [k for k, one in enumerate(best) if isinstance(one, Warp)]
    reference = min(known, key=lambda k: abs(k - len(frames) // 2))
    middle = best[reference]
    assert isinstance(middle, Warp)
    back = inverse(middle.h)
    views = tuple(
        one if isinstance(one, str) else replace(one, h=composed(one.h, back), size=size)
        for one in best
    )
    return CameraPath(size, views, _canvas_of(_known(views), size, cell), reference)


def _registered_to(plate: LinearImage, frames: Sequence[LinearImage], cell: int) -> CameraPath:
    """The frames on a plate, the middle of which is where a reference frame would look."""
    size = frames[0].size
    x, y = (-((P - w) // 2 // cell) * cell for P, w in zip(plate.size, size, strict=True))
    small, first = _cells(plate, cell), _cells(frames[0], cell)
    grid = PixelGrid(small.size, (x // cell, y // cell))
    mosaic = _Mosaic.of_plate(small, grid, first)
    found = [mosaic.add(_cells(frame, cell)) for frame in frames]
    views = tuple(one if isinstance(one, str) else replace(one, size=size) for one in found)
    return CameraPath(size, views, PixelGrid(plate.size, (x, y)))


def show_one_scene(a: LinearImage, b: LinearImage) -> bool:
    """Whether a frame can be registered to the one before."""
    cell = int(np.ceil(np.sqrt(np.prod(a.size) / MAX_PIXELS)))
    mosaic = _Mosaic.begun(_cells(a, cell), 0.0)
    return isinstance(mosaic.add(_cells(b, cell)), Warp)


def _canvas_of(views: Iterable[Warp], size: tuple[int, int], cell: int) -> PixelGrid:
    """The pixels that all views show."""
    width, height = size
    edge = np.linspace(0, 1, 9)  # a lens bends the border
    corners = np.array([p for p in product(edge, edge) if set(p) & {0.0, 1.0}])
    corners = corners * (width - 1, height - 1)
    points = np.concatenate([view.points(corners) for view in views])
    first = np.floor(points.min(axis=0) / cell).astype(int) * cell
    last = np.ceil(points.max(axis=0) / cell).astype(int) * cell
    x, y = first.tolist()
    w, h = (last - first + cell).tolist()
    return PixelGrid((int(w), int(h)), (int(x), int(y)))


def _chained(frames: Sequence[LinearImage], first: int, cell: int, lens: float) -> list[Warp | str]:
    """Views of the frames against one of them, or why there is none."""
    found: list[Warp | str] = ["" for _ in frames]
    mosaic = _Mosaic.begun(_cells(frames[first], cell), lens)
    start = mosaic.view, mosaic.gray
    found[first] = mosaic.view
    for part in (range(first + 1, len(frames)), range(first)):
        mosaic.view, mosaic.gray = start
        for at, frame in zip(part, frames[part.start : part.stop], strict=False):
            found[at] = mosaic.add(_cells(frame, cell))
    return found


def _cells(frame: LinearImage, cell: int) -> LinearImage:
    """Means over cells; those of a frame that has a whole number of them are where the frame is."""
    if cell == 1:
        return frame
    valid = np.asarray(cell_means(frame.valid.astype(np.float32), cell) == 1)
    return LinearImage(cell_means(frame.rgb, cell), valid=valid, meta=frame.meta)


@dataclass(eq=False)
class _Mosaic:
    """All that the frames so far have shown, in pixels of the first."""

    rgb: Floats
    seen: Bools
    grid: PixelGrid
    size: tuple[int, int]
    lens: float
    view: Warp  # of the last frame that was registered, and its gray picture
    gray: Floats
    grows: bool = True

    @classmethod
    def begun(cls, frame: LinearImage, lens: float) -> _Mosaic:
        """Of one frame."""
        gray = frame.rgb.mean(axis=-1)
        view = Warp(np.zeros(8), frame.size, lens, upright=_is_upright(frame))
        rgb, valid = frame.rgb.astype(np.float32), frame.valid.copy()
        return cls(rgb, valid, PixelGrid(frame.size), frame.size, lens, view, gray)

    @classmethod
    def of_plate(cls, plate: LinearImage, grid: PixelGrid, frame: LinearImage) -> _Mosaic:
        """Of a plate, which stays as it is, for frames like this one."""
        view = Warp(np.zeros(8), frame.size, upright=_is_upright(frame))
        gray = seen_through(replace(view, source=grid), plate).rgb.mean(axis=-1)
        known = plate.rgb.astype(np.float32), plate.valid, grid, frame.size
        return cls(*known, 0.0, view, gray, grows=False)

    def add(self, frame: LinearImage) -> Warp | str:
        """Register a frame, and add what it shows first; or why it is not registered."""
        if frame.size != self.size:
            return f"it has another size, {frame.size[0]}x{frame.size[1]}"
        gray, why, best = frame.rgb.mean(axis=-1), "", None
        for start in self._predictions(gray):
            seen = self._seen(start)
            if seen.valid.mean() < _MIN_OVERLAP:
                why = why or f"it shows only {seen.valid.mean():.0%} of what the frames before show"
                continue
            fit = _fit(frame, seen)
            reason = _refusal(fit, frame.size)
            why = why or reason
            if not reason and (best is None or fit.residual < best[1].residual):
                best = start, fit
            if best is not None and best[1].residual < _GOOD_RESIDUAL * best[1].image_std:
                break
        return why if best is None else self._with(frame, gray, *best)

    def _with(self, frame: LinearImage, gray: Floats, start: Warp, fit: _CanvasFit) -> Warp | str:
        """The view of a frame that was fitted, and is added; or why it cannot be."""
        view = replace(start, h=composed(fit.alignment.h, start.h))
        if self.lens:  # the fit knows no lens
            fit = _fit(frame, self._seen(view), coarse=False)
            view = replace(view, h=composed(fit.alignment.h, view.h))
        for _ in range(_BEND_ROUNDS):
            bend = _bend(fit.alignment, view)
            if np.array_equal(bend, view.bends[0]):
                break
            view = replace(view, bends=np.stack([bend, np.zeros(2)]))
            fit = _fit(frame, self._seen(view), coarse=False)
            view = replace(view, h=composed(fit.alignment.h, view.h))
        if why := self._pasted(frame, view, fit.alignment.light[0]):
            return why
        self.view, self.gray = view, gray
        return view

    def _predictions(self, gray: Floats) -> Iterator[Warp]:
        """Likely views of the next frame, the likeliest first."""
        half = max(self.size) / 2
        for x, y in likely_shifts(self.gray, gray):
            h = np.array([0, 0, -x / half, 0, 0, -y / half, 0, 0])
            yield replace(self.view, h=composed(h, self.view.h), bends=np.zeros((2, 2)))

    def _seen(self, view: Warp) -> LinearImage:
        how = replace(view, source=self.grid)
        return LinearImage(warped(self.rgb, how), valid=warped_mask(self.seen, how))

    def _pasted(self, frame: LinearImage, view: Warp, gain: Array) -> str:
        """Add what a frame shows first; why it cannot be."""
        if not self.grows:
            return ""
        needed = _canvas_of([view], self.size, 1)
        corners = [
            np.array([grid.origin, np.add(grid.origin, grid.size)]) for grid in (needed, self.grid)
        ]
        (x0, y0), (x1, y1) = np.min(corners, axis=0)[0], np.max(corners, axis=0)[1]
        if (x1 - x0) * (y1 - y0) > _MAX_CANVAS_RATIO * self.size[0] * self.size[1]:
            return "it looks too far away from the first frame"
        (X0, Y0), (X1, Y1) = corners[1]
        around = (Y0 - y0, y1 - Y1), (X0 - x0, x1 - X1)
        self.rgb, self.seen = np.pad(self.rgb, (*around, (0, 0))), np.pad(self.seen, around)
        self.grid = PixelGrid((int(x1 - x0), int(y1 - y0)), (int(x0), int(y0)))
        how = replace(view.inverse, target=self.grid)
        new = warped_mask(frame.valid, how) & ~self.seen
        light = warped((frame.rgb / np.maximum(gain, 1e-3)).astype(np.float32), how)
        self.rgb[new], self.seen = light[new], self.seen | new
        return ""


def _is_upright(frame: LinearImage) -> bool:
    """Whether the sensor's rows follow one another along y."""
    return frame.meta.readout in ("down", "up")


def _bend(fit: Alignment, view: Warp) -> Array:
    """(2,) bend of a frame by a rolling shutter, revised by a fit if that is certain."""
    across = int(view.upright)
    moved = centered(fit.level.xy, fit.level.size)[:, across, None, None] ** 2 * np.eye(2)
    score, information = _beyond_homography(fit, moved)
    step = np.linalg.solve(information, score)
    bend = np.asarray(view.bends[0] + step)
    side = fit.level.size[across]
    most = float(np.hypot(*bend)) * (side / max(fit.level.size)) ** 2 * max(view.size) / 2
    is_certain = float(score @ step) > _MIN_CERTAIN_STD**2 and most > _MIN_MOVED_PX
    return bend if is_certain else np.asarray(view.bends[0])


def _beyond_homography(fit: Alignment, moved: Array) -> tuple[Array, Array]:
    """Score (m,) and information (m, m) of parameters of which the homography takes a part.

    moved (n, 2, m): displacements in the plate by them, in centered coordinates.
    """
    residuals, slopes = residuals_and_slopes(fit.level, fit.h, fit.light, list(range(8)), [0])
    depth = centered(fit.level.xy, fit.level.size) @ fit.h[6:] + 1
    more = np.einsum("ncd,ndm->ncm", slopes[..., [2, 5]], moved * depth[:, None, None])
    use = np.isfinite(residuals) & (np.abs(np.nan_to_num(residuals)) < 3 * fit.scale)
    J = np.concatenate([slopes[..., :8], slopes[..., 8:] * np.eye(3), more], axis=-1)[use]
    J, r, n = J / fit.scale, residuals[use] / fit.scale, J.shape[1] - moved.shape[2]
    normal, gradient = J.T @ J + 1e-9 * np.eye(J.shape[1]), J.T @ r
    taken = np.linalg.solve(normal[:n, :n], np.column_stack([normal[:n, n:], gradient[:n]]))
    information = normal[n:, n:] - normal[n:, :n] @ taken[:, :-1]
    return -(gradient[n:] - normal[n:, :n] @ taken[:, -1]), information


def _lens(frames: Sequence[LinearImage], path: CameraPath, cell: int) -> tuple[float, float]:
    """Change of the lens term, and its error, from frames compared with the reference frame.

    A lens bends the displacement of a frame against the reference; the homography takes a part of
    that, and is fitted with it.
    """
    size, center = path.size, (np.array([path.size]) - 1) / 2
    reach = {
        k: float(np.hypot(*(path.view(k).points(center) - center)[0])) for k in path.registered
    }
    middle = min(reach, key=lambda k: reach[k])
    reference = _cells(frames[middle], cell)
    some = sorted(reach, key=lambda k: -reach[k])
    equations = []
    for k in some:
        view = Warp(path.view(k).h, reference.size, path.lens)  # a lens looks like a bend
        seen = seen_through(view, reference)
        if k == middle or seen.valid.mean() < _LENS_MIN_OVERLAP or reach[k] < 0.02 * max(size):
            continue
        equations.append(_lens_equation(_cells(frames[k], cell), seen, view))
        if len(equations) == _LENS_FRAMES:
            break
    if len(equations) < 2:
        return 0.0, np.inf
    score, information = np.array(equations).T
    each, total = score / np.maximum(information, 1e-12), information.sum()
    mean = float(np.sum(information * each) / total)
    scatter = float(np.sum(information**2 * (each - mean) ** 2)) / total**2
    return float(np.clip(mean, -_MAX_LENS, _MAX_LENS)), float(np.sqrt(max(scatter, 1 / total)))


def _lens_equation(frame: LinearImage, seen: LinearImage, view: Warp) -> tuple[float, float]:
    """Score and information of the lens term in a frame, of which its homography takes a part."""
    level = next(_levels(frame, seen))
    fit = fit_level(level, level.identity, HOMOGRAPHY)
    xy, step = level.xy.astype(float), _LENS_STEP
    more, less = (replace(view, lens=view.lens + d).points(xy) for d in (step, -step))
    back = view.inverse  # the displacement of the reference's pixels in those of the frame
    moved = (back.points(more) - back.points(less)) / (2 * step) * 2 / max(level.size)
    score, information = _beyond_homography(fit, moved[..., None])
    return float(score[0]), float(information[0, 0])

"""How much the radius of an object depends on a transfer curve that its clip does not state.

A rim is where half of the light is the object's. With another curve this half is elsewhere, so all
radii of a clip shift alike. The few frames measured here with each curve give that shift, which no
scatter of frames shows.
"""

from collections.abc import Iterable, Sequence

import numpy as np

from blurmatte.background import CameraPath
from blurmatte.errors import BlurmatteError
from blurmatte.motion.clip.detections import FrameMotion, Sighting
from blurmatte.radiometry import LinearImage
from blurmatte.streaks import find_streaks
from blurmatte.sweep.fit_sweep import fit_disc
from blurmatte.sweep.transfer_fit import UNSTATED_CURVES, with_curve

_FRAMES = 3  # measured with each curve; their shifts differ by a tenth
_MARGIN = 24  # pixels around the streak


def radius_spread(
    frames: Sequence[LinearImage],
    plate: LinearImage,
    rows: Sequence[FrameMotion],
    numbers: Iterable[int] | None = None,
    camera: CameraPath | None = None,
) -> float:
    """Relative standard deviation of the radius over the curves; 0 if no frame shows it.

    frames, plate: decoded with the curve that was assumed.
    rows: places in pixels of the frames.
    numbers: of the frames, 0, 1, … if not given.
    camera: of one that moves, on whose canvas the plate is.
    """
    places = {k: i for i, k in enumerate(range(len(frames)) if numbers is None else numbers)}
    whole = [(r.frame, r.sighting) for r in rows if r.sighting is not None and r.sighting.is_whole]
    if not whole:
        return 0.0
    inner = (np.arange(_FRAMES) + 0.5) * len(whole) / _FRAMES  # off the ends, which may be cut
    some = [whole[k] for k in inner.astype(int)]

    def behind(k: int) -> LinearImage:
        """The plate of a frame."""
        return plate if camera is None else camera.plate_at(k, plate)

    at = ((places[k], one) for k, one in dict(some).items())
    found = [_log_radii(frames[k], behind(k), one) for k, one in at]
    known = [radii for radii in found if radii is not None]
    return float(np.sqrt(np.mean(np.mean(known, axis=0) ** 2))) if known else 0.0


def _log_radii(
    frame: LinearImage, plate: LinearImage, seen: Sighting
) -> np.typing.NDArray[np.float64] | None:
    """(curves,) log of the radius with each curve over that with the assumed one; None if unknown."""
    assumed = frame.meta.transfer
    if assumed is None:
        return None
    (width, height), reach = frame.size, seen.motion.radius + _MARGIN
    xs, ys = seen.motion.trajectory.xy[[0, -1]].T.tolist()
    box = (
        max(int(min(xs) - reach), 0),
        max(int(min(ys) - reach), 0),
        min(int(max(xs) + reach) + 1, width),
        min(int(max(ys) + reach) + 1, height),
    )
    image, behind = frame.crop(box), plate.crop(box)
    radii = []
    try:
        for curve in (assumed, *UNSTATED_CURVES):
            pair = with_curve(image, behind, curve)
            radii.append(fit_disc(*pair, find_streaks(*pair)[0]).radius)
    except (BlurmatteError, IndexError):
        return None
    return np.asarray(np.log(np.array(radii[1:]) / radii[0]))

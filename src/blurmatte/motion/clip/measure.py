"""measure_clip: frames → the motion of an object, or of several, in each of them."""

from collections.abc import Sequence

from blurmatte.background import make_plate
from blurmatte.checks import check_kind
from blurmatte.color.model import ColorModel
from blurmatte.motion.clip.color import clip_color
from blurmatte.motion.clip.detect import sightings
from blurmatte.motion.clip.detections import FrameMotion
from blurmatte.motion.clip.linking import link_objects, link_sightings
from blurmatte.motion.clip.workers import Workers, shared
from blurmatte.radiometry import LinearImage


def measure_clip(
    frames: Sequence[LinearImage],
    plate: LinearImage | None = None,
    model: ColorModel | None = None,
    *,
    several: bool = False,
    rate: float | None = None,
    workers: int | Workers = 1,
) -> list[FrameMotion]:
    """Measure a moving object, or several, in all frames of a clip of a fixed camera.

    All frames share one plate and one color. Streaks of that color are measured in each frame alone
    (`sightings`), then joined to tracks (`link_sightings`); arms, strings and shadows are ignored. The
    neighboring frames give the direction of time of each motion.

    Parameters
    ----------
    frames : sequence of LinearImage
        From `read_frames`, or a list.
    plate : LinearImage, optional
        The scene without the object; made from the frames if not given.
    model : ColorModel, optional
        Its color; `clip_color` finds it if not given.
    several : bool
        Track every object of that color that is visible in three frames or more (`link_objects`),
        instead of the strongest one. For objects of different colors use `ColorModel.any()`; they must
        be discs.
    rate, workers
        As in `sightings`.

    Returns
    -------
    list of FrameMotion
        One for each frame, including those without a detection; for several objects one for each in
        the frame.

    Raises
    ------
    PlateError
        If no plate can be made from the frames.
    ColorModelError
        If no color was given and no frame determines it.
    ValueError
        As in `sightings`.
    """
    check_kind("model", model, ColorModel | None, 'use blurmatte.ColorModel.from_hex("#d8ff3c")')
    if plate is None:
        plate = make_plate(frames).plate
    with shared(workers) as processes:
        if model is None:
            model = clip_color(frames, plate, processes)
        seen = sightings(frames, plate, model, several=several, rate=rate, workers=processes)
        return link_objects(seen) if several else link_sightings(seen)

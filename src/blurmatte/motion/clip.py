"""measure_clip: frames → where an object, or several, was in each of them."""

from collections.abc import Sequence

from blurmatte.background import make_plate
from blurmatte.checks import check_kind
from blurmatte.color import ColorModel
from blurmatte.motion.clip_color import clip_color
from blurmatte.motion.linking import FrameMotion, link_objects, link_sightings
from blurmatte.motion.sightings import sightings
from blurmatte.motion.workers import Workers, shared
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
    """Measure a moving object, or several, in all frames of a clip of a camera that stands still.

    All frames share one plate and one color. What has that color is measured in each frame by itself
    (`sightings`), then joined to tracks (`link_sightings`); arms, strings and shadows are left
    aside. Which way the object went within each exposure follows from its neighbors.

    Parameters
    ----------
    frames : sequence of LinearImage
        `read_frames`, or a list.
    plate : LinearImage, optional
        The scene without the object; made of the frames if not given.
    model : ColorModel, optional
        Its color; `clip_color` finds it if not given.
    several : bool
        Follow every object of that color that shows in three frames or more (`link_objects`), instead
        of the clearest alone. Of different colors: `ColorModel.any()`, for discs.
    rate, workers
        As in `sightings`.

    Returns
    -------
    list of FrameMotion
        One for each frame, also those in which nothing was found; of several objects one for each
        in it.

    Raises
    ------
    PlateError
        If the frames make no plate.
    ColorModelError
        If no color was given and no frame tells it.
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

"""burst_plate: the plate of one shot from other shots of the same scene, as from the hand."""

from collections.abc import Sequence

import numpy as np

from blurmatte.background.fit_match import Matching, fit_match
from blurmatte.background.match import Match
from blurmatte.background.plate import plate_of_shots
from blurmatte.background.robust_mean_kernel import UNSEEN
from blurmatte.background.warp import warped_mask
from blurmatte.radiometry import LinearImage


def burst_plate(
    image: LinearImage, plates: Sequence[LinearImage], matching: Matching | None = None
) -> tuple[LinearImage, list[Match]]:
    """The scene behind the object in an image, from other shots, each with the object elsewhere.

    Each shot is matched to the image alone. The plate of a pixel is the light that most of all
    shots agree on, the image included; it is the mean of those shots that show it, without the image.

    Parameters
    ----------
    image : LinearImage
    plates : sequence of LinearImage
        Two or more, of the size of the image.
    matching : Matching, optional
        As in `fit_match`.

    Returns
    -------
    plate : LinearImage
        In pixels and light of the image, its noise known. Not `valid` where no two shots agree, as
        where the object is in front of one place in all of them.
    matches : list of Match
        Of each.

    Raises
    ------
    ValueError
        If the sizes differ, or there is but one plate.
    PlateError
        If a shot shows another place or too different a light.
    """
    if len(plates) < 2:
        raise ValueError(f"plates must be two or more, got {len(plates)}; use match_plate for one")
    matches = [fit_match(image, plate, matching) for plate in plates]
    pairs = zip(matches, plates, strict=True)
    return plate_of_shots(image, [_shown(match, plate) for match, plate in pairs]), matches


def _shown(match: Match, plate: LinearImage) -> LinearImage:
    """A plate as the image sees it; the light of what it does not show is UNSEEN."""
    matched = match.apply(plate)
    rgb = np.array(matched.rgb, np.float32)
    if match.moves:
        rgb[~warped_mask(np.ones(plate.valid.shape, bool), match.h)] = UNSEEN
    return LinearImage(rgb, valid=matched.valid, meta=plate.meta)

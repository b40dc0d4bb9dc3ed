"""The possible colors of an object, and their evidence."""

from collections.abc import Iterator

import numpy as np

from blurmatte.color.model import ColorModel

_MAX_STD_DEG = 30.0  # of evidence that is worth a number
_EVIDENCE = {
    "hue variation": "the hues of the plate behind the streak alone",
    "shape": "the shape of the streak and the hues together",
    "compression": "hues in a file that lets the colors of neighbors run together",
    "feasibility": "alpha between 0 and 1, and no negative light, alone",
    "frames": "several frames together",
    "samples": "the scatter of the sampled colors alone",
}
_ANY = (
    "Any colors: alpha follows from the shape and its motion, or from the plate's texture, not from a "
    "color."
)


def color_in_words(model: ColorModel) -> Iterator[str]:
    """Sentences: the mean color of several, which colors are possible, and their evidence."""
    if model.rank > 1 and model.color:
        yield f"On average {model.color}."
    if model.rank == 3:
        yield _ANY
        return
    yield _directions(model)
    for name, std in model.evidence.items():
        source = _EVIDENCE.get(name, f"{name} alone")
        accuracy = f"to {std:.2g}°" if std < _MAX_STD_DEG else "nothing"
        yield f"From {source}: {accuracy}."
    if not model.evidence:
        yield "The color was given, not measured."
    limits = [" and ".join(other.hex) for other in model.possible]
    if len(set(limits)) > 1:  # they differ from the color in 8 bits
        yield f"In 95 of 100 cases no further away than {limits[1]} or {limits[5]}."


def _directions(model: ColorModel) -> str:
    colors = " and ".join(
        f"({', '.join(f'{x:.3f}' for x in color)})" for color in np.round(model.rgb, 3) + 0.0
    )
    space = "linear RGB" if model.to_srgb is None else "camera's own linear RGB"
    if model.rank == 1:
        return f"One paint and its shades: all multiples of the {space} color {colors}."
    return f"Two paints and their mixtures: a plane of colors between {space} {colors}."

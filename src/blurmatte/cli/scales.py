"""How meters per pixel follow from the size of a ball, a scale or two points, as options say them."""

import math
from collections.abc import Callable

import blurmatte as bm
from blurmatte.cli.clip_table import Rows, Scaling, usual_radius
from blurmatte.cli.quantities import length


def scaling(
    radius: str | None, diameter: str | None, scale: str | None, points: str | None
) -> Callable[[bm.Motion], bm.Scale] | None:
    """How meters per pixel follow from a motion, by the one option that was given."""
    given = [text for text in (radius, diameter, scale, points) if text is not None]
    if len(given) > 1:
        raise ValueError("give one of --radius, --diameter, --scale and --points")
    if radius is not None:
        half, std = length("--radius", radius)
        return lambda motion: bm.Scale.from_radius(motion, half, std)
    if diameter is not None:
        whole, std = length("--diameter", diameter)
        return lambda motion: bm.Scale.from_radius(motion, whole / 2, std / 2)
    if scale is not None:
        told = bm.Scale(*length("--scale", scale))
        return lambda _: told
    if points is None:
        return None
    *place, distance = points.split(",")
    try:
        x0, y0, x1, y1 = map(float, place)
    except ValueError:
        raise ValueError(f"--points must be x0,y0,x1,y1,length, got {points!r}") from None
    between = bm.Scale.from_points((x0, y0), (x1, y1), *length("--points", distance))
    return lambda _: between


def clip_scaling(
    radius: str | None, diameter: str | None, scale: str | None, points: str | None
) -> Scaling | None:
    """How meters per pixel follow from the frames of a clip; of the ball's size, from its usual one."""
    scaled = scaling(radius, diameter, scale, points)
    if radius is None and diameter is None:
        return None if scaled is None else lambda _: scaled(None)  # type: ignore[arg-type]
    true, std = length("--radius", radius) if radius else length("--diameter", diameter or "")
    half = 1.0 if radius else 0.5

    def told(rows: Rows) -> bm.Scale:
        seen, seen_std = usual_radius(rows)
        relative = math.hypot(std / true, seen_std / seen)
        return bm.Scale(half * true / seen, half * true / seen * relative)

    return told

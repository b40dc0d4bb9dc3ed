"""What a streak says of space: a ball before a camera, a way on a plane, a depth, a turn."""

import re
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

import blurmatte as bm
from blurmatte.cli.quantities import length, meters, meters_per_second

_POINT = r"\s*(-?[\d.]+)\s*,\s*(-?[\d.]+)\s*=\s*([^,=]+),([^,=]+)"
_LEAST = 4  # points that fix a plane
_OFF = 0.1  # of width and height: farther from the middle no lens is mounted

Camera = Annotated[
    Path | None,
    typer.Option(
        help="JSON of the calibrated camera: where the ball of --radius was in space, of a clip in "
        "each frame, or, with --speed, how far away it went."
    ),
]

Plate = Annotated[
    Path | None,
    typer.Option(
        help="With --camera, --radius and --image: the scene without the object. The flight is then "
        "fitted to the pictures, along the line of sight too. Of a clip: its plate; made of it if not "
        "given."
    ),
]

OnPlane = Annotated[
    list[str] | None,
    typer.Option(
        metavar="X,Y=U,V",
        help="It moved on a plane, and pixel X,Y shows the point of it that lies at U,V, lengths; "
        "repeat for four points or more.",
    ),
]

Height = Annotated[
    str | None,
    typer.Option(metavar="LENGTH[±ERROR]", help="With --on-plane: of its middle above the plane."),
]

SpeedKnown = Annotated[
    str | None,
    typer.Option(
        "--speed",
        metavar="SPEED[±ERROR]",
        help="With --camera: its true speed, parallel to the picture: 12m/s, 43km/h, 27mph.",
    ),
]

Rotation = Annotated[
    bool, typer.Option("--rotation", help="Measure how far it turned, and about which point.")
]

Found = bm.BallMotion | bm.PlaneMotion | bm.BlurDepth | bm.Rotation
Exposed = tuple[float | None, float]
Quantity = tuple[float, float]


@dataclass(frozen=True)
class Before:
    """The pictures that a flight can be fitted to."""

    image: bm.LinearImage | None
    plate: bm.LinearImage


@dataclass(frozen=True)
class Known:
    """What is known of the space that a picture shows; quantities with their errors, meters, m/s."""

    lens: bm.Intrinsics | None
    radius: Quantity | None
    speed: Quantity | None
    plane: bm.Plane | None
    height: Quantity | None

    def __post_init__(self) -> None:
        if self.speed is not None and self.lens is None:
            raise ValueError("--speed needs --camera, the calibrated camera")
        if self.height is not None and self.plane is None:
            raise ValueError("--height needs --on-plane, the plane that it is above")
        if self.lens is not None and not (self.radius or self.speed or self.plane):
            raise ValueError(
                "--camera needs --radius or --diameter, the true size of the ball, or --speed"
            )


def known_of(
    camera: Path | None,
    radius: Quantity | None,
    speed: str | None,
    on_plane: Sequence[str],
    height: str | None,
) -> Known:
    """What the options say, before anything else is read."""
    lens = None if camera is None else bm.read_intrinsics(camera)
    return Known(
        lens,
        radius,
        None if speed is None else meters_per_second("--speed", speed),
        _plane(on_plane, lens) if on_plane else None,
        None if height is None else meters("--height", height),
    )


def check_camera(lens: bm.Intrinsics, size: tuple[int, int]) -> None:
    """Whether it may be the camera of pictures of a size; a warning if that is not known, nor likely.

    Raises
    ------
    ValueError
        If it was calibrated with pictures of another size.
    """
    lens.check_size(size)
    (x, y), axis = ((n - 1) / 2 for n in size), (lens.cx, lens.cy)
    off = abs(axis[0] - x) / size[0], abs(axis[1] - y) / size[1]
    if lens.size is None and max(off) > _OFF:
        warnings.warn(
            "the camera's axis meets the picture at ({:.0f}, {:.0f}), far from its middle, ({:.0f}, "
            "{:.0f}): if it was calibrated with pictures of another size than {}x{}, all of space is "
            'wrong; calibrate with such, and say "size": [{}, {}] in its file'.format(
                *axis, x, y, *size, *size
            ),
            bm.BlurmatteWarning,
            stacklevel=2,
        )


def true_radius(radius: str | None, diameter: str | None) -> Quantity | None:
    """Of the ball, by the one option that was given; and its error."""
    text = radius if radius is not None else diameter
    if text is None:
        return None
    name, part = ("--radius", 1.0) if radius is not None else ("--diameter", 0.5)
    value, std = length(name, text)
    return part * value, part * std


def in_space(
    solution: bm.Solution, known: Known, exposed: Exposed, before: Before | None
) -> Iterator[Found]:
    """All that follows from what is known; `exposed` is the exposure time and its error."""
    if before is not None and (before.image is None or not (known.lens and known.radius)):
        raise ValueError("--plate needs --image, --camera and --radius, to fit a flight in space")
    if known.lens is not None:
        check_camera(known.lens, solution.size)
    if known.lens is not None and known.radius is not None:
        yield _ball(solution, known.lens, known.radius, exposed, before)
    if known.lens is not None and known.speed is not None:
        yield _depth(solution, known.lens, known.speed, exposed)
    if known.plane is not None:
        above = known.height or (0.0, 0.0)
        yield bm.measure_on_plane(_sweep(solution, "--on-plane"), known.plane, *exposed, *above)


def turned(solution: bm.Solution, exposed: Exposed) -> bm.Rotation:
    """Of what flies and turns from its outline, else from alpha."""
    sweep = solution.sweep
    turns = sweep is not None and sweep.silhouette.turns
    return bm.measure_rotation(sweep if sweep and turns else solution, None, *exposed)


def _ball(
    solution: bm.Solution,
    lens: bm.Intrinsics,
    radius: Quantity,
    exposed: Exposed,
    before: Before | None,
) -> bm.BallMotion:
    (time, time_std), (size, std) = exposed, radius
    if before is None or before.image is None:
        return bm.measure_ball(_sweep(solution, "--camera"), lens, size, time, std, time_std)
    plate = bm.match_plate(before.plate, before.image)
    sweep = solution.sweep
    return bm.fit_ball(before.image, plate, lens, size, time, std, time_std, sweep)


def _depth(
    solution: bm.Solution, lens: bm.Intrinsics, speed: Quantity, exposed: Exposed
) -> bm.BlurDepth:
    (time, time_std), (value, std) = exposed, speed
    if time is None:
        raise ValueError("--speed needs --exposure, for the image's file does not tell the time")
    path = _sweep(solution, "--speed")
    return bm.depth_from_blur(path, lens, value, time, None, std, time_std)


def _plane(points: Sequence[str], lens: bm.Intrinsics | None) -> bm.Plane:
    pixels, places = [], []
    for text in points:
        found = re.fullmatch(_POINT, text)
        if found is None:
            raise ValueError(f"--on-plane must be like 120,300=0,1.5m, got {text!r}")
        pixels.append((float(found[1]), float(found[2])))
        places.append([meters("--on-plane", part.strip())[0] for part in found.groups()[2:]])
    if len(pixels) < _LEAST:
        raise ValueError(f"--on-plane is needed for {_LEAST} points or more, got {len(pixels)}")
    return bm.Plane.from_points(pixels, places, lens)


def _sweep(solution: bm.Solution, name: str) -> bm.Sweep:
    if solution.sweep is None:
        raise bm.MotionError(f"no shape on a path explains the streak; {name} needs one")
    return solution.sweep

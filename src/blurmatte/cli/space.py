"""What a streak says of space: a ball before a camera, a way on a plane, a depth, a turn."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

import blurmatte as bm
from blurmatte.cli.quantities import meters, meters_per_second

_POINT = r"\s*(-?[\d.]+)\s*,\s*(-?[\d.]+)\s*=\s*([^,=]+),([^,=]+)"
_LEAST = 4  # points that fix a plane

Camera = Annotated[
    Path | None,
    typer.Option(
        help="JSON of the calibrated camera: where the ball of --radius was in space, or, with "
        "--speed, how far away it went."
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


@dataclass(frozen=True)
class Before:
    """The pictures that a flight can be fitted to."""

    image: bm.LinearImage | None
    plate: bm.LinearImage


def in_space(
    solution: bm.Solution,
    exposed: Exposed,
    before: Before | None,
    camera: Path | None,
    radius: str | None,
    on_plane: Sequence[str],
    height: str | None,
    speed: str | None,
    rotation: bool,
) -> Iterator[Found]:
    """All that was asked for, one after another; `exposed` is the exposure time and its error."""
    if speed is not None and camera is None:
        raise ValueError("--speed needs --camera, the calibrated camera")
    if before is not None and (before.image is None or camera is None or radius is None):
        raise ValueError("--plate needs --image, --camera and --radius, to fit a flight in space")
    lens = None if camera is None else bm.read_intrinsics(camera)
    if lens is not None:
        if radius is None and speed is None and not on_plane:
            raise ValueError("--camera needs --radius, the true size of the ball, or --speed")
        if radius is not None:
            yield _ball(solution, lens, radius, exposed, before)
        if speed is not None:
            yield _depth(solution, lens, speed, exposed)
    if on_plane:
        yield _plane(solution, lens, on_plane, height, exposed)
    elif height is not None:
        raise ValueError("--height needs --on-plane, the plane that it is above")
    if rotation:
        sweep = solution.sweep
        turns = sweep is not None and sweep.silhouette.turns
        yield bm.measure_rotation(sweep if sweep and turns else solution, None, *exposed)


def _ball(
    solution: bm.Solution,
    lens: bm.Intrinsics,
    radius: str,
    exposed: Exposed,
    before: Before | None,
) -> bm.BallMotion:
    time, time_std = exposed
    size, std = meters("--radius", radius)
    if before is None or before.image is None:
        return bm.measure_ball(_sweep(solution, "--camera"), lens, size, time, std, time_std)
    plate = bm.match_plate(before.plate, before.image)
    sweep = solution.sweep
    return bm.fit_ball(before.image, plate, lens, size, time, std, time_std, sweep)


def _depth(
    solution: bm.Solution, lens: bm.Intrinsics, speed: str, exposed: Exposed
) -> bm.BlurDepth:
    time, time_std = exposed
    if time is None:
        raise ValueError("--speed needs --exposure, for the image's file does not tell the time")
    value, std = meters_per_second("--speed", speed)
    path = _sweep(solution, "--speed")
    return bm.depth_from_blur(path, lens, value, time, None, std, time_std)


def _plane(
    solution: bm.Solution,
    lens: bm.Intrinsics | None,
    points: Sequence[str],
    height: str | None,
    exposed: Exposed,
) -> bm.PlaneMotion:
    pixels, places = [], []
    for text in points:
        found = re.fullmatch(_POINT, text)
        if found is None:
            raise ValueError(f"--on-plane must be like 120,300=0,1.5m, got {text!r}")
        pixels.append((float(found[1]), float(found[2])))
        places.append([meters("--on-plane", part.strip())[0] for part in found.groups()[2:]])
    if len(pixels) < _LEAST:
        raise ValueError(f"--on-plane is needed for {_LEAST} points or more, got {len(pixels)}")
    plane = bm.Plane.from_points(pixels, places, lens)
    above = (0.0, 0.0) if height is None else meters("--height", height)
    return bm.measure_on_plane(_sweep(solution, "--on-plane"), plane, *exposed, *above)


def _sweep(solution: bm.Solution, name: str) -> bm.Sweep:
    if solution.sweep is None:
        raise bm.MotionError(f"no shape on a path explains the streak; {name} needs one")
    return solution.sweep

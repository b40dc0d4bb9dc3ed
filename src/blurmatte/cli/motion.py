"""The command that measures motion: measure."""

import json
import math
import re
from collections.abc import Callable, Iterator
from fractions import Fraction
from pathlib import Path
from typing import Annotated, Any

import typer

import blurmatte as bm
from blurmatte.cli.inputs import Files
from blurmatte.cli.options import MaxPixels, TransferName
from blurmatte.cli.printing import say
from blurmatte.cli.program import about, app, told

_METERS = {"": 1.0, "m": 1.0, "cm": 0.01, "mm": 0.001, "km": 1000.0}
_SECONDS = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6}
_NUMBER = r"([+-]?[\d.]+(?:e[+-]?\d+)?(?:/[\d.]+)?)\s*([a-zµ]*)"
_LENGTH = "LENGTH[±ERROR]"


@app.command()
@told
def measure(
    layer: Annotated[Path, typer.Argument(metavar="LAYER", help="The layer.exr that solve wrote.")],
    as_json: Annotated[
        bool, typer.Option("--json", help="Print all numbers as JSON instead of words.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(help="Where to write all numbers: a .json, or a .csv of one row.")
    ] = None,
    radius: Annotated[
        str | None, typer.Option(metavar=_LENGTH, help="True radius of the ball: 20mm, 2cm±0.1mm.")
    ] = None,
    diameter: Annotated[
        str | None, typer.Option(metavar=_LENGTH, help="True diameter of the ball.")
    ] = None,
    scale: Annotated[
        str | None, typer.Option(metavar=_LENGTH, help="How large a pixel is there: 1.4mm.")
    ] = None,
    points: Annotated[
        str | None,
        typer.Option(
            metavar="X0,Y0,X1,Y1,LENGTH[±ERROR]",
            help="Two points of the picture and how far they are apart, as near as the object.",
        ),
    ] = None,
    exposure: Annotated[
        str | None,
        typer.Option(
            metavar="TIME[±ERROR]", help="Exposure time, 1/60 or 4ms, if not in the file."
        ),
    ] = None,
    line_time: Annotated[
        str | None,
        typer.Option(
            metavar="TIME", help="From row to row of a rolling shutter: 15us; 0 for none."
        ),
    ] = None,
    going: Annotated[
        str | None,
        typer.Option(metavar="down|up", help="Which way it moved, if you know, for --line-time."),
    ] = None,
    camera: Annotated[
        Path | None,
        typer.Option(
            help="JSON of the calibrated camera: where the ball of --radius was in space."
        ),
    ] = None,
    rotation: Annotated[
        bool, typer.Option("--rotation", help="Measure how far it turned, and about which point.")
    ] = False,
    overlay: Annotated[
        Path | None, typer.Option(help="Draw path and outlines over --image: a .png or .jpg.")
    ] = None,
    image: Annotated[Path | None, typer.Option(help="The picture that was solved.")] = None,
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Measure the motion in LAYER: where, how far, how fast, how large."""
    if (overlay is None) != (image is None):
        raise ValueError("--overlay and --image belong together: what to draw, and on what")
    if going not in (None, "down", "up"):
        raise ValueError(f"--going must be down or up, got {going!r}")
    scaled = _scaling(radius, diameter, scale, points)
    time, time_std = (None, 0.0) if exposure is None else _seconds("--exposure", exposure)
    line = None if line_time is None else _seconds("--line-time", line_time)[0]
    downward = None if going is None else going == "down"
    with about(layer):
        solution = bm.read_solution(layer, max_pixels)
        motion = bm.measure_motion(solution)
        known = None if scaled is None else scaled(motion)
        exposed = (motion.exposure_time if time is None else time, time_std)
        more: list[bm.BallMotion | bm.Rotation]
        more = list(_in_space(solution, camera, radius, exposed))
        if rotation:
            more.append(bm.measure_rotation(_turning(solution), None, *exposed))
        speed = motion.speed(known, time, time_std, line, downward)
    words = [words for thing in (motion, speed, *more) for words in bm.explain(thing)]
    row = {**motion.numbers(), **speed.numbers()}
    numbers = {**row, **_over_time(motion), "in_words": words}
    drawn = None
    if image is not None:
        picture, _ = Files(transfer, max_pixels).read(image)
        with about(image):
            drawn = bm.draw_motion(picture, solution, motion)
    if out is not None:
        bm.write(out, row if out.suffix.lower() == ".csv" else numbers)
    if overlay is not None and drawn is not None:
        bm.write(overlay, drawn)
    say(json.dumps(_finite(numbers), indent=2) if as_json else "\n".join([str(motion), *words]))


def _in_space(
    solution: bm.Solution,
    camera: Path | None,
    radius: str | None,
    exposed: tuple[float | None, float],
) -> Iterator[bm.BallMotion]:
    """Where the ball was, if a camera is given."""
    if camera is None:
        return
    if radius is None:
        raise ValueError("--camera needs --radius, the true size of the ball")
    if solution.sweep is None:
        raise bm.MotionError(
            "no shape on a path explains the streak; --camera needs one, of a ball"
        )
    size, std = _meters("--radius", radius)
    lens = bm.read_intrinsics(camera)
    yield bm.measure_ball(solution.sweep, lens, size, exposed[0], std, exposed[1])


def _turning(solution: bm.Solution) -> bm.Solution | bm.Sweep:
    """What tells a turn: an outline that turns on its way, or else alpha."""
    sweep = solution.sweep
    return sweep if sweep is not None and sweep.silhouette.turns else solution


def _over_time(motion: bm.Motion) -> dict[str, Any]:
    """Where it was at each exposure fraction, and how fast between them."""
    path = motion.trajectory
    return {
        "trajectory": {"t": path.t.tolist(), "xy": path.xy.tolist()},
        "speeds": motion.speeds.tolist(),
        "speeds_std": motion.speeds_std.tolist(),
        "covariance": motion.covariance.tolist(),
    }


def _finite(value: Any) -> Any:
    """JSON has no infinity: null."""
    if isinstance(value, dict):
        return {name: _finite(part) for name, part in value.items()}
    if isinstance(value, list):
        return [_finite(part) for part in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _scaling(
    radius: str | None, diameter: str | None, scale: str | None, points: str | None
) -> Callable[[bm.Motion], bm.Scale] | None:
    """How meters per pixel follow from a motion, by the one option that was given."""
    given = [text for text in (radius, diameter, scale, points) if text is not None]
    if len(given) > 1:
        raise ValueError("give one of --radius, --diameter, --scale and --points")
    if radius is not None:
        half, std = _meters("--radius", radius)
        return lambda motion: bm.Scale.from_radius(motion, half, std)
    if diameter is not None:
        whole, std = _meters("--diameter", diameter)
        return lambda motion: bm.Scale.from_radius(motion, whole / 2, std / 2)
    if scale is not None:
        told = bm.Scale(*_meters("--scale", scale))
        return lambda _: told
    if points is None:
        return None
    *place, distance = points.split(",")
    try:
        x0, y0, x1, y1 = map(float, place)
    except ValueError:
        raise ValueError(f"--points must be x0,y0,x1,y1,length, got {points!r}") from None
    between = bm.Scale.from_points((x0, y0), (x1, y1), *_meters("--points", distance))
    return lambda _: between


def _meters(name: str, text: str) -> tuple[float, float]:
    return _with_error(name, text, _METERS, "a length like 0.02, 2cm or 2cm±0.1mm")


def _seconds(name: str, text: str) -> tuple[float, float]:
    return _with_error(name, text, _SECONDS, "a time like 1/60, 0.004, 4ms or 15us")


def _with_error(name: str, text: str, units: dict[str, float], what: str) -> tuple[float, float]:
    """Value and error, each a number or fraction with a unit."""
    values = []
    for part in text.replace("+-", "±").split("±"):
        found = re.fullmatch(_NUMBER, part.strip())
        if found is None or found[2] not in units:
            raise ValueError(f"{name} must be {what}, got {text!r}")
        try:
            values.append(units[found[2]] * float(Fraction(found[1])))
        except (ValueError, ZeroDivisionError):
            raise ValueError(f"{name} must be {what}, got {text!r}") from None
    if len(values) > 2:
        raise ValueError(f"{name} must be {what}, got {text!r}")
    return values[0], values[1] if len(values) == 2 else 0.0

"""The command that measures motion: measure."""

import json
import math
from pathlib import Path
from typing import Annotated, Any

import typer

import blurmatte as bm
from blurmatte.cli.clip_table import Given, gravity_of, table, told_of, words
from blurmatte.cli.clips import ClipTask, finish, measure_frames
from blurmatte.cli.flights import known_ball
from blurmatte.cli.inputs import Files, is_row
from blurmatte.cli.options import MaxPixels, TransferName
from blurmatte.cli.plates import When
from blurmatte.cli.printing import say
from blurmatte.cli.program import about, app, told
from blurmatte.cli.quantities import time_of_exposure, time_of_line
from blurmatte.cli.scales import clip_scaling, scaling
from blurmatte.cli.space import (
    Before,
    Camera,
    Found,
    Height,
    OnPlane,
    Plate,
    Rotation,
    SpeedKnown,
    in_space,
    known_of,
    true_radius,
    turned,
)
from blurmatte.cli.targets import SHEET, check_file, check_other

_LENGTH = "LENGTH[±ERROR]"


@app.command()
@told
def measure(
    layer: Annotated[
        Path,
        typer.Argument(
            metavar="LAYER|CLIP",
            help="The layer.exr that solve wrote; or a clip, a folder or a pattern of pictures.",
        ),
    ],
    as_json: Annotated[
        bool, typer.Option("--json", help="Print all numbers as JSON instead of words.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Where to write all numbers: a .json, or a .csv of one row; of a clip a row for each "
            "frame, .parquet too."
        ),
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
    camera: Camera = None,
    plate: Plate = None,
    on_plane: OnPlane = None,
    height: Height = None,
    speed: SpeedKnown = None,
    rotation: Rotation = False,
    overlay: Annotated[
        Path | None,
        typer.Option(
            help="Draw path and outlines over --image, or a clip's over its plate: a .png or .jpg."
        ),
    ] = None,
    image: Annotated[Path | None, typer.Option(help="The picture that was solved.")] = None,
    color: Annotated[
        str | None,
        typer.Option(
            metavar="HEX|FILE.json|any",
            help="Of a clip: the object's color; found in some of its frames if not given.",
        ),
    ] = None,
    several: Annotated[
        bool,
        typer.Option(
            "--several", help="Of a clip: follow every object of the color, with numbers."
        ),
    ] = False,
    least: Annotated[
        int | None,
        typer.Option(help="With --several: in how many frames an object is seen at least; 3."),
    ] = None,
    start: When = None,
    stop: When = None,
    step: Annotated[int, typer.Option(help="Of a clip: use every frame of that many.")] = 1,
    rate: Annotated[
        float | None, typer.Option(help="Of a clip: frames per second, if its frames do not tell.")
    ] = None,
    gravity: Annotated[
        str | None,
        typer.Option(
            metavar="G|X,Y|X,Y,Z[±ERROR]",
            help="Of a clip of a free fall: gravity in m/s², straight down in the picture or as the "
            "camera sees it. Gives the scale, or checks the one that was given. With --camera its "
            "size, or X,Y,Z.",
        ),
    ] = None,
    resume: Annotated[
        bool, typer.Option("--resume", help="Of a clip: go on where an interrupted run stopped.")
    ] = False,
    workers: Annotated[
        int | None,
        typer.Option(help="Of a clip: how many processes; one for each core if not given."),
    ] = None,
    transfer: TransferName = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Measure the motion in LAYER, or in each frame of CLIP: where, how far, how fast, how large."""
    check_file(overlay, "a sheet", *SHEET)
    check_other(overlay, layer, image, plate)
    if going not in (None, "down", "up"):
        raise ValueError(f"--going must be down or up, got {going!r}")
    time, time_std = (None, 0.0) if exposure is None else time_of_exposure("--exposure", exposure)
    line = None if line_time is None else time_of_line("--line-time", line_time)
    files = Files(transfer, max_pixels)
    if (layer / "layer.exr").is_file():
        raise ValueError(f"{layer} holds a solution: give {layer / 'layer.exr'}")
    if is_row(layer):
        if any((image, going, on_plane, height, speed, rotation)):
            raise ValueError(
                "--image, --going, --on-plane, --height, --speed and --rotation are for a layer, not "
                "for a clip"
            )
        ball = known_ball(camera, radius, diameter, (scale, points), line or 0.0)
        by_size = None if ball is not None else clip_scaling(radius, diameter, scale, points)
        timed = None if time is None else (time, time_std)
        given = Given(by_size, ball, gravity_of(gravity, ball is not None), timed, line or 0.0)
        task = ClipTask(
            layer,
            files,
            plate,
            color,
            several,
            least,
            start,
            stop,
            step,
            rate,
            workers,
            out,
            resume,
            ball,
            time,
            line or 0.0,
        )
        _measure_clip(task, given, overlay, as_json)
        return
    of_clip = color, least, start, stop, rate, workers, gravity
    if any(given is not None for given in of_clip) or several or resume or step != 1:
        raise ValueError(
            "--color, --several, --least, --start, --stop, --step, --rate, --gravity, --resume and "
            "--workers are for a clip"
        )
    check_file(out, "a motion", ".json", ".csv")
    if overlay is not None and image is None:
        raise ValueError("--overlay needs --image, the picture to draw on")
    if image is not None and overlay is None and plate is None:
        raise ValueError("--image is for --overlay, or for --plate with --camera")
    if going is not None and line_time is None:
        raise ValueError("--going is for --line-time, that of a rolling shutter")
    scaled = scaling(radius, diameter, scale, points)
    known = known_of(camera, true_radius(radius, diameter), speed, on_plane or [], height)
    downward = None if going is None else going == "down"
    picture = None if image is None else files.read(image)[0]
    before = None
    if plate is not None:
        before = Before(picture, files.read(plate)[0])
    with about(layer):
        solution = bm.read_solution(layer, max_pixels)
        motion = bm.measure_motion(solution)
        size = None if scaled is None else scaled(motion)
        exposed = (motion.exposure_time if time is None else time, time_std)
        told_speed = motion.speed(size, time, time_std, line, downward)
        more: list[Found] = list(in_space(solution, known, exposed, before))
        if rotation:
            more.append(turned(solution, exposed))
    words = [words for thing in (motion, told_speed, *more) for words in bm.explain(thing)]
    row = {**motion.numbers(), **told_speed.numbers()}
    for thing in more:
        row |= thing.numbers()
    numbers = {**row, **_over_time(motion), "in_words": words}
    if overlay is not None and picture is not None:
        with about(overlay):
            bm.write(overlay, bm.draw_motion(picture, solution, motion))
    if out is not None:
        bm.write(out, row if out.suffix.lower() == ".csv" else numbers)
    say(json.dumps(_finite(numbers), indent=2) if as_json else "\n".join([str(motion), *words]))


def _measure_clip(task: ClipTask, given: Given, overlay: Path | None, as_json: bool) -> None:
    """The table of a clip, its sheet, and what both say."""
    measured = measure_frames(task)
    rows, places = measured.rows, measured.places
    with about(task.source):
        found = told_of(rows, places, task.several, given)
    said = words(rows, measured.model, task.several)
    said += [word for one in found for word in one.words]
    lines = table(rows, places, found, given)
    if task.out is not None:
        bm.write(task.out, lines)
    if overlay is not None:
        bm.write(overlay, bm.draw_clip(measured.plate, rows, said, places))
    finish(task)
    falls = [None if one.fall is None else one.fall.numbers() for one in found]
    of_falls = {"falls": falls} if task.several else {"fall": falls[0]}
    numbers = {"rows": lines, **of_falls, "in_words": said}
    say(json.dumps(_finite(numbers), indent=2) if as_json else "\n".join(said))


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

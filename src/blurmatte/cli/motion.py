"""The commands that measure motion in one picture: measure, and locate for a known camera."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, TypeAlias

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.console import about, answer, grade_lines, optional, output, switch, waiting
from blurmatte.cli.paths import SHEET, check_file, layer_in
from blurmatte.cli.picture_solving import solved_picture_at
from blurmatte.cli.quantities import (
    LENGTH,
    SIZE,
    BallSize,
    Camera,
    ExposureTime,
    LineTime,
    Readout,
    ScaleOptions,
    check_camera,
    direction,
    meters,
    meters_per_second,
    time_of_exposure,
    time_of_line,
)
from blurmatte.cli.selection import CameraReading, KnownOpacity, Layer, Reading, Region, opacity_of
from blurmatte.formats import NUMBERS

PLANE = "A plane"
DRAWING = "Drawing"

_POINT = r"\s*(-?[\d.]+)\s*,\s*(-?[\d.]+)\s*=\s*([^,=]+),([^,=]+)"

Located: TypeAlias = "bm.motion.BallMotion | bm.motion.PlaneMotion | bm.motion.BlurDepth"

Numbers = Annotated[Path | None, output("Write all numbers: .json, or .csv of a row.")]


@dataclass(frozen=True)
class ExposureTiming:
    """When the pixels were exposed."""

    exposure: ExposureTime = None
    line_time: LineTime = None
    readout: Readout = None
    going: str | None = optional("down|up|left|right", "With --line-time, if known.", SIZE)

    def __post_init__(self) -> None:
        direction("--going", self.going)
        direction("--readout", self.readout)
        if self.going is not None and self.line_time is None:
            raise ValueError("--going needs --line-time, the time per row of a rolling shutter")


@dataclass(frozen=True)
class Drawing:
    """The picture of the path."""

    overlay: Path | None = optional("FILE", "Draw path and outlines: .png, .jpg.", DRAWING)
    image: Path | None = optional("FILE", "The picture to draw on.", DRAWING)

    def __post_init__(self) -> None:
        check_file(self.overlay, "a sheet", *SHEET)
        if self.overlay is not None and self.image is None:
            raise ValueError("--overlay needs --image, the picture to draw on")
        if self.image is not None and self.overlay is None:
            raise ValueError("--image needs --overlay, the file to draw to")


@dataclass(frozen=True)
class Unsolved:
    """What is needed to solve a picture that is given instead of a layer."""

    plate: Path | None = optional("FILE|none", "LAYER is a picture: solve it; none: guess.")
    region: Region = None
    opacity: KnownOpacity = None

    def __post_init__(self) -> None:
        opacity_of(self.opacity)
        for name, given in (("--region", self.region), ("--opacity", self.opacity)):
            if given is not None and self.plate is None:
                raise ValueError(f"{name} needs --plate: a layer.exr is solved already")


@command(
    "measure out/layer.exr --diameter 4cm --exposure 1/60",
    "measure throw.png --plate none --region 90,80,310,230 --diameter 4cm",
)
def measure(
    layer: Layer,
    picture: Unsolved,
    scale: ScaleOptions,
    timing: ExposureTiming,
    drawing: Drawing,
    reading: Reading,
    rotation: bool = switch("--rotation", "Also how far it turned, and about which point."),
    out: Numbers = None,
    as_json: AsJson = False,
) -> None:
    """Measure the motion in LAYER: place, length, speed and size.

    A picture with --plate is solved first. For a clip see track, for places in space locate.
    """
    check_file(out, "a motion", *NUMBERS)
    time, time_std = _time(timing.exposure)
    line = None if timing.line_time is None else time_of_line("--line-time", timing.line_time)
    going = direction("--going", timing.going)
    solution, motion = _read(layer, reading, picture)
    if readout := direction("--readout", timing.readout):
        motion = replace(motion, readout=readout)
    with about(layer), waiting("measuring"):
        speed = motion.speed(scale.of_motion(motion), time, time_std, line, going)
        found: list[Any] = [motion, speed]
        if rotation:
            exposed = (motion.exposure_time if time is None else time, time_std)
            found.append(_rotation(solution, exposed))
    if drawing.overlay is not None and drawing.image is not None:
        background = reading.read(drawing.image)
        with about(drawing.overlay):
            bm.write(drawing.overlay, bm.figures.draw_motion(background, solution, motion))
    _answer(solution, motion, found, out, as_json)


@dataclass(frozen=True)
class SpaceOptions(BallSize):
    """Known quantities of the space in front of the camera."""

    speed: str | None = optional("SPEED[±ERROR]", "Or its true speed: 12m/s, 43km/h.", SIZE)
    camera: Camera = None
    on_plane: list[str] | None = optional(
        "X,Y=U,V", "Pixel X,Y shows the point U,V of the plane; 4 or more.", PLANE
    )
    height: str | None = optional(LENGTH, "Of its middle above the plane.", PLANE)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.speed is not None and self.camera is None:
            raise ValueError("--speed needs --camera, the calibrated camera")
        if self.height is not None and not self.on_plane:
            raise ValueError("--height needs --on-plane, the plane that it is above")
        if not (self.camera or self.on_plane):
            raise ValueError(
                "give --camera with --diameter, --radius or --speed; or --on-plane for a plane"
            )
        if self.camera and not (self.radius or self.diameter or self.speed or self.on_plane):
            raise ValueError(
                "--camera needs --radius or --diameter, the true size of the ball, or --speed"
            )


@command(
    "locate out/layer.exr --camera lens.json --diameter 4cm --exposure 1/60",
    "locate out/layer.exr --on-plane 102,300=0,0 --on-plane 540,310=5m,0 "
    "--on-plane 420,180=5m,8m --on-plane 180,178=0,8m --exposure 1/60",
)
def locate(
    layer: Layer,
    space: SpaceOptions,
    reading: Reading,
    exposure: ExposureTime = None,
    image: Path | None = optional("FILE", "With --plate: fit the flight to the picture, in depth."),
    plate: Path | None = optional("FILE|none", "The scene without the object; none: guess."),
    out: Numbers = None,
    as_json: AsJson = False,
) -> None:
    """Locate the object of LAYER in space, by camera or plane.

    Of a clip, track does so in each frame.
    """
    check_file(out, "a motion", *NUMBERS)
    if (image is None) != (plate is None) or (plate and not (space.camera and space.true_radius)):
        raise ValueError("--plate needs --image, --camera and --radius, to fit a flight in space")
    lens = None if space.camera is None else bm.read_intrinsics(space.camera)
    plane = _plane(space.on_plane, lens) if space.on_plane else None
    height = (0.0, 0.0) if space.height is None else meters("--height", space.height)
    speed = None if space.speed is None else meters_per_second("--speed", space.speed)
    time, time_std = _time(exposure)
    solution, motion = _read(layer, reading)
    time = motion.exposure_time if time is None else time
    found: list[Located] = []
    with about(layer), waiting("locating"):
        if lens is not None:
            check_camera(lens, solution.size)
        if lens is not None and space.true_radius is not None:
            radius, std = space.true_radius
            known = lens, radius, time, std, time_std
            if image is None or plate is None:
                found.append(bm.motion.measure_ball(_sweep(solution, "--camera"), *known))
            else:
                picture = reading.read(image)
                scene = reading.behind(picture, plate, "auto", lambda: solution.streak)
                found.append(bm.motion.fit_ball(picture, scene, *known, solution.sweep))
        if lens is not None and speed is not None:
            if time is None:
                raise ValueError(
                    "--speed needs --exposure: the image's file does not state the time"
                )
            path, (value, std) = _sweep(solution, "--speed"), speed
            found.append(bm.motion.depth_from_blur(path, lens, value, time, None, std, time_std))
        if plane is not None:
            path = _sweep(solution, "--on-plane")
            found.append(bm.motion.measure_on_plane(path, plane, time, time_std, *height))
    _answer(solution, motion, [motion, *found], out, as_json)


def _time(text: str | None) -> tuple[float | None, float]:
    """Exposure time, if it was given, and its error, seconds."""
    return (None, 0.0) if text is None else time_of_exposure("--exposure", text)


def _read(
    layer: Path, reading: Reading, picture: Unsolved | None = None
) -> tuple[bm.Solution, bm.motion.Motion]:
    """The solution and its motion; a folder of results holds one, a picture with its plate has one."""
    if picture is not None and picture.plate is not None:
        camera = CameraReading(reading.transfer, reading.max_pixels)
        known = opacity_of(picture.opacity)
        solution = solved_picture_at(layer, picture.plate, picture.region, camera, known)
        with about(layer):
            return solution, bm.measure_motion(solution)
    path = Path(layer_in(str(layer)))
    with about(path):
        try:
            solution = bm.read_solution(path, reading.max_pixels)
        except bm.errors.FileError as error:
            if picture is None or not path.is_file():
                raise
            raise bm.errors.FileError(
                f"{error}. A picture is solved first with --plate FILE, or --plate none --region "
                "X0,Y0,X1,Y1"
            ) from error
        return solution, bm.measure_motion(solution)


def _answer(
    solution: bm.Solution,
    motion: bm.motion.Motion,
    found: Sequence[Any],
    out: Path | None,
    as_json: bool,
) -> None:
    """Print the grade and the results, and write all numbers."""
    words = [words for thing in found for words in bm.explain(thing)]
    graded = grade_lines(solution)
    row = {"grade": str(solution.grade) if graded else None}
    row |= {name: value for thing in found for name, value in thing.numbers().items()}
    words = [f"{line}." for line in graded] + words
    numbers = {**row, **_over_time(motion), "in_words": words}
    if out is not None:
        bm.write(out, row if out.suffix.lower() == ".csv" else numbers)
    answer(as_json, numbers, [words[0], motion, *words[1:]] if graded else [motion, *words])


def _over_time(motion: bm.motion.Motion) -> dict[str, Any]:
    """Place at each exposure fraction, and speed between them."""
    path = motion.trajectory
    return {
        "trajectory": {"t": path.t.tolist(), "xy": path.xy.tolist()},
        "speeds": motion.speeds.tolist(),
        "speeds_std": motion.speeds_std.tolist(),
        "covariance": motion.covariance.tolist(),
    }


def _rotation(solution: bm.Solution, exposed: tuple[float | None, float]) -> bm.motion.Rotation:
    """The rotation from a turning outline of the sweep, otherwise from alpha."""
    sweep = solution.sweep
    turns = sweep is not None and sweep.silhouette.has("turn")
    return bm.motion.measure_rotation(sweep if sweep and turns else solution, None, *exposed)


def _plane(points: Sequence[str], lens: bm.Intrinsics | None) -> bm.motion.Plane:
    pixels, places = [], []
    for text in points:
        found = re.fullmatch(_POINT, text)
        if found is None:
            raise ValueError(f"--on-plane must be like 120,300=0,1.5m, got {text!r}")
        pixels.append((float(found[1]), float(found[2])))
        places.append([meters("--on-plane", part.strip())[0] for part in found.groups()[2:]])
    if len(pixels) < 4:  # which determine a plane
        raise ValueError(f"give --on-plane for 4 points or more, got {len(pixels)}")
    return bm.motion.Plane.from_points(pixels, places, lens)


def _sweep(solution: bm.Solution, name: str) -> bm.sweep.Sweep:
    if solution.sweep is None:
        raise bm.errors.MotionError(f"no shape on a path explains the streak; {name} needs one")
    return solution.sweep

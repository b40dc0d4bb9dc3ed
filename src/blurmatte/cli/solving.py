"""The commands that separate an object from its background: solve and color."""

from __future__ import annotations

import logging
import shlex
import sys
from contextlib import nullcontext, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.clip_solving import ClipOptions, MaybePlate, solve_clip
from blurmatte.cli.console import (
    WITHOUT_HUE,
    Verbosity,
    about,
    answer,
    argument,
    color_numbers,
    grade_lines,
    in_degrees,
    optional,
    output,
    printing,
    say,
    swatches,
    verbosity,
    waiting,
    warn,
)
from blurmatte.cli.paths import ROWS, check_file, check_folder, expanded, given_files, with_folders
from blurmatte.cli.picture_solving import PictureOptions, check_guess, naming_streaks, solved
from blurmatte.cli.quantities import number
from blurmatte.cli.selection import (
    CameraReading,
    KnownOpacity,
    ObjectColor,
    Occluder,
    OutFolder,
    PlateOptions,
    Region,
    Selection,
    check_photographed,
    matching_of,
    opacity_of,
)

if TYPE_CHECKING:
    from blurmatte.cli.picture_rows import Printed


@dataclass(frozen=True)
class SolvingOptions:
    """Where the object is, and how alpha is estimated."""

    region: Region = None
    occluder: Occluder = None
    solver: str = optional(
        "NAME[:VALUE]", "auto, swept, smooth[:F], pixelwise, shaded.", default="auto"
    )
    seconds: float | None = optional("S", "CPU s after which no new shape is tried.")
    opacity: KnownOpacity = None

    @property
    def of_each_picture(self) -> bool:
        """Whether they mean pictures that are solved alone, not a clip."""
        return (self.region, self.occluder, self.solver) != (None, None, "auto")

    @property
    def is_shaded(self) -> bool:
        """Whether the solver is that of objects whose shadow may lie on the plate."""
        return self.solver.partition(":")[0] == "shaded"


@command(
    "solve throw.png --plate empty_room.png -o out/",
    "solve throw.png --plate none --region 90,80,310,230 -o out/",
    "solve rally.mp4 -o out/",
)
def solve(
    images: Annotated[list[str], argument("IMAGE", f"{ROWS.capitalize()}; a clip.")],
    plate: MaybePlate,
    out: OutFolder,
    colors: ObjectColor,
    reading: CameraReading,
    clip: ClipOptions,
    how: SolvingOptions,
    require: str | None = optional("confirmed|plausible", "Exit code 3 if a grade is lower."),
    as_json: AsJson = False,
) -> None:
    """Separate the moving object in each IMAGE from its background.

    Writes layer.exr, overview.png, report.json …; of a clip frames.csv, layers.
    """
    required = _required(require)
    solver, selection = how.solver, Selection(reading, colors, how.region)
    of_clip = clip.means_clip(images, out, next(iter(plate.files), None), how.of_each_picture)
    if plate.is_guessed:
        if of_clip:
            raise ValueError(
                "--plate none guesses the scene behind the object in a picture alone; the plate of a "
                "clip is made from its frames: leave --plate out"
            )
        check_guess(plate.match, how.region, how.is_shaded, reading.transfer)
    if of_clip:
        method = _fitting_shapes(_clip_solver(how, colors), how)
        solve_clip(images, plate, out, selection, clip, how.occluder, method, required, as_json)
        return
    from blurmatte.cli.picture_rows import PictureRow, solve_row  # imports all of the library

    if not plate.files:
        raise _plate_missing(images)
    method = _fitting_shapes(_solver(solver, colors), how)
    check_folder(out)
    pairs = with_folders(expanded(images), out)
    named = *plate.files, how.region, how.occluder, *colors.files, reading.noise, reading.transfer
    files = given_files([], *named, solver.partition(":")[2])
    row = PictureRow(pairs, out, files)
    notes: list[str] = []
    plates: list[bm.LinearImage] = []
    if not plate.is_guessed:
        reading = _with_curve(reading, pairs[0][0], plate.files[0])
        plates = [reading.read(one, notes) for one in plate.files]
        method = _shaded(reading, solver, colors, plates) if how.is_shaded else method
    selection = replace(selection, reading=reading)
    settings = {"selection": repr(selection), "match": plate.match}
    row = replace(row, settings={**settings, "solver": f"{solver} {how.seconds} {how.opacity}"})
    match = matching_of(plate.match)
    task = PictureOptions(plates, notes, selection, how.occluder, method, match)
    work = partial(_solve_in_row, task, verbosity())
    solve_row(row, work, required, clip.workers, as_json)


def _plate_missing(images: list[str]) -> ValueError:
    """The error for pictures without a plate; a shell makes a list of a pattern without quotes."""
    if len(images) > 1:
        return ValueError(
            f"{len(images)} pictures in a list are solved one by one, and need --plate; in quotes, a "
            "pattern means frames of a still camera, of which the plate is made: '*.jpg'; "
            "see blurmatte solve --help"
        )
    return ValueError(
        "a single picture needs --plate, the same scene without the object: photograph it, or take "
        "several pictures from a tripod or a clip, of which it is made (solve 'throws/*.jpg'), or "
        "guess it: --plate none --region X0,Y0,X1,Y1; see blurmatte solve --help"
    )


def _solve_in_row(task: PictureOptions, wanted: Verbosity, path: Path, folder: Path) -> Printed:
    """Solve one image of a row; runs in any process."""
    from blurmatte.cli.picture_rows import refusal, solved_picture

    try:
        here = verbosity() == wanted  # this process: its progress is shown
        with nullcontext() if here else printing(wanted):
            lines, solution = _solve_one(task, path, folder)
    except bm.BlurmatteError as error:
        return refusal(path, error)
    return lines, solved_picture(path, folder, solution)


def _solve_one(task: PictureOptions, path: Path, folder: Path) -> tuple[list[str], bm.Solution]:
    """Solve one image and write its results; what is printed of them."""
    from blurmatte.explain.calibration import parallax_in_words
    from blurmatte.explain.solution import usable_all_the_same

    with about(path) as said:
        pictures, solution = solved(task, path, said)
        C, matched = pictures.image, pictures.plate
        regions = pictures.parallax(solution)
        for sentence in parallax_in_words(regions):
            said.append(f"{path}: {sentence.rstrip('.')}")
            warn(said[-1])
        logging.getLogger("blurmatte").info("writing the results")
        called = shlex.join(["blurmatte", *sys.argv[1:]])
        bm.save_results(folder, C, matched, solution, called, task.notes + said)
        bm.results.save_parallax(folder, C, regions)
    *lines, sheet = [*grade_lines(solution), *_answer_lines(solution, pictures.match, folder)]
    return [*lines, *usable_all_the_same(C, matched, solution), sheet], solution


@command(
    "color throw.png --plate empty_room.png",
    "color throw.png --plate empty_room.png --color 96,70,5 --color-from sharp.png -o ball.json",
)
def color(
    image: Annotated[str, argument("IMAGE", "The picture with the streak.")],
    plate: PlateOptions,
    colors: ObjectColor,
    reading: CameraReading,
    region: Region = None,
    out: Annotated[Path | None, output("Write the color model: .json.")] = None,
    as_json: AsJson = False,
) -> None:
    """Find the color of the moving object, and its error."""
    check_file(out, "a color model", ".json")
    check_photographed(plate.plate, "solve --plate none finds the color and writes model.json")
    path = expanded([image])[0]
    selection = Selection(reading, colors, region)
    reading = _with_curve(reading, path, plate.plate)
    selection = replace(selection, reading=reading)
    B = reading.read(plate.plate)
    with about(path) as said, waiting("finding the color"):
        C = reading.read(path, said)
        B = bm.match_plate(B, C, matching_of(plate.match))
        streak = selection.streak(C, B)
        with naming_streaks(streak, C, B):
            model = selection.model(C, B, streak) or bm.fit_color(C, B, streak)
        if out is not None:
            bm.write(out, model)
    answer(as_json, color_numbers(model), [in_degrees(model), *swatches(model), *bm.explain(model)])


def _with_curve(reading: CameraReading, image: Path, plate: Path) -> CameraReading:
    """The pictures, with the most likely transfer curve for `--transfer auto`."""
    if reading.transfer != "auto":
        return reading
    reading = replace(reading, transfer=None)
    with about(image), waiting("finding the transfer curve"):
        fit = bm.sweep.fit_transfer(reading.read(image), reading.read(plate))
    also = ", ".join(curve.name for curve in fit.possible if curve is not fit.best)
    say(f"transfer: {fit.best.name}" + (f"; as possible: {also}" if also else ""))
    return reading if fit.best is fit.curves[0] else replace(reading, transfer=fit.best.name)


def _solver(text: str, colors: ObjectColor) -> bm.matting.Solver | None:
    """The solver of NAME or NAME:VALUE; None for all hypotheses, or if it needs pictures."""
    name, colon, value = text.partition(":")
    if name not in ("smooth", "shaded") and colon:
        raise ValueError(f"--solver {name} takes no value, got {text!r}")
    match name:
        case "auto":
            return None
        case "shaded":
            if not value and (len(colors.color or ()) != 1 or colors.kinds != {"hex"}):
                raise ValueError(_SHADED)
            return None
        case "swept":
            return bm.Swept()
        case "smooth":
            return bm.Smooth(_smoothness(value)) if colon else bm.Smooth()
        case "pixelwise":
            return bm.Pixelwise()
    raise ValueError(f"--solver must be auto, swept, smooth, pixelwise or shaded, got {text!r}")


def _fitting_shapes(
    method: bm.matting.Solver | None, how: SolvingOptions
) -> bm.matting.Solver | None:
    """The solver with its limit of time, and what is known of the opacity."""
    if how.seconds is None and how.opacity is None:
        return method
    if how.solver not in ("auto", "swept"):
        name = "--opacity is" if how.seconds is None else "--seconds limits the search"
        raise ValueError(f"{name} for shapes of --solver auto and swept, got {how.solver!r}")
    seconds = float("inf") if how.seconds is None else how.seconds
    if not seconds > 0:
        raise ValueError(f"--seconds must be a number above 0, got {seconds:g}")
    kind = bm.matting.Averaged if how.solver == "auto" else bm.Swept
    return kind(seconds=seconds, opacity=opacity_of(how.opacity))


def _clip_solver(how: SolvingOptions, colors: ObjectColor) -> bm.matting.Solver | None:
    """The solver of a clip, which has no plate in shadow."""
    method = _solver(how.solver, colors)
    if not how.is_shaded:
        return method
    if ":" in how.solver:
        raise ValueError(
            "of a clip --solver shaded needs one hex --color, the object's own light, got "
            f"{how.solver!r}: a plate in shadow belongs to one picture, for the shadow moves with the "
            "object"
        )
    return _of_light((colors.color or ("",))[0])


def _smoothness(text: str) -> float:
    with suppress(ValueError):
        if (value := number(text)) > 0:
            return value
    raise ValueError(f"--solver smooth:F must have a number F above 0, got {text!r}")


_SHADED = (
    "--solver shaded needs the plate in shadow, shaded:FILE; or, of pictures that are not camera RAW, "
    "one hex --color that is the object's own light, brightness included"
)


def _shaded(
    reading: CameraReading, solver: str, colors: ObjectColor, plates: list[bm.LinearImage]
) -> bm.matting.Shaded:
    """The solver with a known plate in shadow, or a known light of the object."""
    plate, *more = plates
    if more:
        raise ValueError(f"--solver shaded needs one --plate, got {len(plates)}")
    path = solver.partition(":")[2]
    if path:
        return bm.matting.Shaded(plate=reading.read(Path(path)))
    if plate.meta.to_srgb is not None:
        raise ValueError(_SHADED)
    return _of_light((colors.color or ("",))[0])


def _of_light(text: str) -> bm.matting.Shaded:
    """The solver with the object's light, a hex color."""
    from blurmatte.radiometry import light_of_hex

    bm.ColorModel.from_hex(text)  # refuses what is no color
    ((r, g, b),) = light_of_hex(text).tolist()
    return bm.matting.Shaded(light=(r, g, b))


def _required(name: str | None) -> bm.Grade | None:
    """The lowest accepted grade; None for any."""
    if name not in (None, bm.Grade.CONFIRMED, bm.Grade.PLAUSIBLE):
        raise ValueError(f"--require must be confirmed or plausible, got {name!r}")
    return None if name is None else bm.Grade(name)


def _answer_lines(solution: bm.Solution, match: bm.background.Match, folder: Path) -> list[str]:
    """Alternatives, colors, plate, other streaks, and the sheet."""
    from blurmatte.explain.solution import also_fits, also_moved, left_out

    stats = solution.stats
    color = WITHOUT_HUE if stats.is_gray else in_degrees(solution.model)
    lines = [*also_fits(solution), str(solution), color]
    if match.moves or match.changes_light:
        lines.append(f"plate: {match.in_words}")
    lines += left_out(solution)
    lines += also_moved(stats.other_boxes, stats.insignificant_others)
    return [*lines, str(folder / "overview.png")]

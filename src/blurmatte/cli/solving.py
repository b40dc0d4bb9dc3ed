"""The commands that separate an object from its background: solve and color."""

import math
import shlex
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import blurmatte as bm
from blurmatte.cli.asked import Asked, Task, kind
from blurmatte.cli.inputs import Files, matching_of, places
from blurmatte.cli.options import (
    ColorFrom,
    Colors,
    Image,
    Images,
    Mask,
    MatchName,
    MaxBrightness,
    MaxPixels,
    NoiseFile,
    Occluder,
    Plate,
    Rank,
    Region,
    Require,
    ShadedPlate,
    Smoothness,
    SolverName,
    TransferName,
)  # fmt: skip
from blurmatte.cli.printing import complain, in_degrees, say, swatches
from blurmatte.cli.program import about, app, told, waiting, with_progress
from blurmatte.cli.targets import check_file, check_folder, check_kept

LESSER_GRADE = 3  # exit code: written, but with a lesser grade than --require asks for
_TOLD = 5  # other things that moved


@app.command()
@told
def solve(
    images: Images,
    plate: Plate,
    out: Annotated[Path, typer.Option(help="Folder for the results, made if it is not there.")],
    color: Colors = None,
    color_from: ColorFrom = None,
    rank: Rank = 1,
    region: Region = None,
    mask: Mask = None,
    occluder: Occluder = None,
    transfer: TransferName = None,
    noise: NoiseFile = None,
    max_brightness: MaxBrightness = None,
    solver: SolverName = "auto",
    smoothness: Smoothness = None,
    shaded_plate: ShadedPlate = None,
    match: MatchName = "auto",
    require: Require = None,
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Separate the moving object in each IMAGE from its background.

    Writes alpha.png, color.png, layer.exr, layer.png, model.json, overview.png and report.json into
    the folder; for several images, each into a folder of its own in there.
    """
    required = _required(require)
    check_folder(out)
    inputs = [plate, *filter(None, (color_from, mask, occluder, shaded_plate, noise))]
    for path, folder in places(images, out):
        check_kept([path, *inputs], folder)
    way, matching = _solver(solver, smoothness), matching_of(match)
    asked = Asked(tuple(color or ()), color_from, rank, region, mask, max_brightness)
    files = _settled(_files(transfer, max_pixels, noise), places(images, out)[0][0], plate)
    B, notes = files.read(plate)
    if solver == "shaded":
        way = _shaded(files, shaded_plate, color or [], B)
    elif shaded_plate is not None:
        raise ValueError(f"--shaded-plate is for --solver shaded, the solver is {solver}")
    task = Task(files, asked)
    failed, lesser = 0, 0
    for path, folder in with_progress(places(images, out)):
        try:
            with about(path) as said:
                C, _ = files.read(path, said)
                found = bm.fit_match(C, B, matching)
                matched = found.apply(B)
                streak = task.streak(C, matched)
                hidden = None if occluder is None else task.hidden(occluder, C)
                with _telling_where(streak, C, matched):
                    solution = bm.solve(
                        C,
                        matched,
                        task.model(C, matched, streak),
                        _beside(way, found),
                        streak=streak,
                        matching=bm.Matching.NONE,
                        occluder=hidden,
                    )
                solution = _with_match(solution, found)
                said += _doubted(path, solution)
                said += _curve_doubted(path, C, matched, solution, files)
                called = shlex.join(["blurmatte", *sys.argv[1:]])
                bm.save_results(folder, C, matched, solution, called, notes + said)
        except bm.BlurmatteError as error:
            complain(str(error))
            failed += 1
        else:
            _say_answer(solution, found, folder)
            lesser += _is_lesser(path, solution, required)
    if failed or lesser:
        raise typer.Exit(2 if failed else LESSER_GRADE)


@app.command()
@told
def color(
    image: Image,
    plate: Plate,
    out: Annotated[Path | None, typer.Option(help="Where to write the model: a .json.")] = None,
    color: Colors = None,
    color_from: ColorFrom = None,
    rank: Rank = 1,
    region: Region = None,
    mask: Mask = None,
    transfer: TransferName = None,
    noise: NoiseFile = None,
    max_brightness: MaxBrightness = None,
    match: MatchName = "auto",
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Find the color of the moving object, and say how sure that is."""
    check_file(out, "a color model", ".json")
    asked = Asked(tuple(color or ()), color_from, rank, region, mask, max_brightness)
    files = _settled(_files(transfer, max_pixels, noise), image, plate)
    B, _ = files.read(plate)
    task = Task(files, asked)
    with about(image) as said:
        C, _ = files.read(image, said)
        B = bm.match_plate(B, C, matching_of(match))
        streak = task.streak(C, B)
        with _telling_where(streak, C, B), waiting("finding its color"):
            model = task.model(C, B, streak) or bm.fit_color(C, B, streak)
        if out is not None:
            bm.write(out, model)
    say("\n".join([in_degrees(model), *swatches(model), *bm.explain(model)]))


def _files(transfer: str | None, max_pixels: int, noise: Path | None) -> Files:
    return Files(transfer, max_pixels, None if noise is None else bm.read_noise(noise))


def _settled(files: Files, image: Path, plate: Path) -> Files:
    """With the curve that the streak allows, if that is asked for."""
    if files.transfer != "auto":
        return files
    files = replace(files, transfer=None)
    with about(image), waiting("finding its curve"):
        fit = bm.fit_transfer(files.read(image)[0], files.read(plate)[0])
    also = ", ".join(curve.name for curve in fit.possible if curve is not fit.best)
    say(f"transfer: {fit.best.name}" + (f"; as possible: {also}" if also else ""))
    return files if fit.best is fit.curves[0] else replace(files, transfer=fit.best.name)


Solver = bm.Pixelwise | bm.Smooth | bm.Swept | bm.Shaded


def _shaded(
    files: Files, shaded_plate: Path | None, colors: list[str], plate: bm.LinearImage
) -> bm.Shaded:
    """The solver that knows the plate in shadow, or the object's own light."""
    if shaded_plate is not None:
        return bm.Shaded(plate=files.read(shaded_plate)[0])
    if len(colors) != 1 or kind(colors[0]) != "hex" or plate.meta.to_srgb is not None:
        raise ValueError(
            "--solver shaded needs --shaded-plate FILE; or, of pictures that are not camera RAW, one "
            "hex --color that is the object's own light, brightness included"
        )
    bm.ColorModel.from_hex(colors[0])  # refuses what is no color
    codes = np.array(list(bytes.fromhex(colors[0].removeprefix("#"))))
    r, g, b = bm.SRGB.decode(codes / 255)
    return bm.Shaded(light=(float(r), float(g), float(b)))


def _beside(way: Solver | None, match: bm.Match) -> Solver | None:
    """The solver, its plate in shadow matched like the other plate."""
    if isinstance(way, bm.Shaded) and way.plate is not None:
        return replace(way, plate=match.apply(way.plate))
    return way


def _solver(name: str, smoothness: float | None) -> Solver | None:
    """The solver of a name; None: what suits, or is known later."""
    if smoothness is not None and name != "smooth":
        raise ValueError(f"--smoothness is for --solver smooth, the solver is {name}")
    if smoothness is not None and not (math.isfinite(smoothness) and smoothness > 0):
        raise ValueError(f"--smoothness must be above 0, got {smoothness:g}")
    match name:
        case "auto" | "shaded":
            return None
        case "swept":
            return bm.Swept()
        case "smooth":
            return bm.Smooth() if smoothness is None else bm.Smooth(smoothness)
        case "pixelwise":
            return bm.Pixelwise()
    raise ValueError(f"--solver must be auto, swept, smooth, pixelwise or shaded, got {name!r}")


def _required(name: str | None) -> bm.Grade | None:
    """The least grade of a name; None: any will do."""
    if name not in (None, bm.Grade.CONFIRMED, bm.Grade.PLAUSIBLE):
        raise ValueError(f"--require must be confirmed or plausible, got {name!r}")
    return None if name is None else bm.Grade(name)


def _is_lesser(path: Path, solution: bm.Solution, required: bm.Grade | None) -> bool:
    """Whether a solution has a lesser grade than required, or none; complains if so."""
    grades = list(bm.Grade)  # the best first
    if required is None or grades.index(solution.grade) <= grades.index(required):
        return False
    grade = f"its grade is {solution.grade}" if "grade" in solution.stats else "it has no grade"
    complain(f"{path}: {grade}, --require asks for {required}; its files were written")
    return True


def _with_match(solution: bm.Solution, match: bm.Match) -> bm.Solution:
    """The solution of a matched plate, with what was done to the plate before."""
    agreed = {k: solution.stats["match"][k] for k in ("agreement", "edge_agreement")}
    return replace(solution, stats={**solution.stats, "match": {**match.facts, **agreed}})


@contextmanager
def _telling_where(
    streak: bm.Streak | None, image: bm.LinearImage, plate: bm.LinearImage
) -> Iterator[None]:
    """Add to a refusal what moved, if nobody chose one."""
    try:
        yield
    except (bm.ColorModelError, bm.MotionError) as error:
        found = [] if streak is not None else bm.find_streaks(image, plate)
        if not found:
            raise
        first, *others = (",".join(map(str, one.box)) for one in found)
        more = f"; also moved, choose with --region: {_some(others)}" if others else ""
        where = f"The strongest is the streak in {first} (X0,Y0,X1,Y1){more}"
        raise type(error)(f"{error}. {where}") from error


def _some(boxes: list[str]) -> str:
    more = f" and {len(boxes) - _TOLD} more" if len(boxes) > _TOLD else ""
    return " ".join(boxes[:_TOLD]) + more


def _doubted(path: Path, solution: bm.Solution) -> list[str]:
    """Warn of what cannot be true in a solution; returns the warnings."""
    from blurmatte.explain import doubts

    lines = [f"{path}: {doubt.rstrip('.')}" for doubt in doubts(solution)]
    for line in lines:
        complain(f"warning: {line}")
    return lines


def _curve_doubted(
    path: Path, image: bm.LinearImage, plate: bm.LinearImage, solution: bm.Solution, files: Files
) -> list[str]:
    """Warn if another curve lets a disc of one color explain what is not one now."""
    curves = image.meta.transfer, plate.meta.transfer
    alike = None not in curves and len({curve.name for curve in curves if curve}) == 1
    if _is_explained_by_disc(solution) or files.transfer is not None or not alike:
        return []
    fit = bm.fit_transfer(image, plate, bm.Streak(solution.streak))
    if fit.best is fit.curves[0]:
        return []
    line = (
        f"{path}: light looks bent: with --transfer {fit.best.name} a disc of one color explains "
        f"the streak, with {fit.curves[0].name} none does"
    )
    complain(f"warning: {line}")
    return [line]


def _is_explained_by_disc(solution: bm.Solution) -> bool:
    """Whether a disc of one color explains the streak."""
    sweep = solution.sweep
    if sweep is None or sweep.rejection:
        return False
    return sweep.silhouette.name == "disc" and sweep.model.rank == 1


def _say_answer(solution: bm.Solution, match: bm.Match, folder: Path) -> None:
    """The grade and what it means, the colors, the plate, what else moved, and the sheet."""
    from blurmatte.explain import also_fits, grade_in_words

    graded = *grade_in_words(solution), *also_fits(solution)
    lines = [*graded, str(solution), in_degrees(solution.model)]
    if match.moves or match.changes_light:
        lines.append(f"plate: {match.in_words}")
    say("\n".join([*lines, *_others(solution), str(folder / "overview.png")]))


def _others(solution: bm.Solution) -> Iterator[str]:
    """What else moved, as regions to copy."""
    boxes = [",".join(map(str, box)) for box in solution.stats.get("other_boxes", ())]
    if boxes:
        yield f"also moved, choose with --region: {_some(boxes)}"

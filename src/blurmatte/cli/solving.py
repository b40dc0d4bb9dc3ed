"""The commands that separate an object from its background: solve and color."""

import shlex
import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

import blurmatte as bm
from blurmatte.cli.inputs import Files, box_of, matching_of, numbers, places
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
    ShadedPlate,
    Smoothness,
    SolverName,
    TransferName,
)  # fmt: skip
from blurmatte.cli.printing import by, complain, in_degrees, say, swatches
from blurmatte.cli.program import about, app, told, with_progress
from blurmatte.cli.targets import check_file, check_folder

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
    max_pixels: MaxPixels = bm.MAX_PIXELS,
) -> None:
    """Separate the moving object in each IMAGE from its background.

    Writes alpha.png, color.png, layer.exr, layer.png, model.json, overview.png and report.json into
    the folder; for several images, each into a folder of its own in there.
    """
    check_folder(out)
    way, matching = _solver(solver, smoothness), matching_of(match)
    files = _settled(_files(transfer, max_pixels, noise), places(images, out)[0][0], plate)
    B, notes = files.read(plate)
    if solver == "shaded":
        way = _shaded(files, shaded_plate, color or [], B)
    elif shaded_plate is not None:
        raise ValueError(f"--shaded-plate is for --solver shaded, the solver is {solver}")
    task = _Task(files, tuple(color or ()), color_from, rank, region, mask, max_brightness)
    failed = 0
    for path, folder in with_progress(places(images, out)):
        try:
            with about(path) as said:
                C, _ = files.read(path, said)
                found = bm.fit_match(C, B, matching)
                matched = found.apply(B)
                streak = task.streak(C, matched)
                model = task.model(C, matched, streak)
                hidden = None if occluder is None else task.white("occluder", occluder, C)
                solution = bm.solve(
                    C,
                    matched,
                    model,
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
            changed = found.moves or found.changes_light
            plate_said = [f"plate: {found.in_words}"] if changed else []
            lines = [str(solution), in_degrees(solution.model), *plate_said, *_others(solution)]
            say("\n".join(lines))
            say(str(folder / "overview.png"))
    if failed:
        raise typer.Exit(2)


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
    files = _settled(_files(transfer, max_pixels, noise), image, plate)
    B, _ = files.read(plate)
    task = _Task(files, tuple(color or ()), color_from, rank, region, mask, max_brightness)
    with about(image) as said:
        C, _ = files.read(image, said)
        B = bm.match_plate(B, C, matching_of(match))
        streak = task.streak(C, B)
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
    with about(image):
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
    if len(colors) != 1 or _kind(colors[0]) != "hex" or plate.meta.to_srgb is not None:
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


def _with_match(solution: bm.Solution, match: bm.Match) -> bm.Solution:
    """The solution of a matched plate, with what was done to the plate before."""
    agreed = {k: solution.stats["match"][k] for k in ("agreement", "edge_agreement")}
    return replace(solution, stats={**solution.stats, "match": {**match.facts, **agreed}})


@dataclass(frozen=True)
class _Task:
    """What the options of `solve` and `color` ask for."""

    files: Files
    colors: tuple[str, ...]
    color_from: Path | None
    rank: int
    region: str | None
    mask: Path | None
    max_brightness: float | None

    def streak(self, image: bm.LinearImage, plate: bm.LinearImage) -> bm.Streak | None:
        """Where to look; None: wherever something moved."""
        if self.region is not None and self.mask is not None:
            raise ValueError("give --region or --mask, not both")
        if self.region is not None:
            inside = bm.Streak.from_box(box_of(self.region), image.size)
            return bm.find_streak_within(inside, image, plate)
        if self.mask is None:
            return None
        return bm.Streak(self.white("mask", self.mask, image))

    def white(self, name: str, path: Path, image: bm.LinearImage) -> Any:
        """(H, W) bool: where a picture of the image's size is more than half white."""
        picture = bm.read(path, bm.LINEAR, self.files.max_pixels)
        if picture.size != image.size:
            raise ValueError(
                f"the {name} {path} is {by(picture.size)} pixels, the image {by(image.size)}"
            )
        return np.asarray(picture.rgb.max(axis=-1) > 0.5)

    def model(
        self, image: bm.LinearImage, plate: bm.LinearImage, streak: bm.Streak | None
    ) -> bm.ColorModel | None:
        """The model that the colors make; None: the streak itself must tell."""
        if self.rank not in (1, 2, 3):
            raise ValueError(f"--rank must be 1, 2 or 3, got {self.rank}")
        kinds = {_kind(color) for color in self.colors}
        if self.color_from is not None and "point" not in kinds:
            raise ValueError("--color-from needs points to pick: add --color X,Y")
        if not kinds:
            return self._fitted(image, plate, streak)
        if self.rank == 3:
            raise ValueError("--rank 3 is for objects of any colors: leave --color out")
        if len(kinds & {"hex", "file"}) and len(kinds) > 1:
            raise ValueError("give hex colors, or a model file, or points and core: not a mixture")
        if kinds == {"file"}:
            return self._from_file(image)
        if kinds == {"hex"}:
            if len(self.colors) != self.rank:
                raise ValueError(
                    f"--rank {self.rank} takes {self.rank} hex color{'s' * (self.rank - 1)}, got "
                    f"{len(self.colors)}: one color is --rank 1, two colors are --rank 2"
                )
            return bm.ColorModel.from_hex(*self.colors, to_srgb=image.meta.to_srgb)
        samples = np.concatenate([self._samples(c, image, plate, streak) for c in self.colors])
        model = bm.ColorModel.from_samples(samples, self.rank, robust="core" in kinds)
        return replace(model, to_srgb=image.meta.to_srgb)

    def _fitted(
        self, image: bm.LinearImage, plate: bm.LinearImage, streak: bm.Streak | None
    ) -> bm.ColorModel | None:
        if self.rank == 3:
            return bm.ColorModel.any()
        if self.rank != 1:
            raise ValueError("--rank 2 needs colors: give two with --color, hex or points")
        if self.max_brightness is None:
            return None
        return bm.fit_color(image, plate, streak, self.max_brightness)

    def _from_file(self, image: bm.LinearImage) -> bm.ColorModel:
        if len(self.colors) > 1:
            raise ValueError("give one model file, not several")
        model = bm.read_color_model(self.colors[0])
        if (model.to_srgb is None) != (image.meta.to_srgb is None):
            raise bm.ColorModelError(
                f"{self.colors[0]} was found in a picture of another kind: a camera RAW has the "
                "camera's own colors; find the color in a picture like IMAGE"
            )
        return model

    def _samples(
        self, color: str, image: bm.LinearImage, plate: bm.LinearImage, streak: bm.Streak | None
    ) -> Any:
        from blurmatte.radiometry import check_same_colors

        if color == "core":
            return bm.core_colors(image, plate, streak)
        x, y, *radius = numbers("--color", color, "x,y", "x,y,radius")
        if self.color_from is None:
            return bm.pick_colors(image, x, y, *radius)
        sharp = self.files.read(self.color_from)[0]
        check_same_colors("the image", image, "the picture of --color-from", sharp)
        return bm.pick_colors(sharp, x, y, *radius)


def _kind(color: str) -> str:
    if color == "core":
        return "core"
    if color.lower().endswith(".json"):
        return "file"
    return "point" if "," in color else "hex"


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
    disc = solution.stats.get("sweep", {}).get("silhouette") == "disc" and solution.model.rank == 1
    curves = image.meta.transfer, plate.meta.transfer
    alike = None not in curves and len({curve.name for curve in curves if curve}) == 1
    if disc or files.transfer is not None or not alike:
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


def _others(solution: bm.Solution) -> Iterator[str]:
    """What else moved, as regions to copy."""
    boxes = [",".join(map(str, box)) for box in solution.stats.get("other_boxes", ())]
    if boxes:
        more = f" and {len(boxes) - _TOLD} more" if len(boxes) > _TOLD else ""
        yield f"also moved, choose with --region: {' '.join(boxes[:_TOLD])}{more}"

"""The commands that make other pictures of layers: stack, paints and sharpen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Annotated, Any, Literal

import blurmatte as bm
from blurmatte.cli.app import AsJson, command
from blurmatte.cli.console import (
    about,
    answer,
    argument,
    grade_lines,
    option,
    optional,
    say,
    switch,
    waiting,
    with_progress,
)
from blurmatte.cli.paths import (
    CLIPS,
    CLIPS_OF_LAYERS,
    PICTURE,
    ROWS,
    SHEET,
    STILL,
    check_ending,
    check_file,
    check_folder,
    check_outputs,
    expanded,
    layer_in,
)
from blurmatte.cli.selection import GUESSED, PICTURES, Layer, Out, OutFolder, Reading, SourceFiles
from blurmatte.formats import MAX_PIXELS

_OVER_PLATE = tuple(name for name in CLIPS if name not in CLIPS_OF_LAYERS)  # have no alpha
_SPINS = "none", "auto", "measure"


@command(
    "stack 'out/*/layer.exr' --over empty_room.png -o path.png",
    "stack layers/ball.mov -o path.exr",
)
def stack(
    layers: Annotated[list[str], argument("LAYER", f"Layers in their order, or a .mov: {ROWS}.")],
    out: Out,
    reading: Reading,
    over: Path | None = optional("FILE", "The picture behind all of them, usually the plate."),
    long: bool = switch("--long", "As one exposure as long as all together."),
) -> None:
    """Stack layers into one: the path of an object through a clip.

    Only one of them is in memory at a time.
    """
    if over is not None:
        check_file(out, "a picture", *PICTURE)
    with about(Path(layers[0])):
        source = layers[0] if len(layers) == 1 else layers
        row = bm.read_layers(source, max_pixels=reading.max_pixels)
        watched = with_progress(row, "stacking")
        whole = bm.compositing.long_exposure(watched) if long else bm.compositing.stack(watched)
    result: bm.Layer | bm.LinearImage = whole
    if over is not None:
        picture = reading.read(over)
        with about(over):
            result = whole.over(picture)
    with about(out):
        bm.write(out, result)
    say(str(out))


@command('paints out/layer.exr --color "#d02020" --color "#2040d0" -o paints/')
def paints(
    layer: Layer,
    color: Annotated[list[str], option("HEX", "The color of a paint; repeat for each.")],
    out: OutFolder,
    max_pixels: int = optional("N", "Refuse larger pictures; 200 million.", default=MAX_PIXELS),
    as_json: AsJson = False,
) -> None:
    """Map how long each paint of an object was at each pixel.

    Writes paint1.png, paint1_std.png, … and overview.png into the folder.
    """
    from blurmatte.results import RESULT_FILES, exposure_files

    check_folder(out)
    results = [layer.parent / name for name in RESULT_FILES]  # its sheet has the name of ours
    check_outputs(*exposure_files(out, len(color)), inputs=filter(Path.exists, results))
    with about(layer), waiting("separating the paints"):
        solution = bm.read_solution(layer, max_pixels)
        exposures = bm.compositing.split_exposure(solution, *color)
        written = bm.results.save_exposures(out, solution.layer, exposures)
    sums = exposures.fraction.sum(axis=(0, 1), dtype=float)
    areas = list(zip(color, sums, strict=True))
    graded = grade_lines(solution)
    lines = [*graded, *(f"{name}: {total:.6g} pixels times exposure" for name, total in areas)]
    numbers: dict[str, Any] = {"grade": str(solution.grade) if graded else None}
    numbers |= {"pixels_times_exposure": dict(areas), "files": written}
    answer(as_json, numbers, [*lines, *written])


@dataclass(frozen=True)
class BlurredPictures(SourceFiles):
    """The pictures that a layer is from; with them the path is refined."""

    spin: str = optional(
        "MODE", "Of a ball: none; measure; auto, used if it is likelier.", PICTURES, default="none"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.spin not in _SPINS:
            raise ValueError(f"--spin must be {', '.join(_SPINS)}, got {self.spin!r}")
        if self.spin != "none" and self.image is None:
            raise ValueError(
                "--spin needs --image and --plate, the pictures with the ball and without"
            )
        if self.image is None and self.plate == GUESSED:
            raise ValueError("--plate none needs --image, from which the scene is guessed")
        if self.image is not None and self.plate is None:
            raise ValueError("--image needs --plate, the scene without the object")


@command(
    "sharpen out/layer.exr --frames 8 -o ball.mov",
    "sharpen out/layer.exr --image throw.jpg --plate empty_room.jpg --frames 8 -o ball.mp4",
    "sharpen out/layer.exr --image throw.jpg --plate empty_room.jpg --spin auto --frames 8 -o ball.mov",
    "sharpen 'out/*/layer.exr' --frames 4 -o slow.mov",
)
def sharpen(
    layer: Annotated[str, argument("LAYER", f"The layer.exr of solve, or several: {ROWS}.")],
    pictures: BlurredPictures,
    reading: Reading,
    out: Out,
    frames: int = optional("N", "Moments of each exposure, equally spaced.", default=1),
    rate: float = optional("FPS", "Frames per second of a clip.", default=8.0),
    sheet: Path | None = optional("FILE", "A sheet: before, after, and the error."),
    as_json: AsJson = False,
) -> None:
    """Show an object sharp, as it was at moments of the exposure.

    Of one moment, the middle, a layer is written; of several, or of several layers in their order, a
    clip or a row of layers. A clip without alpha (.mp4, .gif, .webp) shows them over --plate.
    """
    if frames < 1:
        raise ValueError(f"--frames must be 1 or more, got {frames}")
    check_file(sheet, "a sheet", *SHEET)
    files = expanded([layer_in(layer)])
    if len(files) > 1 and (sheet is not None or pictures.image is not None):
        raise ValueError(f"--image and --sheet are for one layer; {layer} are {len(files)}")
    single = frames * len(files) == 1
    check_ending(out, "a sharp object", *(STILL if single else (*STILL, *CLIPS)))
    if single or out.suffix.lower() in CLIPS:
        check_file(out, "a sharp object", out.suffix.lower())
    if out.suffix.lower() in _OVER_PLATE and pictures.plate is None:
        raise ValueError(f"{out.suffix} has no alpha: add --plate, or write .mov or .exr")
    answers: list[tuple[dict[str, Any], list[str]]] = []
    with waiting("sharpening"):
        image, plate = _read(pictures, reading, files[0])
        sharps = _sharpened(files, image, plate, reading, sheet, pictures.spin)
        _write(out, _moments(sharps, frames, image, answers), plate, rate)
    numbers, lines = [one for one, _ in answers], [line for _, said in answers for line in said]
    if image is None:
        lines.append("the path was not refined: that needs --image and --plate")
    lines.append(str(out))
    answer(as_json, numbers[0] if len(numbers) == 1 else {"layers": numbers}, lines)


def _read(
    pictures: BlurredPictures, reading: Reading, layer: Path
) -> tuple[bm.LinearImage | None, bm.LinearImage | None]:
    """Image and plate, matched, where they are given."""
    if pictures.plate is None:
        return None, None
    if pictures.image is None:
        return None, reading.read(pictures.plate)
    image = reading.read(pictures.image)
    with about(layer):
        return image, reading.behind(
            image,
            pictures.plate,
            pictures.match,
            lambda: bm.read_solution(layer, reading.max_pixels).streak,
        )


def _sharpened(
    files: Sequence[Path],
    image: bm.LinearImage | None,
    plate: bm.LinearImage | None,
    reading: Reading,
    sheet: Path | None,
    spin: str,
) -> Iterator[tuple[list[str], bm.deblurring.Sharp]]:
    """Grade and sharp object of each layer; only one of them is in memory at a time."""
    for file in files:
        with about(file):
            solution = bm.read_solution(file, reading.max_pixels)
            if image is None or plate is None or solution.sweep is None:
                sharp = bm.deblurring.deblur_solution(solution)  # refuses if there is no path
            else:
                found: bm.deblurring.Spin | Literal["auto"] | None = None
                if spin == "auto":
                    found = "auto"
                elif spin == "measure":
                    found = bm.deblurring.fit_spin(image, plate, solution.sweep)
                sharp = bm.deblur(image, plate, solution.sweep, spin=found)
        if sheet is not None:
            with about(sheet):
                bm.write(sheet, bm.figures.draw_sharp(sharp, solution.layer, image is not None))
        yield grade_lines(solution), sharp


def _moments(
    sharps: Iterator[tuple[list[str], bm.deblurring.Sharp]],
    frames: int,
    image: bm.LinearImage | None,
    answers: list[tuple[dict[str, Any], list[str]]],
) -> Iterator[bm.Layer]:
    """The moments of all objects in order; numbers and lines about each are added to the answers."""
    for graded, sharp in sharps:
        answers.append(_answer_of(sharp, graded[:1], frames, image))
        yield from sharp.subframes(frames)


def _answer_of(
    sharp: bm.deblurring.Sharp, graded: list[str], frames: int, image: bm.LinearImage | None
) -> tuple[dict[str, Any], list[str]]:
    """Numbers and lines about an object; graded: the line about its grade, if it has one."""
    from blurmatte.explain.motion import sharp_in_words, spin_in_words

    misfit = None if image is None else sharp.misfit  # the noise of a layer is not known
    std, length = float((sharp.node_std**2).mean() ** 0.5), sharp.sweeps[0].length
    numbers: dict[str, Any] = {
        "grade": graded[0] if graded else None,
        "frames": frames,
        "color_std": std,
        "misfit": misfit,
        "path_length_px": length,
    }
    lines = [*graded, sharp_in_words(frames, std, length, misfit)]
    if sharp.spin is not None:
        time = None if image is None else image.meta.exposure_time
        numbers["spin"] = _numbers_of(sharp.spin, time)
        lines.append(spin_in_words(sharp.spin, time))
    return numbers, lines


def _numbers_of(spin: bm.deblurring.Spin, exposure_time: float | None) -> dict[str, Any]:
    """For a machine; revolutions per second are None if the exposure time is unknown."""
    rates = spin.rate_deg, spin.rate_std_deg
    return {
        "axis": spin.axis.tolist(),
        "axis_std_deg": spin.axis_std_deg,
        "rate_deg_per_exposure": spin.rate_deg,
        "rate_std_deg_per_exposure": spin.rate_std_deg,
        "log_evidence_margin": spin.log_evidence_margin,
        "ambiguity": spin.ambiguity,
        "revolutions_per_second": exposure_time and [rate / 360 / exposure_time for rate in rates],
    }


def _write(
    out: Path, layers: Iterator[bm.Layer], plate: bm.LinearImage | None, rate: float
) -> None:
    """Write moments: alone, as a row or a clip, or over the plate."""
    shown: Any = layers
    if out.suffix.lower() in _OVER_PLATE and plate is not None:
        shown = (one.over(plate) for one in shown)
    first = next(shown)
    second = next(shown, None)
    with about(out):
        if second is None:
            bm.write(out, first)
        else:
            bm.write_frames(out, chain([first, second], shown), rate)

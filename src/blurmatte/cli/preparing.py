"""The commands that prepare: plate, and calibrate of noise and response."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated

import blurmatte as bm
from blurmatte.cli.app import AsJson, calibrate, command
from blurmatte.cli.console import (
    about,
    answer,
    argument,
    by,
    option,
    optional,
    output,
    waiting,
    with_progress,
)
from blurmatte.cli.paths import (
    PICTURE,
    ROWS,
    check_ending,
    check_file,
    check_folder,
    check_outputs,
    check_plot,
    expanded,
)
from blurmatte.cli.quantities import box, frame_range, number
from blurmatte.cli.selection import Clip, FrameRange, Out, Reading
from blurmatte.formats import MAX_PIXELS

Pictures = Annotated[list[str], argument("PICTURE", f"Of one still scene: {ROWS}.")]
Plot = Annotated[Path | None, option("FILE", "Draw what was measured: .png or .jpg.")]


@command(
    "calibrate noise 'still/*.png' -o camera.json",
    "calibrate noise throw.png --plate empty_room.png -o camera.json",
    group=calibrate,
)
def noise(
    pictures: Pictures,
    reading: Reading,
    out: Annotated[Path | None, output("Write the noise: .json.")] = None,
    region: str | None = optional("X0,Y0,X1,Y1", "Look only there; of one picture, an even part."),
    plate: Path | None = optional("FILE", "For one picture: the scene without the object."),
    plot: Plot = None,
    as_json: AsJson = False,
) -> None:
    """Measure the gain and the read noise of a camera, and how its noise is correlated."""
    check_file(out, "noise", ".json")
    check_plot(plot)
    paths = expanded(pictures)
    with about(paths[0]), waiting("measuring the noise"):
        fit = _measured(paths, plate, region, reading)
    if plot is not None:
        bm.write(plot, bm.figures.draw_noise(fit))
    if out is not None:
        bm.write(out, fit)
    words, parts = bm.explain(fit), ("gain", "read_std", "relative_std")
    errors = {f"{name}_std": getattr(fit, f"{name}_std") for name in parts}
    sensor = {**{name: getattr(fit.sensor, name) for name in parts}, **errors}
    numbers = {"sensor": sensor, "changed": fit.changed, "in_words": words}
    answer(as_json, numbers, [fit, *words])


@command(
    "calibrate response 'bracket/*.jpg' -o mycam.json",
    "calibrate response a.png b.png c.png --exposures 1/60,1/15,0.25 -o mycam.json",
    group=calibrate,
)
def response(
    pictures: Pictures,
    out: Annotated[Path | None, output("Write the curve: .json.")] = None,
    exposures: str | None = optional("T,T,…", "Exposure times, 1/60 or 0.5; else the files'."),
    plot: Plot = None,
    max_pixels: int = optional("N", "Refuse larger pictures; 200 million.", default=MAX_PIXELS),
    as_json: AsJson = False,
) -> None:
    """Measure the curve of a camera from pictures of a still scene with different exposures."""
    check_file(out, "a curve", ".json")
    check_plot(plot)
    reading = Reading("linear", max_pixels)
    paths = expanded(pictures)
    times = None if exposures is None else _seconds(exposures)
    with waiting("measuring the curve"):
        fit = bm.calibration.fit_response([reading.read(path) for path in paths], times)
    if out is not None:
        fit = replace(fit, transfer=replace(fit.transfer, name=out.stem))
    if plot is not None:
        with about(plot):
            bm.write(plot, bm.figures.draw_response(fit))
    if out is not None:
        bm.write(out, fit)
    words = bm.explain(fit)
    seen = {"exposure_times": fit.exposure_times, "agreement": fit.agreement}
    answer(as_json, {**seen, "std": fit.std.max(), "in_words": words}, [fit, *words])


def _measured(
    paths: list[Path], plate: Path | None, region: str | None, reading: Reading
) -> bm.calibration.NoiseFit:
    if plate is not None and len(paths) > 1:
        raise ValueError(f"--plate is for one picture, got {len(paths)}; frames need none")
    guessed: list[str] = []
    first = reading.read(paths[0], guessed)
    if guessed and first.meta.transfer is not None:  # one warning will do
        reading = replace(reading, transfer=first.meta.transfer.name)
    inside = None
    if region is not None:
        inside = bm.streaks.Streak.from_box(box("--region", region), first.size).mask
    if plate is not None:
        return bm.calibration.measure_noise_against(first, reading.read(plate), inside)
    if len(paths) > 1:
        others = (reading.read(path) for path in paths[1:])
        return bm.calibration.measure_noise(chain([first], others), inside)
    if inside is None:
        raise ValueError(
            "give several frames of a still scene, or --plate, or an even part with --region: one "
            "picture does not separate noise from scene"
        )
    return bm.calibration.measure_noise_within(first, inside)


def _seconds(text: str) -> list[float]:
    """Numbers with commas between them, each whole, decimal or a fraction."""
    try:
        return [number(part) for part in text.split(",")]
    except ValueError:
        raise ValueError(f"--exposures must be seconds like 1/60,1/15,0.5, got {text!r}") from None


@command(
    "plate rally.mp4 -o plate.exr",
    "plate rally.mp4 -o plate.exr --frames 12.5s:30s:2",
)
def plate(
    source: Clip,
    out: Out,
    reading: Reading,
    frames: FrameRange = None,
    as_json: AsJson = False,
) -> None:
    """Make a plate from CLIP: the scene without moving objects.

    As .exr it keeps its error. A sheet to look at is written next to it, as NAME_overview.png.
    """
    from blurmatte.results import plate_files

    frame_range("--frames", frames)
    reading.curve  # noqa: B018  # refuses an unknown name
    check_ending(out, "a plate", *PICTURE)
    check_folder(out.parent)
    check_outputs(*plate_files(out))
    with about(Path(source[0])):
        fit = bm.make_plate(_watched(reading.frames(source, frames)))
    with about(out):
        written = bm.results.save_plate(out, fit)
    words, count, size = bm.explain(fit), len(fit.gain), fit.plate.size
    numbers = {"frames": count, "size": size, "in_words": words, "files": written}
    answer(as_json, numbers, [f"plate of {count} frames, {by(size)}", *words, *written])


def _watched(frames: bm.Frames[bm.LinearImage]) -> bm.Frames[bm.LinearImage]:
    """The same frames, with a progress bar for each pass."""
    if not sys.stderr.isatty():
        return frames

    def load(numbers: range) -> Iterator[bm.LinearImage]:
        """Frames of these numbers, with a progress bar."""
        yield from with_progress(frames.load(numbers), "reading", len(numbers))

    return replace(frames, load=load)

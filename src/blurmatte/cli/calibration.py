"""The commands that measure a camera: calibrate noise and calibrate response."""

from __future__ import annotations

from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Annotated

import blurmatte as bm
from blurmatte.cli.app import AsJson, calibrate, command
from blurmatte.cli.console import about, answer, argument, option, output, waiting
from blurmatte.cli.paths import ROWS, check_file, check_plot, expanded
from blurmatte.cli.quantities import box, number
from blurmatte.cli.selection import Reading
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
    region: Annotated[
        str | None, option("X0,Y0,X1,Y1", "Look only there; of one picture, an even part.")
    ] = None,
    plate: Annotated[
        Path | None, option("FILE", "For one picture: the scene without the object.")
    ] = None,
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
    exposures: Annotated[
        str | None, option("T,T,…", "Exposure times, 1/60 or 0.5; else the files'.")
    ] = None,
    plot: Plot = None,
    max_pixels: Annotated[int, option("N", "Refuse larger pictures; 200 million.")] = MAX_PIXELS,
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

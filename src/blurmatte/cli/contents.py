"""What a file holds, in lines and as values: a picture, clip, layer, solution, model, noise, curve."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import blurmatte as bm
from blurmatte.checks import Floats
from blurmatte.cli.console import by, color_numbers, in_degrees, waiting
from blurmatte.cli.selection import Reading
from blurmatte.explain.clip import times_in_words
from blurmatte.files.documents import DocumentError, json_kind, read_document, read_json
from blurmatte.files.errors import format_of
from blurmatte.files.models import MODEL, noise_to_mapping
from blurmatte.files.raster import load
from blurmatte.files.solutions import stats_to_mapping
from blurmatte.formats import EXR, Holds, format_at
from blurmatte.motion.clip.steps import shots_of

_MAX_LISTED = 8  # numbers of a row that are printed; a box has 4

Description = tuple[Iterable[str], dict[str, Any]]  # lines for people, and the same as values


def contents(path: Path, reading: Reading, said: list[str]) -> Description:
    """What is in a file; `said` are the warnings of reading it, and grows."""
    if path.suffix.lower() == ".json":
        return _of_json(path)
    if (form := format_at(path)) is not None and form.holds is Holds.CLIP:
        return _of_clip(path, reading)
    if (solution := _solution(path, reading.max_pixels)) is not None:
        return _of_solution(solution)
    picture = reading.read(path, said)
    return _of_picture(path, picture, reading, guessed=bool(said))


def shots_in(path: Path, reading: Reading) -> list[bm.background.ClipShot]:
    """The shots of a clip."""
    frames = reading.frames([str(path)], None)
    with bm.motion.Workers(1) as workers, waiting("finding the shots"):
        return [one.numbered(frames.frame_numbers) for one in shots_of(frames, workers)]


def picture_in(path: Path, reading: Reading) -> bm.LinearImage | bm.Layer | bm.Solution:
    """What a sheet of a file shows: a solution, a layer, or a picture."""
    if (solution := _solution(path, reading.max_pixels)) is not None:
        return solution
    picture = reading.read(path)
    return _layer(path, reading) or picture


def _of_json(path: Path) -> Description:
    hint = "give a file that blurmatte wrote"
    match json_kind(read_document(path, hint)):
        case "transfer curve":
            curve = bm.read_transfer(path)
            words = bm.explain(curve)
            numbers = {"kind": "transfer curve", "name": curve.name, "in_words": words}
            return [f"{path}: transfer curve {curve.name}", *words], numbers
        case "noise model":
            return _of_noise(bm.read_noise(path))
        case "report":
            words = read_json(path, _Report, hint, "report").in_words
            lines = [f"{path}: a report, text that holds all numbers", *words]
            return lines, {"kind": "report", "in_words": words}
    what = "color model, report, noise or transfer curve"
    model: bm.ColorModel = read_json(path, MODEL, hint, what)
    return [in_degrees(model), *bm.explain(model)], {"kind": "color model", **color_numbers(model)}


@dataclass
class _Report:
    in_words: list[str]


def _of_noise(noise: bm.radiometry.Noise) -> Description:
    rows = noise_to_mapping(noise)
    words = {"read_std": "read noise", "relative_std": "of the light"}
    said = (
        f"{words.get(name, name)}: {', '.join(f'{x:.3g}' for x in np.ravel(row))}"
        for name, row in rows.items()
    )
    return [str(noise), *said], {"kind": "noise", **rows}


def _of_solution(solution: bm.Solution) -> Description:
    words, stats = bm.explain(solution), stats_to_mapping(solution.stats)
    lines = [str(solution), f"solver: {solution.solver}", in_degrees(solution.model), *words]
    lines += _named(stats)
    lines.append("every digit, and the points: stats in report.json")
    numbers = {"size": solution.size, "solver": solution.solver, "stats": stats}
    model = color_numbers(solution.model)
    return lines, {"kind": "solution", **numbers, "model": model, "in_words": words}


def _named(stats: Mapping[str, Any], of: str = "") -> Iterator[str]:
    """Numbers about a solution, each in a line; nested ones as OUTER.INNER."""
    for name, value in stats.items():
        if isinstance(value, Mapping):
            yield from _named(value, f"{of}{name}.")
        elif isinstance(value, list) and value and isinstance(value[0], Mapping):
            yield from _named({str(k): part for k, part in enumerate(value, 1)}, f"{of}{name}.")
        else:
            yield f"{of}{name}: {_short(value)}"


def _short(value: Any) -> str:
    """A value as text: six digits; of arrays of points, and of long rows, their number."""
    if isinstance(value, list) and np.ndim(value) > 1 and np.shape(value)[-1] == 2:
        return f"{' x '.join(map(str, np.shape(value)[:-1]))} points"
    if isinstance(value, list) and np.ndim(value) > 1 and np.shape(value)[-1] > _MAX_LISTED:
        return f"{' x '.join(map(str, np.shape(value)))} numbers"
    if isinstance(value, list):
        between = "; " if np.ndim(value) > 1 else ", "
        return between.join(map(_short, value)) or "none"
    if isinstance(value, float):
        return f"{value:.6g}"
    return "not known" if value is None else str(value)


def _solution(path: Path, max_pixels: int) -> bm.Solution | None:
    """The Solution in an EXR, if it is one."""
    if format_at(path) is not EXR:
        return None
    try:
        return bm.read_solution(path, max_pixels)
    except DocumentError:  # it is one, and damaged
        raise
    except bm.errors.FileError:  # reading it as a picture says what is wrong
        return None


def _layer(path: Path, reading: Reading) -> bm.Layer | None:
    """The layer in a picture file, if it has an alpha that is not 1 everywhere."""
    try:
        # Reading the picture said it.
        with warnings.catch_warnings(action="ignore", category=bm.errors.TransferWarning):
            layer = bm.read_layer(path, reading.curve_of(path), reading.max_pixels)
    except bm.errors.FileError:
        return None
    return layer if layer.alpha.min() < 1 else None


def _of_picture(
    path: Path, picture: bm.LinearImage, reading: Reading, guessed: bool
) -> Description:
    meta, layer = picture.meta, _layer(path, reading)
    bits = None if meta.levels is None else math.ceil(np.log2(meta.levels))
    associated = layer is not None and load(path, max(1, layer.alpha.size)).associated
    source = "as you said" if reading.transfer else "a guess: nothing in the file says"
    if not (reading.transfer or guessed):
        source = "its ICC profile says" if meta.icc_profile else "its tags or its kind say"
    numbers = {
        "kind": "picture" if layer is None else "layer",
        "format": format_of(path).name,
        "size": picture.size,
        "bits": "float" if bits is None else bits,
        "gray": meta.gray,
        "alpha": None if layer is None else ("premultiplied" if associated else "straight"),
        "transfer": meta.transfer.name if meta.transfer else "linear",
        "transfer_from": source,
        "color_space": meta.color_space,
        "converted": meta.converted,
        "white_balance": meta.white_balance,
        "camera": meta.camera,
        "exposure_time": meta.exposure_time,
        "icc_profile_bytes": len(meta.icc_profile or b""),
    }
    lines, values = _light(picture) if layer is None else _alpha(layer)
    return [*_header(path, numbers), *lines], {**numbers, **values}


def _light(picture: bm.LinearImage) -> Description:
    """The light of a picture."""
    valid, (least, most) = float(np.mean(picture.valid)), _range(picture.rgb)
    lines = [
        f"valid (not clipped, opaque): {valid:.2%}",
        f"light: {least:.4g} to {most:.4g}, 1 is white",
    ]
    std = None if picture.noise is None else float(np.median(np.sqrt(picture.variance)))
    if std is not None:
        lines.append(f"error of the light, of each pixel: {std:.2g} in the middle, 1 is white")
    return lines, {"valid_share": valid, "light": (least, most), "median_std": std}


def _alpha(layer: bm.Layer) -> Description:
    """The alpha of a layer, and its light."""
    alpha, (least, most) = layer.alpha, _range(layer.premultiplied)
    peak, share, total = float(alpha.max()), float(np.mean(alpha > 0)), alpha.sum(dtype=float)
    lines = [
        f"alpha: up to {peak:.4g}, above 0 in {share:.2%} of the pixels, sum {total:.6g}",
        f"light times alpha: {least:.4g} to {most:.4g}, 1 is white",
    ]
    numbers = {"alpha_max": peak, "alpha_share": share, "alpha_sum": total}
    return lines, {**numbers, "premultiplied": (least, most)}


def _range(light: Floats) -> tuple[float, float]:
    return float(light.min()), float(light.max())


def _header(path: Path, about: Mapping[str, Any]) -> Iterator[str]:
    """Metadata of the file, in lines."""
    bits = about["bits"] if about["bits"] == "float" else f"{about['bits']} bit"
    what = f" and {about['alpha']} alpha: a layer" if about["alpha"] else ""
    colors = "gray" if about["gray"] else "RGB"
    yield f"{path}: {about['format']}, {by(about['size'])} pixels, {bits} {colors}{what}"
    yield f"transfer: {about['transfer']} ({about['transfer_from']})"
    converted = ", converted from those of the file" if about["converted"] else ""
    yield f"colors: {_colors(about['color_space'], about['white_balance'])}{converted}"
    if about["camera"]:
        yield f"camera: {about['camera']}"
    time = about["exposure_time"]
    yield f"exposure time: {f'{time:.6g} s' if time else 'not in the file'}"
    profile = about["icc_profile_bytes"]
    yield f"ICC profile: {f'{profile} bytes' if profile else 'none'}"


def _colors(space: str, white_balance: tuple[float, float, float] | None) -> str:
    """Primaries of the light, and its white balance."""
    if space != "camera":
        return "sRGB's primaries"
    if white_balance is None:
        return "the camera's own; its white balance is not known"
    red, _, blue = white_balance
    return (
        f"the camera's own; white balance as shot (not applied): red x{red:.4g}, blue x{blue:.4g}"
    )


def _of_clip(path: Path, reading: Reading) -> Description:
    """A clip: its frames are counted, the first is decoded."""
    frames = bm.read_frames(path, reading.curve, reading.max_pixels)
    clip = frames.clip
    if clip is None:
        raise bm.errors.FileError(f"{path}: give a clip; it is a picture")
    timing = clip.timing
    start = None if timing.times is None else timing.times[0]
    numbers = {
        "kind": "clip",
        "frames": len(frames),
        "undecodable_frames": timing.lost,
        "size": clip.size,
        "rate": frames.rate,
        "variable_rate": timing.rate_varies,
        "start": start,
        "duration": timing.duration,
        "codec": clip.codec,
        "pixel_format": clip.pixel_format,
        "bits": clip.bits,
        "alpha": clip.alpha,
        "transfer": clip.encoding.curves[0].name,
        "rotation": clip.rotation,
    }
    lost = f", {timing.lost} more cannot be decoded" if timing.lost else ""
    turned = f"; turned by {clip.rotation}°, which is applied" if clip.rotation else ""
    taken = times_in_words(start, timing.duration, frames.rate, timing.rate_varies)
    lines = [
        f"{path}: a clip of {len(frames)} frames{lost}, {by(clip.size)} pixels{turned}",
        f"time: {taken}",
        f"codec: {clip.codec}, {clip.pixel_format}, {clip.bits} bit{', alpha' if clip.alpha else ''}",
        f"transfer: {numbers['transfer']}",
    ]
    return lines, numbers

"""What `info` says of a clip."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

import blurmatte as bm
from blurmatte.cli.console import by
from blurmatte.cli.selection import Reading

_MAX_UNEVEN = 0.01  # of intervals between frames, relative: stamps are rounded


def of_clip(path: Path, reading: Reading) -> tuple[list[str], dict[str, Any]]:
    """Lines for people, and the same as values. Frames are counted, the first is decoded."""
    frames = bm.read_frames(path, reading.curve, reading.max_pixels)
    clip, times = frames.clip, frames.times
    if clip is None:
        raise bm.FileError(f"{path}: give a clip; it is a picture")
    steps = np.diff(times or ())
    uneven = len(steps) > 0 and float(np.ptp(steps)) > _MAX_UNEVEN * float(np.median(steps))
    start, last = (None, None) if times is None else (times[0], times[-1])
    step = float(np.median(steps)) if len(steps) else 1 / frames.rate if frames.rate else None
    duration = None if start is None or last is None or step is None else last - start + step
    numbers = {
        "kind": "clip",
        "frames": len(frames),
        "undecodable_frames": clip.timing.lost,
        "size": clip.size,
        "rate": frames.rate,
        "variable_rate": uneven,
        "start": start,
        "duration": duration,
        "codec": clip.codec,
        "pixel_format": clip.pixel_format,
        "bits": clip.bits,
        "alpha": clip.alpha,
        "transfer": clip.encoding.curves[0].name,
        "rotation": clip.rotation,
    }
    lost = f", {clip.timing.lost} more cannot be decoded" if clip.timing.lost else ""
    rate = "an unknown number" if frames.rate is None else f"{frames.rate:.5g}"
    turned = f"; turned by {clip.rotation}°, which is applied" if clip.rotation else ""
    taken = "times are not stated"
    if duration is not None:
        taken = f"{duration:.4g} s from {start:.4g} s on, {rate} frames a second"
        taken += " on average: the rate varies" if uneven else ""
    lines = [
        f"{path}: a clip of {len(frames)} frames{lost}, {by(clip.size)} pixels{turned}",
        f"time: {taken}",
        f"codec: {clip.codec}, {clip.pixel_format}, {clip.bits} bit{', alpha' if clip.alpha else ''}",
        f"transfer: {numbers['transfer']}",
    ]
    return lines, numbers

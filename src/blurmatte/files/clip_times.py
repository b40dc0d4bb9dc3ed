"""Times of a clip's frames: of its packets, as they were taken, and whether some are missing."""

import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from blurmatte.errors import BlurmatteWarning

MICROSECOND = Fraction(1, 1_000_000)  # FFmpeg's unit of the duration of a file
_MIN_MISSING_FRAMES = 2  # durations are rounded
_MIN_MISSING_FRACTION = 0.02
_MIN_SPEED_RATIO = 1.2  # of the rates of capture and playback: below, frames were dropped
_MIN_TICKS = 4  # of a frame: coarser ticks fit any rate
_CAPTURE_RATE = re.compile(r"(capture|camera|sensor).*(fps|frame.?rate)$", re.IGNORECASE)
_CLOCK = re.compile(r"(\d+):(\d+):(\d+(?:\.\d+)?)")


@dataclass(frozen=True, eq=False)
class Timing:
    """When the frames of a clip were taken."""

    count: int  # number of frames that are shown
    playback_rate: float | None  # frames per second, on average
    rate: float | None  # as they were taken, on average
    # (n,): time stamps of the frames in order, in ticks of the file; empty if it does not state them
    stamps: npt.NDArray[np.int64]
    seconds: npt.NDArray[np.float64]  # (n,): their times
    keys: npt.NDArray[np.int64]  # (m,): indices of key frames, at which decoding can begin

    @property
    def times(self) -> tuple[float, ...] | None:
        """Of the frames, seconds, in order; None if the file does not state them."""
        return tuple(self.seconds.tolist()) if len(self.stamps) else None

    def index_of(self, stamp: int | None) -> int | None:
        """Which frame has a time stamp."""
        at = int(np.searchsorted(self.stamps, stamp)) if stamp is not None else len(self.stamps)
        return at if at < len(self.stamps) and self.stamps[at] == stamp else None

    def of(self, frame: Any) -> float | None:
        """The time of a `VideoFrame`, seconds."""
        at = self.index_of(frame.pts)
        time: float | None = frame.time if at is None else float(self.seconds[at])
        return time

    def key_before(self, index: int) -> int:
        """The last key frame up to a frame; 0 if none is known."""
        at = int(np.searchsorted(self.keys, index, side="right"))
        return int(self.keys[at - 1]) if at else 0

    def key_from(self, index: int) -> int:
        """The first key frame from a frame on; the number of frames if there is none."""
        at = int(np.searchsorted(self.keys, index))
        return int(self.keys[at]) if at < len(self.keys) else self.count


def timing_of(path: Path, container: Any, stream: Any, stacklevel: int) -> Timing:
    """Read all packets of a clip. Stamps within a tick of a constant rate are taken as exact.

    Warns BlurmatteWarning if the file is truncated, or states that frames were taken at another
    rate than they are played at; times are then those of the capture, if the rates are constant.
    """
    import av

    stamps: list[int | None] = []
    keys: list[int] = []
    partial = False
    ends: dict[int, Fraction] = {}
    try:
        for packet in container.demux():
            start = packet.dts if packet.pts is None else packet.pts
            if start is not None and packet.size:
                end = (start + (packet.duration or 0)) * packet.time_base
                ends[packet.stream_index] = max(end, ends.get(packet.stream_index, end))
            if packet.stream_index == stream.index and packet.size and not packet.is_discard:
                stamps.append(packet.pts)
                if packet.is_keyframe and packet.pts is not None:
                    keys.append(packet.pts)
                partial = packet.is_corrupt
    except av.FFmpegError:
        pass  # the end of a truncated file
    if partial:
        stamps.pop()
    rate = float(stream.average_rate) if stream.average_rate else None
    missing = partial + _missing_at_end(container, stream, ends, rate or 0.0)
    if "mp4" not in container.format.name:  # whose edit lists hide frames
        missing = max(missing, stream.frames - len(stamps))
    if missing >= max(_MIN_MISSING_FRAMES, _MIN_MISSING_FRACTION * len(stamps)):
        warnings.warn(
            f"{path}: copy or export it again if it should be complete; "
            f"it ends after about {len(stamps)} of {len(stamps) + missing} frames",
            BlurmatteWarning,
            stacklevel=stacklevel + 1,
        )
    known = np.sort([pts for pts in stamps if pts is not None]).astype(np.int64)
    if len(known) < len(stamps) or not len(known):
        none = np.empty(0, np.int64)
        return Timing(len(stamps), rate, rate, none, none.astype(float), none)
    seconds, constant = _on_grid(known, stream)
    at = np.searchsorted(known, np.sort(keys))  # of those that are shown
    timing = Timing(len(known), rate, rate, known, seconds, at[at < len(known)])
    return _as_captured(path, timing, _capture_rate(container, stream), constant, stacklevel + 1)


def _missing_at_end(container: Any, stream: Any, ends: Mapping[int, Fraction], rate: float) -> int:
    """Number of frames between the end of the packets and that which the file states."""
    end, tag = (
        ends.get(stream.index, Fraction(0)),
        _CLOCK.match(stream.metadata.get("DURATION", "")),
    )
    if stream.duration:
        stated = stream.duration * stream.time_base
    elif tag:
        stated = int(tag[1]) * 3600 + int(tag[2]) * 60 + Fraction(tag[3])
    else:  # that of the longest stream
        stated = (container.duration or 0) * MICROSECOND
        end = max(ends.values(), default=Fraction(0))
    start = (stream.start_time or 0) * stream.time_base
    return max(round(float(stated - max(end, end - start)) * rate), 0)


def _on_grid(stamps: npt.NDArray[np.int64], stream: Any) -> tuple[npt.NDArray[np.float64], bool]:
    """Seconds of the stamps, exact if they are rounded times of a rate; True if none is left out."""
    offsets = stamps - stamps[0]
    for rate in (stream.base_rate, stream.average_rate, stream.guessed_rate):
        ticks = 1 / (rate * stream.time_base) if rate else Fraction(0)
        if ticks < _MIN_TICKS:
            continue
        number = np.rint(offsets / float(ticks)).astype(int)
        rounding = offsets - number * float(ticks)
        if np.ptp(rounding) < 1.001 and np.all(np.diff(number) > 0):
            first = int(stamps[0])
            exact = (float((first + int(n) * ticks) * stream.time_base) for n in number)
            return np.fromiter(exact, float, len(number)), bool(np.all(np.diff(number) == 1))
    return np.array([float(int(stamp) * stream.time_base) for stamp in stamps]), False


def _capture_rate(container: Any, stream: Any) -> tuple[str, float] | None:
    """Name and value of the tag that states how many frames were taken in a second."""
    for name, text in {**container.metadata, **stream.metadata}.items():
        number = re.match(r"\d+(\.\d+)?", text)
        if _CAPTURE_RATE.search(name) and number and float(number[0]) > 0:
            return name, float(number[0])
    return None


def _as_captured(
    path: Path,
    timing: Timing,
    stated: tuple[str, float] | None,
    constant: bool,
    stacklevel: int,
) -> Timing:
    """The times of the capture, if it was at another rate and both are constant."""
    if stated is None or len(timing.stamps) < 2:
        return timing
    (name, rate), played = stated, 1 / float(np.median(np.diff(timing.seconds)))
    ratio = rate / played
    if 1 / _MIN_SPEED_RATIO < ratio < _MIN_SPEED_RATIO:
        return timing
    advice = (
        f"times, speeds and scales are those of the capture; pass rate={played:.4g} to take them as "
        "played"
        if constant
        else "times are as played, not at one rate; cut out a part of one rate, and pass its true rate="
    )
    warnings.warn(
        f"{path}: taken at {rate:.4g} frames per second ({name}), played at {played:.4g}: {advice}",
        BlurmatteWarning,
        stacklevel=stacklevel + 1,
    )
    if not constant:
        return timing
    return replace(timing, rate=rate, seconds=timing.seconds / ratio)

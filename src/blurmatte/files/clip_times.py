"""The frames of a clip: their numbers, their times as they were taken, and whether some are missing.

The number of a frame is its place among the frames that can be decoded, in the order in which they are
shown. Packets are stored in another order, some hold no frame that is shown or can be decoded, and
their time stamps may repeat or go back, as in joined files. Where packets and frames agree, a stamp
identifies a frame; otherwise the clip is decoded once, and stamps are those of its frames.
"""

import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from blurmatte.checks import Array, Ints64
from blurmatte.errors import FileError, listed, warn

_MAX_UNEVEN = 0.01  # of intervals between frames, relative: stamps are rounded
_MIN_MISSING_FRAMES = 2  # durations are rounded
_MIN_MISSING_FRACTION = 0.02
_NO_STAMP = np.iinfo(np.int64).min  # of a packet or frame without one; FFmpeg's AV_NOPTS_VALUE
_MIN_SPEED_RATIO = 1.2  # of the rates of capture and playback: below, frames were dropped
_MIN_TICKS = 4  # of a frame: coarser ticks fit any rate
_CAPTURE_RATE = re.compile(r"(capture|camera|sensor).*(fps|frame.?rate)$", re.IGNORECASE)
_CLOCK = re.compile(r"(\d+):(\d+):(\d+(?:\.\d+)?)")


@dataclass(frozen=True, eq=False)
class Timing:
    """When the frames of a clip were taken."""

    count: int  # number of frames that are shown and can be decoded
    playback_rate: float | None  # frames per second, on average
    rate: float | None  # as they were taken, on average
    # (n,): rising time stamps, by which frames are found, in ticks of the file; empty if the file does
    # not state them, or they do not rise: frames are counted from the beginning then
    stamps: Ints64
    seconds: Array  # (n,): the times of the frames; empty if they are not stated
    keys: Ints64  # (m,): numbers of key frames, at which decoding can begin
    lost: int = 0  # number of frames that cannot be decoded, by their packets

    @property
    def times(self) -> tuple[float, ...] | None:
        """Of the frames, seconds, in order; None if the file does not state them."""
        return tuple(self.seconds.tolist()) if len(self.seconds) else None

    @property
    def rate_varies(self) -> bool:
        """Whether the times from frame to frame differ."""
        steps = np.diff(self.seconds)
        return len(steps) > 0 and float(np.ptp(steps)) > _MAX_UNEVEN * float(np.median(steps))

    @property
    def duration(self) -> float | None:
        """From the first frame until the end of the last, seconds; None if it is not known."""
        steps, usual = np.diff(self.seconds), 1 / self.rate if self.rate else None
        step = float(np.median(steps)) if len(steps) else usual
        if not len(self.seconds) or step is None:
            return None
        return float(self.seconds[-1] - self.seconds[0]) + step

    def number_after(self, number: int, frame: Any) -> int | None:
        """Number of the `VideoFrame` that is decoded after that of a number; None if it has none."""
        if not len(self.stamps):
            return number + 1 if number + 1 < self.count else None
        if frame.pts is None:
            return None
        at = int(np.searchsorted(self.stamps, frame.pts))
        return at if at < self.count and self.stamps[at] == frame.pts else None

    def time_of(self, number: int, frame: Any) -> float | None:
        """The time of a `VideoFrame` and its number, seconds."""
        time: float | None = float(self.seconds[number]) if len(self.seconds) else frame.time
        return time

    def key_before(self, index: int) -> int:
        """The last key frame up to a frame; 0 if none is known."""
        at = int(np.searchsorted(self.keys, index, side="right"))
        return int(self.keys[at - 1]) if at else 0

    def key_from(self, index: int) -> int:
        """The first key frame from a frame on; the number of frames if there is none."""
        at = int(np.searchsorted(self.keys, index))
        return int(self.keys[at]) if at < len(self.keys) else self.count


def timing_of(
    path: Path, container: Any, stream: Any, decoded: Callable[[], Iterator[Any]]
) -> Timing:
    """Read all packets of a clip. Stamps within a tick of a constant rate are taken as exact.

    `decoded()` are the `VideoFrame`s of the clip from its beginning.

    Raises FileError if none can be decoded, or if all need frames that are missing. Warns
    BlurmatteWarning if the file is truncated, if frames cannot be decoded, if time stamps repeat or go
    back, or if the file states that frames were taken at another rate than they are played at; times
    are then those of the capture, if the rates are constant.
    """
    import av

    packets = _packets(container, stream)
    rate = float(stream.average_rate) if stream.average_rate else None
    _warn_if_truncated(path, container, stream, packets)
    stamps = packets.stamps
    first = next(decoded(), None)
    if first is None:
        raise FileError(f"{path}: copy or export it again; no frame can be decoded")
    if len(stamps) and not len(packets.keys) and first.pict_type != av.video.frame.PictureType.I:
        # Some decoders, such as that of MPEG-4 Part 2, invent what its frames refer to.
        raise FileError(
            f"{path}: cut it at a key frame, or export it again; it has no key frame, and all "
            "frames refer to others that are missing"
        )
    starts_late = np.any(stamps != _NO_STAMP) and first.pts != stamps.min()
    if starts_late or not packets.agree:
        stamps = _stamps_of_frames(decoded())
        if len(packets.keys) and np.all(np.diff(stamps) > 0):
            # Some decoders invent what the frames before a key frame refer to.
            stamps = stamps[stamps >= packets.keys[0]]
        _warn_of_lost(path, packets, stamps, float(stream.time_base))
    lost = 0 if packets.hidden else packets.count - len(stamps)
    count, stamps = len(stamps), stamps[stamps != _NO_STAMP]
    none = np.empty(0, np.int64)
    if len(stamps) < count or not count:
        return Timing(count or packets.count, rate, rate, none, none.astype(float), none, lost)
    if packets.agree:
        stamps = np.sort(stamps)
    if np.all(np.diff(stamps) > 0):
        seconds, constant = _on_grid(stamps, stream)
        keys = np.flatnonzero(np.isin(stamps, packets.keys))
        timing = Timing(count, rate, rate, stamps, seconds, keys, lost)
    else:
        _warn_of_order(path, stamps)
        seconds, constant = _on_grid(_continued(stamps), stream)
        timing = Timing(count, rate, rate, none, seconds, none, lost)
    return _as_captured(path, timing, _capture_rate(container, stream), constant)


@dataclass(frozen=True, eq=False)
class _Packets:
    """The packets of a video stream, in the order of the file."""

    stamps: Ints64  # (n,): of those that are shown; `_NO_STAMP` for none
    keys: Ints64  # (m,): stamps of key frames
    ends: Mapping[int, Fraction]  # of each stream of the file, seconds
    partial: bool  # the last one was cut off
    agree: bool  # each has one frame, and their stamps have the order of the frames
    hidden: bool  # some are references that are not shown

    @property
    def count(self) -> int:
        """Number of packets that are shown."""
        return len(self.stamps)


def _packets(container: Any, stream: Any) -> _Packets:
    """Read all packets of a clip."""
    import av

    stamps, keys, decoding = list[int](), list[int](), list[int]()
    corrupt, begins_with_key = list[bool](), False
    ends: dict[int, Fraction] = {}
    try:
        for packet in container.demux():
            start = packet.dts if packet.pts is None else packet.pts
            if start is not None and packet.size:
                end = (start + (packet.duration or 0)) * packet.time_base
                ends[packet.stream_index] = max(end, ends.get(packet.stream_index, end))
            if packet.stream_index == stream.index and packet.size and not packet.is_discard:
                begins_with_key |= packet.is_keyframe and not stamps
                stamps.append(_NO_STAMP if packet.pts is None else packet.pts)
                corrupt.append(packet.is_corrupt)
                if packet.dts is not None:
                    decoding.append(packet.dts)
                if packet.is_keyframe and packet.pts is not None:
                    keys.append(packet.pts)
    except av.FFmpegError:
        pass  # the end of a truncated file
    partial = bool(corrupt and corrupt[-1])
    if partial:
        del stamps[-1], corrupt[-1]
    known = [stamp for stamp in stamps if stamp != _NO_STAMP]
    rising = len(set(known)) == len(known) and all(
        np.all(np.diff(some) >= 0) for some in (decoding, keys)
    )
    hidden = stream.codec.name == "vp8"
    agree = rising and begins_with_key and not any(corrupt) and not hidden
    of_packets, of_keys = (np.array(some, np.int64) for some in (stamps, keys))
    return _Packets(of_packets, of_keys, ends, partial, agree, hidden)


def _stamps_of_frames(frames: Iterator[Any]) -> Ints64:
    """(n,) stamps of all frames that can be decoded, in order; `_NO_STAMP` for none."""
    import av

    stamps = list[int]()
    try:
        for frame in frames:
            stamps.append(_NO_STAMP if frame.pts is None else frame.pts)
    except av.FFmpegError:
        pass  # a damaged packet ends the clip
    return np.array(stamps, np.int64)


def _continued(stamps: Ints64) -> Ints64:
    """Rising stamps: where they go back the next frame follows after the usual interval.

    Frames of one stamp are at equal distances up to the next one.
    """
    steps = np.diff(stamps)
    usual = int(np.median(steps[steps > 0])) if np.any(steps > 0) else 1
    risen = np.concatenate([[0], np.cumsum(np.where(steps < 0, usual, steps))])
    first = np.concatenate([[True], np.diff(risen) > 0])
    known = np.append(risen[first], risen[-1] + usual)
    spread = np.interp(np.arange(len(risen)), np.append(np.flatnonzero(first), len(risen)), known)
    return np.asarray(stamps[0] + np.rint(spread), np.int64)


def _warn_if_truncated(path: Path, container: Any, stream: Any, packets: _Packets) -> None:
    """Warn if the file states that it is longer."""
    rate = float(stream.average_rate or 0)
    missing = packets.partial + _missing_at_end(container, stream, packets.ends, rate)
    if "mp4" not in container.format.name:  # whose edit lists hide frames
        missing = max(missing, stream.frames - packets.count)
    if missing >= max(_MIN_MISSING_FRAMES, _MIN_MISSING_FRACTION * packets.count):
        warn(
            f"{path}: copy or export it again if it should be complete; "
            f"it ends after about {packets.count} of {packets.count + missing} frames"
        )


def _warn_of_lost(path: Path, packets: _Packets, stamps: Ints64, tick: float) -> None:
    """Warn of packets whose frames cannot be decoded."""
    lost = packets.count - len(stamps)
    if lost <= 0 or packets.hidden:
        return
    at = np.setdiff1d(packets.stamps, stamps) * tick
    span = f" ({at[0]:.4g} s to {at[-1]:.4g} s)" if len(at) == lost else ""
    begins = len(at) == lost and at[-1] < stamps.min() * tick
    why = "no key frame is before them" if begins else "a key frame is missing, or they are damaged"
    warn(
        f"{path}: cut it at a key frame, or export it again; {lost} of {packets.count} frames"
        f"{span} cannot be decoded ({why}), and the others are numbered from 0 without them"
    )


def _warn_of_order(path: Path, stamps: Ints64) -> None:
    """Warn of time stamps that go back or repeat."""
    steps = np.diff(stamps)
    joined = "each continues from the frame before; cut the clip there if it was joined"
    kinds = (
        (steps < 0, "go back", joined),
        (steps == 0, "repeat", "those frames are placed between their neighbors"),
    )
    for where, what, then in kinds:
        if (at := np.flatnonzero(where) + 1).size:
            warn(f"{path}: its time stamps {what} at frame {listed(at, 5)}: {then}")


def _missing_at_end(container: Any, stream: Any, ends: Mapping[int, Fraction], rate: float) -> int:
    """Number of frames between the end of the packets and that which the file states."""
    import av

    end = ends.get(stream.index, Fraction(0))
    tag = _CLOCK.match(stream.metadata.get("DURATION", ""))
    if stream.duration:
        stated = stream.duration * stream.time_base
    elif tag:
        stated = int(tag[1]) * 3600 + int(tag[2]) * 60 + Fraction(tag[3])
    else:  # that of the longest stream
        stated = Fraction(container.duration or 0, av.time_base)
        end = max(ends.values(), default=Fraction(0))
    start = (stream.start_time or 0) * stream.time_base
    return max(round(float(stated - max(end, end - start)) * rate), 0)


def _on_grid(stamps: Ints64, stream: Any) -> tuple[Array, bool]:
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
) -> Timing:
    """The times of the capture, if it was at another rate and both are constant."""
    if stated is None or len(timing.seconds) < 2:
        return timing
    (name, rate), played = stated, 1 / float(np.median(np.diff(timing.seconds)))
    ratio = rate / played
    if 1 / _MIN_SPEED_RATIO < ratio < _MIN_SPEED_RATIO:
        return timing
    advice = (
        "unless a rate is given, times, speeds and scales are those of the capture; "
        f"rate= (--rate) {played:.4g} takes them as played"
        if constant
        else "times are as played, not at one rate; cut out a part of one rate, and pass its true "
        "rate= (--rate)"
    )
    warn(
        f"{path}: taken at {rate:.4g} frames per second ({name}), played at {played:.4g}: {advice}"
    )
    if not constant:
        return timing
    return replace(timing, rate=rate, seconds=timing.seconds / ratio)

"""Decoding of clips by FFmpeg through PyAV: frames by their numbers, from the last key frame before.

A clip may stay open between calls, so that frames that follow are decoded without those before them.
"""

import sys
import threading
import weakref
from collections.abc import Generator, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from blurmatte.errors import FileError, optional_library
from blurmatte.files.clip_times import Timing
from blurmatte.files.errors import check_exists, plain_name
from blurmatte.formats import format_at

_MIN_DISTANCE = 4  # frames to the next one that is wanted; in fewer, few are of no use

_NO_OTHER_FILES = {"protocol_whitelist": "file"}  # of a playlist: on other machines

_open = threading.local()  # .clip stays open between calls


def decoded(
    path: Path, timing: Timing, decoder: str, numbers: range, keep_open: bool
) -> Iterator[tuple[int, Any]]:
    """Numbers and `VideoFrame`s, in order; None for a frame that cannot be decoded.

    Parameters
    ----------
    path : Path
    timing : Timing
        Of the clip.
    decoder : str
        Name of FFmpeg's decoder; "" for the usual one.
    numbers : range
        Of the frames, increasing.
    keep_open : bool
        The clip stays open for the next call of this thread, and one thread decodes it: many processes
        do at the same time. Else there are as many threads as cores.

    Raises
    ------
    FileError
        If the clip is damaged.
    """
    clip = _taken(path, decoder) if keep_open else _OpenClip(path, decoder, parallel=True)
    intact = False
    try:
        with naming_errors(path):
            for number in numbers:
                yield number, clip.frame(number, timing)
        intact = True
    except GeneratorExit:
        intact = True
        raise
    finally:
        if keep_open and intact:
            _open.clip = clip
        else:
            clip.close()


class _OpenClip:
    """A clip that is open, and the last frame that was decoded."""

    def __init__(self, path: Path, decoder: str, parallel: bool) -> None:
        self.path, self.decoder, self.parallel = path, decoder, parallel
        self.file = _identity(path)
        self.before, self.at = -1, -1
        self.last: Any = None
        self.first: int | None = None  # time stamp of the first frame that is wanted
        self._begin()

    @property
    def decodes_all(self) -> bool:
        """Whether no frames can be left out: libraries outside FFmpeg (AV1) choose which ones once."""
        name = str(self.stream.codec_context.codec.name)
        return bool(self.decoder) or name == "vp8" or name.startswith("lib")

    def frame(self, number: int, timing: Timing) -> Any | None:
        """The frame of a number; None if it cannot be decoded."""
        if self.before < number < self.at:
            return None
        key = 0 if self.decoder else timing.key_before(number)
        if number < self.at or key > self.at + 1:
            self._seek(key, timing)
        is_far = number - self.at >= _MIN_DISTANCE and len(timing.stamps) > 0
        if skips := is_far and not self.decodes_all:
            self.first = int(timing.stamps[number])
        while self.at < number:
            self._read(timing)
        if skips:
            self.before = max(self.before, number - 1)  # frames before it are not missing
        return self.last if self.at == number else None

    def close(self) -> None:
        """Close the file."""
        self.frames.close()  # those of a seek; the stack closes the first ones
        self.stack.close()

    def _begin(self) -> None:
        """Open the file."""
        self.stack = ExitStack()
        self.container, self.stream = self.stack.enter_context(opened(self.path))
        _set_threads(self.stream, self.parallel)
        self.frames = self._frames()
        self.stack.callback(self.frames.close)
        # Python's exit would close the file after FFmpeg's modules are gone.
        weakref.finalize(self, self.stack.close)
        self.before, self.at, self.last, self.first = -1, -1, None, None

    def _frames(self) -> Generator[Any]:
        """The `VideoFrame`s from here on; before the first one that is wanted, those of use for it."""
        if self.decoder:
            yield from decoded_packets(self.container, self.stream, self.decoder)
            return
        yield from _frames_of(self._packets(), self.stream.codec_context)

    def _packets(self) -> Iterator[Any]:
        """The packets from here on; the decoder leaves out what no wanted frame needs."""
        for packet in self.container.demux(self.stream):
            unwanted = None not in (self.first, packet.pts) and packet.pts < self.first
            self.stream.codec_context.skip_frame = "NONREF" if unwanted else "DEFAULT"
            yield packet

    def _seek(self, key: int, timing: Timing) -> None:
        """Go on at a key frame; at the first frame, the file is opened again."""
        if key > 0:
            self.frames.close()
            self.container.seek(int(timing.stamps[key]), stream=self.stream)
            self.frames = self._frames()
            self.before, self.at, self.first = -1, -1, None
            self._read(timing)
            self.before = self.at - 1  # frames before it are not missing
            if self.at <= key:
                return
        self.close()
        self._begin()

    def _read(self, timing: Timing) -> None:
        """Decode the next frame; after the last one there is none."""
        self.before = self.at
        for frame in self.frames:
            at = timing.number_after(self.at, frame)
            if at is not None and at > self.at:
                self.at, self.last = at, frame
                return
        self.at, self.last = sys.maxsize, None


def _taken(path: Path, decoder: str) -> _OpenClip:
    """The clip that is open, if it is this one; else this one is opened."""
    clip: _OpenClip | None = _open.__dict__.pop("clip", None)
    if clip is not None:
        if (clip.file, clip.decoder) == (_identity(path), decoder):
            return clip
        clip.close()
    return _OpenClip(path, decoder, parallel=False)


def _identity(path: Path) -> tuple[Path, int, int, int]:
    """What differs between files, and after a file was written again."""
    check_exists(path, "give a clip, or the pictures in it")
    status = path.stat()
    return path, status.st_ino, status.st_size, status.st_mtime_ns


@contextmanager
def opened(path: Path) -> Iterator[tuple[Any, Any]]:
    """The container of a clip and its video stream; errors of FFmpeg become FileErrors."""
    av = video_library(path)
    check_exists(path, "give a clip, or the pictures in it")
    with naming_errors(path), ExitStack() as stack:
        with plain_name(path.absolute(), format_at(path)) as name:
            container = stack.enter_context(av.open(name, options=_NO_OTHER_FILES))
        videos = videos_of(container)
        if not videos:
            raise FileError(
                f"{path}: give a clip with pictures; the file holds no video, or none of known size"
            )
        best = container.streams.best("video")
        yield container, best if best in videos else videos[0]


@contextmanager
def naming_errors(path: Path) -> Iterator[None]:
    """Let errors of FFmpeg become FileErrors."""
    av = video_library(path)
    try:
        yield
    except av.FFmpegError as error:
        raise FileError(
            f"{path}: copy or export it again; it is no clip, or it is damaged ({error.strerror})"
        ) from error


def videos_of(container: Any) -> list[Any]:
    """The video streams of known size, without pictures if there are others: covers may be unmarked."""
    from av.stream import Disposition

    still = Disposition.attached_pic | Disposition.timed_thumbnails
    videos = [
        stream
        for stream in container.streams.video
        if not stream.disposition & still
        and stream.codec_context is not None
        and stream.width
        and stream.height
    ]
    return [stream for stream in videos if stream.frames != 1] or videos  # 0 is not known


def decoded_packets(container: Any, stream: Any, decoder: str) -> Generator[Any]:
    """The `VideoFrame`s of a stream, decoded by as many threads as there are cores."""
    from av import VideoCodecContext

    context: Any = stream.codec_context
    if decoder:
        context = VideoCodecContext.create(decoder, "r")
    else:
        _set_threads(stream, parallel=True)
    yield from _frames_of(container.demux(stream), context)


def _frames_of(packets: Iterable[Any], context: Any) -> Generator[Any]:
    """The `VideoFrame`s of packets. Those before the first key frame may be invalid: they have none."""
    from av import InvalidDataError

    begun = False
    for packet in packets:
        try:
            frames = context.decode(packet)
        except InvalidDataError:
            if begun:
                raise
            continue
        begun = begun or bool(frames)
        yield from frames


def _set_threads(stream: Any, parallel: bool) -> None:
    """Let as many threads as there are cores decode a stream, or one."""
    if parallel:
        stream.thread_type = "AUTO"
    else:
        stream.codec_context.thread_count = 1


def video_library(path: Path) -> Any:
    """PyAV.

    Raises
    ------
    FileError
        If it is not installed.
    """
    needed = f'{path}: pip install "blurmatte[video]", or use pictures; clips need PyAV'
    return optional_library("av", needed, FileError)

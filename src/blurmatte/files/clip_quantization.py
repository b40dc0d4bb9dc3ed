"""The error of a clip's code values by the quantizers of its codec.

FFmpeg exports the quantizers of H.264 and of MPEG-1, 2 and 4 with the frames that it decodes.
"""

import gc
from collections.abc import Callable, Sequence
from itertools import islice
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np

from blurmatte.checks import Array
from blurmatte.files.clip_decoding import opened
from blurmatte.files.clip_geometry import side_data_of
from blurmatte.files.clip_reading import Clip, luma_weights, planar, planes_of, zero_of
from blurmatte.files.clip_times import Timing
from blurmatte.radiometry import compression
from blurmatte.radiometry.transfer import ycbcr_matrix

_FRAMES_OF_GROUP = 12  # from a key frame on, of which one has the finest quantizers
_FRAMES_IN_MEMORY = 4
# By number of FFmpeg's AVVideoEncParamsType: steps of an orthonormal transform, from the numbers of
# quantizers. H.264: 0.625 at 0, doubled by 6 more [ITU-T H.264, 8.5.9]. MPEG: twice the number.
_STEPS: dict[int, Callable[[Array], Array]] = {
    1: lambda q: 0.625 * 2 ** (q / 6),
    2: lambda q: 2 * q,
}


# Of clips in use, by the key frames of their groups
_found: WeakKeyDictionary[Timing, dict[int, tuple[Array, float] | None]] = WeakKeyDictionary()


def coding_errors(clip: Clip, numbers: Sequence[int]) -> compression.CodingErrors | None:
    """The errors that frames share where nothing moves, and where something does; None if not known.

    The median of up to three groups of frames: objects change it in few.
    """
    if clip.decoder or not numbers:
        return None
    few = (numbers[0], numbers[len(numbers) // 2], numbers[-1])
    keys = sorted({clip.timing.key_before(n) for n in few})
    found = _found.setdefault(clip.timing, {})
    for key in keys:
        if key not in found:
            found[key] = _of_group(clip, key)
    groups = [found[key] for key in keys]
    known = [group for group in groups if group is not None]
    if not known:
        return None
    still, moving = (
        compression.CodingError(
            np.ascontiguousarray(clip.orientation.upright(blocks.astype(np.float32))),
            clip.size,
            clip.encoding.curves[0],
        )
        for blocks in np.median([blocks for blocks, _ in known], axis=0)
    )
    return compression.CodingErrors(still, moving, float(np.median([step for _, step in known])))


def _of_group(clip: Clip, key: int) -> tuple[Array, float] | None:
    """(2, h, w, 3) variances of R'G'B' codes, white is 1, in some frames from a key frame on.

    The first is that of the finest frame: those after it repeat its blocks or refine them, and coarser
    quantizers do not. The second is for the mean squared step of the frames, whose root follows.
    """
    found: tuple[Any, Array] | None = None
    squares = list[Array]()
    with opened(clip.path) as (container, stream):
        stream.codec_context.options = {"export_side_data": "venc_params"}
        stream.codec_context.thread_count = 1
        if key > 0:
            container.seek(int(clip.timing.stamps[key]), stream=stream)
        for number, frame in enumerate(islice(container.decode(stream), _FRAMES_OF_GROUP)):
            step = _steps(frame)
            if number % _FRAMES_IN_MEMORY == 0:
                gc.collect()  # side data keeps its frame in memory
            if step is not None:
                squares.append(step**2)
                if found is None or np.mean(step**2) < np.mean(found[1] ** 2):
                    found = frame, step
    group = None
    gc.collect()
    if found is not None:
        steps = found[1], np.sqrt(np.mean(squares, axis=0))
        variances = np.stack([_variance(clip, found[0], step) for step in steps])
        mean_step = float(np.mean(squares) ** 0.5) * 2.0 ** (8 - clip.bits)
        group = variances, mean_step / 219  # of white above black, as in most clips
    return group


def _steps(frame: Any) -> Array | None:
    """Step of each macroblock's quantizer, in code values of the frame; None if it is not stated.

    A damaged file may state quantizers of 0.
    """
    stated = side_data_of(frame, "VIDEO_ENC_PARAMS")
    if stated is None or not stated.nb_blocks or int(stated.codec_type) not in _STEPS:
        return None
    steps = _STEPS[int(stated.codec_type)](np.array(stated.qp_map(), float))
    return steps if steps.min() > 0 else None


def _variance(clip: Clip, frame: Any, step: Array) -> Array:
    """(h, w, 3) variance of R'G'B' codes, white is 1, in blocks of luma."""
    step, same = step * 2.0 ** (8 - clip.bits), planar(frame)
    full = zero_of(same)[0] == 0
    of_planes = []
    for number, plane in enumerate(planes_of(same)):
        h, w = (-(-side // compression.BLOCK) for side in plane.shape)
        repeats = 1 if number else compression.MACROBLOCK // compression.BLOCK
        of_block = np.kron(step, np.ones((repeats, repeats)))[:h, :w]
        variance = compression.quantization_variance(plane, of_block)
        if number:
            variance = np.asarray(np.kron(variance, np.ones((2, 2))))
        scale = 255 if full else 224 if number else 219
        of_planes.append(variance / scale**2)
    h, w = of_planes[0].shape
    planes = np.stack([one[:h, :w] for one in of_planes], axis=-1)
    return np.asarray(planes @ (np.linalg.inv(ycbcr_matrix(luma_weights(same))).T ** 2))

"""Where the blocks of a JPEG are, and in which order a scan goes through them [ITU-T T.81 A.2]."""

import numpy as np
import numpy.typing as npt

from blurmatte.files.jpeg_segments import Component

_BLOCK = 8  # pixels


def mcu_size(components: tuple[Component, ...]) -> tuple[int, int]:
    """Width and height of an MCU in pixels."""
    return (
        _BLOCK * max(component.across for component in components),
        _BLOCK * max(component.down for component in components),
    )


def block_numbers(
    size: tuple[int, int], components: tuple[Component, ...]
) -> list[npt.NDArray[np.int32]]:
    """(rows, columns) of each component: where its blocks are among all. Its last MCUs are full."""
    mcu = mcu_size(components)
    columns, rows = (-(-pixels // length) for pixels, length in zip(size, mcu, strict=True))
    numbers, first = [], 0
    for component in components:
        shape = rows * component.down, columns * component.across
        count = shape[0] * shape[1]
        numbers.append(np.arange(first, first + count, dtype=np.int32).reshape(shape))
        first += count
    return numbers


def scan_order(
    size: tuple[int, int],
    components: tuple[Component, ...],
    chosen: tuple[int, ...] | range,
) -> tuple[npt.NDArray[np.int32], npt.NDArray[np.int64]]:
    """Which blocks make up each unit of a scan of the `chosen` components, and whose those are.

    A scan of one component goes block by block, and not beyond the picture [T.81 A.2].
    """
    numbers, mcu = block_numbers(size, components), mcu_size(components)
    if len(chosen) == 1:
        own = components[chosen[0]]
        columns = -(-size[0] * own.across // mcu[0])
        rows = -(-size[1] * own.down // mcu[1])
        inside = numbers[chosen[0]][:rows, :columns]
        return np.ascontiguousarray(inside.reshape(-1, 1)), np.zeros(1, np.int64)
    parts, slots = [], []
    for slot, place in enumerate(chosen):
        c = components[place]
        rows, columns = numbers[place].shape
        cut = numbers[place].reshape(rows // c.down, c.down, columns // c.across, c.across)
        parts.append(cut.swapaxes(1, 2).reshape(-1, c.down * c.across))
        slots += [slot] * (c.down * c.across)
    return np.concatenate(parts, axis=1), np.array(slots)

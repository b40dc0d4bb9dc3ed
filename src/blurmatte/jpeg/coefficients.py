"""The coefficients of a JPEG in memory, and the order of its blocks in a scan [ITU-T T.81 A.2].

No permissively licensed library with wheels gives access to the quantized coefficients; hence this
package. Blocks that are not replaced decode to identical pixels.
"""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from blurmatte.checks import Ints32

# (64,) row-major index of each coefficient in zigzag order [T.81 figure A.6].
ZIGZAG = np.array(
    sorted(
        range(64),
        key=lambda i: (sum(divmod(i, 8)), i // 8 if sum(divmod(i, 8)) % 2 else i % 8),
    )
)
MAX_CODE_BITS = 16  # of a Huffman code


class JpegError(ValueError):
    """The JPEG cannot be used; the message is a clause that gives the reason."""


@dataclass(frozen=True)
class Component:
    """A channel of a JPEG: its identifier, and its blocks per MCU across and down."""

    number: int
    across: int
    down: int


@dataclass(frozen=True, eq=False)
class Jpeg:
    """A JPEG without its entropy coding."""

    # The APPn and COM segments as stored: EXIF, color profile, comments …
    metadata: tuple[bytes, ...]
    size: tuple[int, int]  # width and height in pixels, as stored
    components: tuple[Component, ...]
    # Tuple of (64,) uint16: the table of each component, in zigzag order
    quantization: tuple[npt.NDArray[np.uint16], ...]
    # (N, 64) int16: quantized, in zigzag order: all blocks of the first component row by row, then
    # of the next
    coefficients: npt.NDArray[np.int16]

    @property
    def mcu(self) -> tuple[int, int]:
        """Width and height of a minimum coded unit (MCU) in pixels."""
        return mcu_size(self.components)

    @property
    def sampling(self) -> tuple[tuple[int, int], ...]:
        """Blocks per MCU, across and down, of each component."""
        return tuple((c.across, c.down) for c in self.components)

    def blocks(self, index: int) -> npt.NDArray[np.int16]:
        """(rows, columns, 64) view of the coefficients of one component, padded to full MCUs."""
        numbers = block_numbers(self.size, self.components)[index]
        part = self.coefficients[numbers[0, 0] : numbers[-1, -1] + 1]
        return part.reshape(*numbers.shape, 64)


def mcu_size(components: tuple[Component, ...]) -> tuple[int, int]:
    """Width and height of an MCU in pixels."""
    return 8 * max(c.across for c in components), 8 * max(c.down for c in components)


def block_numbers(size: tuple[int, int], components: tuple[Component, ...]) -> list[Ints32]:
    """(rows, columns) block indices of each component, padded to full MCUs."""
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
) -> tuple[Ints32, npt.NDArray[np.int64]]:
    """(units, n) block indices of each coded unit of a scan, and (n,) the component of each block.

    A scan of one component is coded block by block and stops at the picture's edge [T.81 A.2].
    """
    numbers, mcu = block_numbers(size, components), mcu_size(components)
    if len(chosen) == 1:
        own = components[chosen[0]]
        columns = -(-size[0] * own.across // mcu[0])
        rows = -(-size[1] * own.down // mcu[1])
        inside = numbers[chosen[0]][:rows, :columns]
        return np.ascontiguousarray(inside.reshape(-1, 1)), np.zeros(1, np.int64)
    parts, slots = [], []
    for slot, index in enumerate(chosen):
        c = components[index]
        rows, columns = numbers[index].shape
        cut = numbers[index].reshape(rows // c.down, c.down, columns // c.across, c.across)
        parts.append(cut.swapaxes(1, 2).reshape(-1, c.down * c.across))
        slots += [slot] * (c.down * c.across)
    return np.concatenate(parts, axis=1), np.array(slots)

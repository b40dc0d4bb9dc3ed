"""Compiled loops of the gate: sums of codes over cells, and comparison with a table."""

from numba import njit


@njit(cache=True, nogil=True)
def sum_pairs(plane, out):  # type: ignore[no-untyped-def]
    """Sums of a plane (H, W) over squares of two values; `out` is (H // 2, W // 2) float32."""
    for y in range(out.shape[0]):
        upper, lower, row = plane[2 * y], plane[2 * y + 1], out[y]
        for x in range(out.shape[1]):
            total = upper[2 * x] + upper[2 * x + 1]
            total += lower[2 * x]
            total += lower[2 * x + 1]
            row[x] = total


@njit(cache=True, nogil=True)
def count_changes(cells, gain, expected, reach, block, counts, sums):  # type: ignore[no-untyped-def]
    """Count the cells of each block that differ from the plate, and sum their differences.

    Parameters
    ----------
    cells, expected, reach : (h, w) float32
        A frame, the plate, and the largest difference without motion.
    gain : float32
        Of the frame over the plate.
    block : int
        Cells along a side of a block.
    counts : (h // block, w // block) int32
        Increased by the numbers of cells beyond their reach.
    sums : (h // block, w // block) float32
        Overwritten by the sums of the differences.
    """
    width = counts.shape[1] * block
    for y in range(counts.shape[0]):
        for x in range(counts.shape[1]):
            sums[y, x] = 0
        for i in range(y * block, y * block + block):
            for x in range(0, width, block):
                total, count = sums[y, x // block], 0
                for j in range(x, x + block):
                    d = cells[i, j] - gain * expected[i, j]
                    total += d
                    count += abs(d) > reach[i, j]
                sums[y, x // block] = total
                counts[y, x // block] += count

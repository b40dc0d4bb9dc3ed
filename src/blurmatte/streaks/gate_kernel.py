"""Compiled loops of the gate: sums of codes over cells, and comparison with a table."""

import numpy as np

from blurmatte.compiling import njit


@njit()
def sum_pairs(plane, out):  # type: ignore[no-untyped-def]
    """Sums of a plane (H, W) over squares of two values; `out` is (H // 2, W // 2) float32."""
    for y in range(out.shape[0]):
        upper, lower, row = plane[2 * y], plane[2 * y + 1], out[y]
        for x in range(out.shape[1]):
            total = upper[2 * x] + upper[2 * x + 1]
            total += lower[2 * x]
            total += lower[2 * x + 1]
            row[x] = total


@njit()
def count_changes(plane, zero, gain, expected, reach, block, counts, sums):  # type: ignore[no-untyped-def]
    """Count the cells of each block that differ from the plate, and sum their differences.

    plane (n h, n w): code values of a frame; a cell has n x n of them, n = 1 or 2. `zero` is that of a
    cell without light, `gain` that of the frame over the plate. expected, reach (h, w): cells of the
    plate minus their zero, and the largest difference without motion. counts (h // block, w // block)
    are increased by the numbers of cells beyond their reach, sums overwritten by those of differences.
    """
    width = counts.shape[1] * block
    halved = plane.shape[0] == 2 * expected.shape[0]
    line = np.empty(width, np.float32)
    for y in range(counts.shape[0]):
        for x in range(counts.shape[1]):
            sums[y, x] = 0
        for i in range(y * block, y * block + block):
            if halved:
                upper, lower = plane[2 * i], plane[2 * i + 1]
                for j in range(width):
                    total = upper[2 * j] + upper[2 * j + 1]
                    total += lower[2 * j]
                    total += lower[2 * j + 1]
                    line[j] = total
            else:
                for j in range(width):
                    line[j] = plane[i, j]
            for x in range(0, width, block):
                total, count = sums[y, x // block], 0
                for j in range(x, x + block):
                    d = line[j] - zero - gain * expected[i, j]
                    total += d
                    count += abs(d) > reach[i, j]
                sums[y, x // block] = total
                counts[y, x // block] += count

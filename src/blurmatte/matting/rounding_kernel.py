"""The compiled loops of `rounding`; B, V_C, V_B, N are those of `evidence_kernel`."""

from typing import Any

import numpy as np
from numba import njit

from blurmatte.matting.evidence_kernel import _across, _both

_COMPILED: dict[str, Any] = {"error_model": "numpy", "cache": True, "nogil": True}


@njit(**_COMPILED)
def by_codes(B, V_C, V_B, N, alpha, mask, color, image, plate):  # type: ignore[no-untyped-def]
    """Turn light of a code more of each channel into pull of a code more of luma and chroma.

    Both pictures' in place, (h, w, 3). `color` has a column for luma and each chroma: what red, green
    and blue have of it.
    """
    lines, of_light = N.shape[1], np.zeros(3)
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            t = 1.0 - alpha[y, x]
            S = (
                V_C[y, x, 0] + t * t * V_B[y, x, 0],
                V_C[y, x, 1] + t * t * V_B[y, x, 1],
                V_C[y, x, 2] + t * t * V_B[y, x, 2],
            )
            b, b1, s01, s11 = _across(N, 0, B[y, x]), 0.0, 0.0, 1.0
            if lines == 2:
                b1, s01, s11 = _across(N, 1, B[y, x]), _both(N, 0, 1, S), _both(N, 1, 1, S)
            s00 = _both(N, 0, 0, S)
            scale = mask[y, x] / (s00 * s11 - s01 * s01)
            w0, w1 = scale * (s11 * b - s01 * b1), scale * (s00 * b1 - s01 * b)
            for c in range(3):
                of_light[c] = w0 * N[c, 0] + (w1 * N[c, 1] if lines == 2 else 0.0)
            for codes, seen in ((image, 1.0), (plate, t)):
                p, q, r = (
                    seen * of_light[0] * codes[y, x, 0],
                    seen * of_light[1] * codes[y, x, 1],
                    seen * of_light[2] * codes[y, x, 2],
                )
                for i in range(3):
                    codes[y, x, i] = p * color[0, i] + q * color[1, i] + r * color[2, i]


@njit(**_COMPILED)
def add_rounded(of_image, image, of_plate, plate, mask, off, width, border, out):  # type: ignore[no-untyped-def]
    """Add what codes (h, w, 3) pull by, off as tables (n, 3, codes) say, in cells (n, h, w)."""
    for y in range(mask.shape[0]):
        for x in range(mask.shape[1]):
            if not mask[y, x]:
                continue
            i, j = border + y // width, border + x // width
            for k in range(off.shape[0]):
                total = 0.0
                for c in range(3):
                    total += plate[y, x, c] * off[k, c, of_plate[y, x, c]]
                    total -= image[y, x, c] * off[k, c, of_image[y, x, c]]
                out[k, i, j] += total

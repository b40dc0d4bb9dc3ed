"""Symmetric matrices of which the lower band is stored."""

import numpy as np


def dense(band):
    """The symmetric matrix with this lower band."""
    m = band.shape[1]
    full = np.zeros((m, m))
    for k, diagonal in enumerate(band):
        full += np.diag(diagonal[: m - k], -k)
    return full + np.tril(full, -1).T

"""fuse_colors: inverse-covariance fusion of the colors of one object in several frames."""

from collections.abc import Sequence

import numpy as np

from blurmatte.color.model import ColorModel


def fuse_colors(models: Sequence[ColorModel]) -> ColorModel:
    """The mean of lines weighted by inverse covariance.

    If the lines differ by more than their covariances predict, the result's covariance is inflated.
    """
    if len(models) == 1:
        return models[0]
    mean = np.mean([model.pole for model in models], axis=0)
    for _ in range(3):
        mean /= np.linalg.norm(mean)
        T = np.linalg.svd(mean[:, None])[0][:, 1:]
        offsets = [T.T @ model.pole / (mean @ model.pole) for model in models]
        smallest = 1e-5**2 * np.eye(2)  # radians²: no color is known better
        weights = [np.linalg.inv(T.T @ model.covariance @ T + smallest) for model in models]
        covariance = np.linalg.inv(sum(weights))
        step = covariance @ sum(w @ t for w, t in zip(weights, offsets, strict=True))
        mean = mean + T @ step
    excess = sum(t @ w @ t for w, t in zip(weights, offsets, strict=True)) / (2 * len(models) - 2)
    covariance = covariance * max(float(excess), 1.0)
    std = float(np.degrees(np.sqrt(np.trace(covariance) / 2)))
    pole = mean / np.linalg.norm(mean)
    return ColorModel(pole[:, None], T @ covariance @ T.T, {"frames": std}, models[0].to_srgb)

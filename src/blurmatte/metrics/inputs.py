"""Checks of the arguments of metrics, and the region of the streak."""

import numpy as np

from blurmatte.checks import Bools, Floats, check_map, check_same_size
from blurmatte.layer import Layer


def check_all_finite(name: str, value: Floats) -> None:
    """Raise if `value` holds NaN or infinite numbers, and say how many."""
    lost = int(np.sum(~np.isfinite(value)))
    if lost:
        raise ValueError(f"{name} must be finite, got {lost} NaN or infinite of {value.size}")


def checked_alphas(estimated: Floats, true: Floats) -> tuple[Floats, Floats, Bools]:
    """Both, finite float (H, W) of one size, and the streak, (H, W) bool; raises unless they are so."""
    pair = []
    for name, given in (("estimated", estimated), ("true", true)):
        alpha = check_map(name, given)
        if alpha.ndim != 2:
            raise ValueError(f"{name} must have the shape (height, width), got {alpha.shape}")
        check_all_finite(name, alpha)
        pair.append(alpha)
    check_same_size("estimated", picture_size(pair[0]), "true", picture_size(pair[1]))
    return pair[0], pair[1], streak_of(pair[1])


def check_layer(name: str, value: object) -> None:
    """Raise unless `value` is a Layer of finite numbers."""
    if not isinstance(value, Layer):
        raise TypeError(f"{name} must be a Layer, got {type(value).__name__}")
    check_all_finite(f"the alpha of {name}", value.alpha)
    check_all_finite(f"the premultiplied light of {name}", value.premultiplied)


def streak_of(alpha: Floats) -> Bools:
    """(H, W) True where the true alpha is above 0; ValueError if that is nowhere."""
    streak: Bools = alpha > 0
    if not streak.any():
        raise ValueError(f"true must hold a streak, got alpha up to {np.max(alpha):g}")
    return streak


def picture_size(picture: Floats) -> tuple[int, int]:
    """(width, height) of an (H, W, ...) array."""
    height, width = picture.shape[:2]
    return width, height

"""Linear maps of the plane: stretch, rotation, and change of shapes during the exposure.

A change has three rates (g, a, b), natural logarithms: after the fraction τ of the exposure it is the
map exp(τ G) with G = [[g + a, b], [b, g − a]].
"""

from typing import Any

import numpy as np

from blurmatte.checks import Array

_BY_A, _BY_B = np.array([[1.0, 0], [0, -1]]), np.array([[0, 1.0], [1, 0]])
_QUARTER = np.array([[0, -1.0], [1, 0]])  # of a turn, from +x towards +y


def exponential(a: Any, b: Any) -> tuple[Array, Array, Array]:
    """Exp S (..., 2, 2) with S = [[a, b], [b, −a]], and its derivatives by a and b.

    exp S = cosh m + S sinh(m)/m with m² = a² + b².
    """
    one, S = np.eye(2), a * _BY_A + b * _BY_B
    m = np.maximum(np.hypot(a, b), 1e-4)  # a smaller m changes lengths by 5e-9 of them
    even, odd = np.cosh(m), np.sinh(m) / m
    more = (even - odd) / m**2  # the derivative of `odd` by m²/2
    both = odd * one + more * S
    return even * one + odd * S, a * both + odd * _BY_A, b * both + odd * _BY_B


def changed(rates: Array, late: Array) -> tuple[Array, Array]:
    """Maps (T, 2, 2) of changes of some rates (3,), and their derivatives (T, 2, 2, 3) by the rates.

    `late` (T,) are τ, fractions of the exposure.
    """
    (g, a, b), late = rates, late[:, None, None]
    unit, by_a, by_b = exponential(a * late, b * late)
    larger = np.exp(g * late)
    maps = larger * unit
    return maps, late[..., None] * np.stack([maps, larger * by_a, larger * by_b], axis=3)


def turned(turn: float, late: Array, maps: Array, by: Array) -> tuple[Array, Array]:
    """Maps (T, 2, 2) and derivatives (T, 2, 2, 1 + l), turned by turn τ, the first by the turn.

    The turn is in radians from +x towards +y; `late` (T,) are τ, fractions of the exposure; `by`
    (T, 2, 2, l) are derivatives of the maps by some parameters.
    """
    late = late[:, None, None]
    rotation = np.cos(turn * late) * np.eye(2) + np.sin(turn * late) * _QUARTER
    maps = rotation @ maps
    by_turn = (late * (_QUARTER @ maps))[..., None]
    return maps, np.concatenate([by_turn, np.einsum("tij,tjkp->tikp", rotation, by)], axis=3)


def most_shrinking(rates: Array) -> float:
    """Largest logarithm by which a change shrinks a length in half an exposure, 0 or more."""
    return float(abs(rates[0]) + np.hypot(rates[1], rates[2])) / 2

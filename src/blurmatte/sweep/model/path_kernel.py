"""Points of paths, their derivatives by the parameters, and the sampling of time, compiled.

In this file p (n,) is the parameters of a path, as in the families of `path`: pixels, and times from 0
to 1. A path is its points xy (T, 2), pixels, at times t (T,), and D (T, 2, n)
their derivatives by p.
"""

import numpy as np

from blurmatte.compiling import njit


@njit()
def polynomial(p, weights, t):  # type: ignore[no-untyped-def]
    """Sums of points; weights (k, k) are the coefficients of theirs, a row for each power of t."""
    k = len(weights)
    xy, D = np.zeros((len(t), 2)), np.zeros((len(t), 2, 2 * k))
    for i in range(len(t)):
        for j in range(k):
            weight = 0.0
            for power in range(k - 1, -1, -1):
                weight = weight * t[i] + weights[power, j]
            for c in range(2):
                xy[i, c] += weight * p[2 * j + c]
                D[i, c, 2 * j + c] = weight
    return xy, D


@njit()
def arc(p, t):  # type: ignore[no-untyped-def]
    """A circle through start and end, its middle p[4] off the chord.

    Half of the arc turns by φ, tan(φ/2) = p[4] / half chord. In units of half the chord a point is at
    sin(φ s)/sin φ along it and (cos(φ s) − cos φ)/sin φ off it, s from −1 to 1; for small φ these tend
    to s and a parabola.
    """
    xy, D = np.empty((len(t), 2)), np.empty((len(t), 2, 5))
    half = ((p[2] - p[0]) / 2, (p[3] - p[1]) / 2)
    normal = (-half[1], half[0])
    length, off = np.sqrt(half[0] ** 2 + half[1] ** 2 + 1e-30), p[4]
    phi = 2 * np.arctan(off / length)
    by_off = 2 * length / (length**2 + off**2)
    by_length = -2 * off / (length**2 + off**2)
    for i in range(len(t)):
        s = 2 * t[i] - 1
        if abs(phi) < 1e-4:  # radians: a parabola to rounding
            along, across = s * (1 + phi**2 * (1 - s**2) / 6), phi * (1 - s**2) / 2
            more_along, more_across = s * phi * (1 - s**2) / 3, (1 - s**2) / 2
        else:
            sine, cosine = np.sin(phi), np.cos(phi)
            along, across = np.sin(phi * s) / sine, (np.cos(phi * s) - cosine) / sine
            more_along = (s * np.cos(phi * s) - along * cosine) / sine
            more_across = (sine - s * np.sin(phi * s) - across * cosine) / sine
        for c in range(2):
            turned = more_along * half[c] + more_across * normal[c]
            xy[i, c] = (p[c] + p[2 + c]) / 2 + along * half[c] + across * normal[c]
            D[i, c, 4] = turned * by_off
            for d in range(2):
                lengthened = turned * by_length * half[d] / (2 * length)
                moved = along / 2 if c == d else (across / 2 if c > d else -across / 2)
                D[i, c, d] = (0.5 if c == d else 0.0) - moved - lengthened
                D[i, c, 2 + d] = (0.5 if c == d else 0.0) + moved + lengthened
    return xy, D


@njit()
def bounce(p, contact, held, t):  # type: ignore[no-untyped-def]
    """Two straight pieces with the contact between; if `held`, its time cannot change."""
    xy, D = np.empty((len(t), 2)), np.zeros((len(t), 2, 7))
    for i in range(len(t)):
        first = t[i] < contact
        start, duration = (0, contact) if first else (2, 1 - contact)
        u = t[i] / contact if first else (t[i] - contact) / (1 - contact)
        for c in range(2):
            chord = p[start + 2 + c] - p[start + c]
            xy[i, c] = p[start + c] + u * chord
            D[i, c, start + c], D[i, c, start + 2 + c] = 1 - u, u
            if not held:
                D[i, c, 6] = (-u if first else u - 1) / duration * chord
    return xy, D


@njit()
def from_rest(p, departure, held, t):  # type: ignore[no-untyped-def]
    """At rest, then along a line; if `held`, the time of the departure cannot change."""
    xy, D = np.empty((len(t), 2)), np.zeros((len(t), 2, 5))
    for i in range(len(t)):
        u = max((t[i] - departure) / (1 - departure), 0.0)
        for c in range(2):
            chord = p[2 + c] - p[c]
            xy[i, c] = p[c] + u * chord
            D[i, c, c], D[i, c, 2 + c] = 1 - u, u
            if not held and t[i] > departure:
                D[i, c, 4] = (t[i] - 1) / (1 - departure) ** 2 * chord
    return xy, D


@njit()
def pieces(xy, extra, step, max_count):  # type: ignore[no-untyped-def]
    """Midpoints of pieces of the exposure and their durations, from points at even times.

    The number of pieces between two points is the length of this part or its longer neighbor, plus
    `extra`, over `step`; at most `max_count`.
    """
    parts = len(xy) - 1
    length, counts, total = np.empty(parts), np.empty(parts, np.int64), 0
    for i in range(parts):
        length[i] = np.hypot(xy[i + 1, 0] - xy[i, 0], xy[i + 1, 1] - xy[i, 1]) + extra
    for i in range(parts):
        longest = max(length[i], length[max(i - 1, 0)], length[min(i + 1, parts - 1)])
        counts[i] = max(int(min(np.ceil(longest / step), max_count)), 1)
        total += counts[i]
    t, lengths, n = np.empty(total), np.empty(total), 0
    for i in range(parts):
        for j in range(counts[i]):
            t[n] = (i + (j + 0.5) / counts[i]) / parts
            lengths[n] = 1 / (parts * counts[i])
            n += 1
    return t, lengths

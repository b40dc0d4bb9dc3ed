"""Compiled loops over frames and pixels; see `robust_mean`.

In this file x is the light of a pixel in a frame over the frame's gain, and m the mode of its frames.
The variance of x is s² λ: s² that of the noise model, λ the variance inflation at a restless place. The
distance of two lights is D = Σ (difference)² / variance over the channels: χ² with three degrees of
freedom if only noise is between them. Light below `MIN_SEEN` is that of pixels that a frame of a moving
camera does not show; they count neither for a mode nor against it.
"""

import numpy as np

from blurmatte.compiling import FAST_MATH, ONE, TWO, ZERO, njit

_NEAR = np.float32(16)  # D of agreeing lights; noise exceeds it once in 900 times
_CLOSE = np.float32(4)  # D of the densest samples: slowly moving light has fewer of them
_MIN_RIVAL_RATIO = np.float32(0.25)  # samples beyond the mode over those of it; else no rival
RIM_PX = 2  # around a moving object: its rim is fainter than the noise
UNSEEN = -8192.0  # light of pixels that a frame does not show; exact in half precision
MIN_SEEN = np.float32(-1024)  # that of any other, over its gain


@njit(inline="always", fastmath=FAST_MATH)
def variance_at(light, noise, channel):  # type: ignore[no-untyped-def]
    """σ² of a channel's light by the coefficients (9,) of a `NoiseModel`."""
    x = max(light, ZERO)
    return noise[3 * channel] + x * (noise[3 * channel + 1] + x * noise[3 * channel + 2])


@njit(inline="always", fastmath=FAST_MATH)
def _precision(light, noise, channel, spread):  # type: ignore[no-untyped-def]
    return ONE / (spread * variance_at(light, noise, channel))


@njit(fastmath=FAST_MATH)
def _smallest(values, rank):  # type: ignore[no-untyped-def]
    """The value of a rank, from 0; the values are overwritten."""
    for k in range(1, values.shape[0]):
        x, j = values[k], min(k, rank)
        if k > rank and x >= values[rank]:
            continue
        while j > 0 and values[j - 1] > x:
            values[j] = values[j - 1]
            j -= 1
        values[j] = x
    return values[rank]


@njit(inline="always", fastmath=FAST_MATH)
def _distance(x, y, noise):  # type: ignore[no-untyped-def]
    """D of two lights (3,) of one frame each."""
    D = ZERO
    for c in range(3):
        D += (y[c] - x[c]) ** 2 * _precision((x[c] + y[c]) / TWO, noise, c, TWO)
    return D


@njit(fastmath=FAST_MATH)
def find_restlessness(samples, noise, out):  # type: ignore[no-untyped-def]
    """Write λ: the lower 20 % quantile of D between consecutive samples over that of χ².

    samples is (K, n, 3), noise nine coefficients, out (n,). 1 for pixels that fewer than two show. The
    first sample follows the last: of three, both other pairs contain the middle one.
    """
    D = np.empty(samples.shape[0], np.float32)
    for i in range(samples.shape[1]):
        pairs, first, before = 0, -1, -1
        for k in range(samples.shape[0]):
            if samples[k, i, 0] < MIN_SEEN:
                continue
            if before >= 0:
                D[pairs] = _distance(samples[before, i], samples[k, i], noise)
                pairs += 1
            else:
                first = k
            before = k
        if pairs > 1:
            D[pairs] = _distance(samples[before, i], samples[first, i], noise)
            pairs += 1
        low = int(0.2 * pairs)  # a pixel that is rarely free has at least these
        out[i] = _smallest(D[:pairs], low) / np.float32(1.005) if pairs else ONE


@njit(fastmath=FAST_MATH)
def _best(x, y, z, count, noise, restless):  # type: ignore[no-untyped-def]
    """Index of the sample with the most others close to it."""
    best, most = 0, 0
    for i in range(count):
        a, b, c = x[i], y[i], z[i]
        u = _precision(a, noise, 0, TWO * restless)
        v = _precision(b, noise, 1, TWO * restless)
        w = _precision(c, noise, 2, TWO * restless)
        close = 0
        for j in range(count):
            d = (x[j] - a) ** 2 * u + (y[j] - b) ** 2 * v + (z[j] - c) ** 2 * w
            close += d <= _CLOSE
        if close > most:
            best, most = i, close
        if 2 * most > count:  # the majority: no other set is larger
            break
    return best


@njit(fastmath=FAST_MATH)
def _settle(x, y, z, count, noise, restless, at, far):  # type: ignore[no-untyped-def]
    """Mean of the samples near sample `at`, their number, and the number of the others.

    The others move to the front. The first mean is of those near a noisy sample: twice the variance.
    """
    a, b, c, near = x[at], y[at], z[at], 0
    for spread in (TWO, ONE, ONE):
        u = _precision(a, noise, 0, spread * restless)
        v = _precision(b, noise, 1, spread * restless)
        w = _precision(c, noise, 2, spread * restless)
        p, q, r, near = ZERO, ZERO, ZERO, 0
        for j in range(count):
            d = (x[j] - a) ** 2 * u + (y[j] - b) ** 2 * v + (z[j] - c) ** 2 * w
            far[j] = d > _NEAR
            if d <= _NEAR:
                p, q, r, near = p + x[j], q + y[j], r + z[j], near + 1
        if near == 0:
            break
        a, b, c = p / np.float32(near), q / np.float32(near), r / np.float32(near)
    left = 0
    for j in range(count):
        if far[j]:
            x[left], y[left], z[left] = x[j], y[j], z[j]
            left += 1
    return a, b, c, near, left


@njit(fastmath=FAST_MATH)
def find_modes(samples, noise, restless, mode, rival, near):  # type: ignore[no-untyped-def]
    """Write the mean of the densest samples of each pixel, and of the densest of the others.

    samples is (K, n, 3), noise nine coefficients, restless (n,) λ, mode and rival (n, 3), near (n,) the
    number of samples of the mode. The rival is -1 if hardly any others remain.
    """
    most = samples.shape[0]
    x, y, z = np.zeros(most, np.float32), np.zeros(most, np.float32), np.zeros(most, np.float32)
    far = np.empty(most, np.bool_)
    for i in range(samples.shape[1]):
        count, x[0], y[0], z[0] = 0, ZERO, ZERO, ZERO  # the light of pixels that no frame shows
        for k in range(most):
            if samples[k, i, 0] >= MIN_SEEN:
                x[count], y[count], z[count] = samples[k, i, 0], samples[k, i, 1], samples[k, i, 2]
                count += 1
        at = _best(x, y, z, count, noise, restless[i])
        a, b, c, n, left = _settle(x, y, z, count, noise, restless[i], at, far)
        mode[i, 0], mode[i, 1], mode[i, 2], near[i] = a, b, c, n
        rival[i, 0], rival[i, 1], rival[i, 2] = -ONE, -ONE, -ONE
        if left > _MIN_RIVAL_RATIO * n:
            at = _best(x, y, z, left, noise, restless[i])
            a, b, c, n, left = _settle(x, y, z, left, noise, restless[i], at, far)
            rival[i, 0], rival[i, 1], rival[i, 2] = a, b, c


@njit(fastmath=FAST_MATH)
def mark_off(light, gain, mode, precision, off):  # type: ignore[no-untyped-def]
    """Mark the pixels of a frame that disagree with the mode; light (n, 3), off (n,) uint8."""
    g, h, k = ONE / gain[0], ONE / gain[1], ONE / gain[2]
    for i in range(off.shape[0]):
        d = (
            (light[i, 0] * g - mode[i, 0]) ** 2 * precision[i, 0]
            + (light[i, 1] * h - mode[i, 1]) ** 2 * precision[i, 1]
            + (light[i, 2] * k - mode[i, 2]) ** 2 * precision[i, 2]
        )
        off[i] = d > _NEAR


@njit(fastmath=FAST_MATH)
def gather(light, gain, usable, modes, off, near, bit, sums, squares, counts):  # type: ignore[no-untyped-def]
    """Add a frame at its free pixels: those of the mode, outside rims.

    modes is (mode, precision, rival), (n, 3) each. sums and squares are (n, 3): of x − m, over a
    batch of frames and over all. counts is (n, 7): free frames of the batch and of the clip;
    clipped ones of these and ones close to the mode; frames close to the rival; frames that show it;
    the bits of the free frames.
    """
    mode, precision, rival = modes
    g, h, k = ONE / gain[0], ONE / gain[1], ONE / gain[2]
    for i in range(off.shape[0]):
        counts[i, 5] += light[i, 0] >= MIN_SEEN
        if off[i] and rival[i, 0] >= ZERO:
            d = (
                (light[i, 0] * g - rival[i, 0]) ** 2 * precision[i, 0]
                + (light[i, 1] * h - rival[i, 1]) ** 2 * precision[i, 1]
                + (light[i, 2] * k - rival[i, 2]) ** 2 * precision[i, 2]
            )
            counts[i, 4] += d <= _CLOSE
        if off[i] or near[i]:
            continue
        d0 = light[i, 0] * g - mode[i, 0]
        d1 = light[i, 1] * h - mode[i, 1]
        d2 = light[i, 2] * k - mode[i, 2]
        sums[i, 0], sums[i, 1], sums[i, 2] = sums[i, 0] + d0, sums[i, 1] + d1, sums[i, 2] + d2
        d0, d1, d2 = d0 * d0, d1 * d1, d2 * d2
        squares[i, 0] += d0
        squares[i, 1] += d1
        squares[i, 2] += d2
        counts[i, 0] += 1
        counts[i, 1] += 1
        counts[i, 2] += not usable[i]
        counts[i, 6] |= bit
        counts[i, 3] += d0 * precision[i, 0] + d1 * precision[i, 1] + d2 * precision[i, 2] <= _CLOSE


@njit(fastmath=FAST_MATH)
def close_batch(sums, counts, total, batch_squares, batch_products, batch_counts):  # type: ignore[no-untyped-def]
    """Add the sums S of a batch of n frames to Σ S, Σ S², Σ S n and Σ n², and reset them."""
    for i in range(sums.shape[0]):
        n = np.float32(counts[i, 0])
        for c in range(3):
            S = sums[i, c]
            total[i, c] += S
            batch_squares[i, c] += S * S
            batch_products[i, c] += S * n
            sums[i, c] = ZERO
        batch_counts[i] += n * n
        counts[i, 0] = 0

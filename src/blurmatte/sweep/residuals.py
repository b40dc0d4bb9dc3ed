"""What a sweep and a color model leave unexplained in each pixel, and its derivatives, compiled.

In this file P = C − (1 − α) B is the light that alpha leaves to the object and V = V_C + (1 − α)² V_B
the variance of its noise in each channel. N (3, 3 − r) and M (3, r) are orthonormal, M within the
model and N across it. Across it there is nothing but noise: with Q = N (NᵀVN)⁻¹Nᵀ and R = QP

    χ² = PᵀQP.

Half its gradient by P is R, but V depends on α too. That comes to the same as if the plate were
B̂ = B + (1 − α) V_B R, its best estimate given C: half the gradient by α is R·B̂. Without it every
sweep would be a little too large. P̂ = P − VR is the best estimate of P within the model. Turning M_j
towards N_i turns N_i towards −M_j, and half the gradient by that is −(N_i·R)(M_j·P̂). So gradients are
R·d and curvatures dᵀQd with d = B̂ for α and d = −(M_j·P̂) N_i for a turn.

Where the object hardly was, P̂ is but noise, and a whole picture of that would drown what the streak
says about the color. Its coordinates k̂ = MᵀP̂ have the variance W = Mᵀ(V − VQV)M. If the light is α
times colors of second moments K, the best estimate is k = α²K A⁻¹ k̂ with A = α²K + W, and its variance
α²K A⁻¹ W. Turns act on k instead of k̂, as if the light had been Mk + VR: then noise in k̂ and in R,
which are independent, is not multiplied with each other.
"""

from typing import Any

import numpy as np
from numba import njit

_COMPILED: dict[str, Any] = {"error_model": "numpy", "cache": True, "nogil": True}

_BEYOND = 4.0  # standard deviations by which light may seem negative, or too bright


@njit(**_COMPILED)
def _light(C, B, V_C, V_B, a, P, V):  # type: ignore[no-untyped-def]
    """Write P and V of one pixel."""
    for c in range(3):
        P[c] = C[c] - (1 - a) * B[c]
        V[c] = V_C[c] + (1 - a) * (1 - a) * V_B[c]


@njit(**_COMPILED)
def _sums(P, V, N):  # type: ignore[no-untyped-def]
    """NᵀVN as s, t, u and NᵀP as p, q; of a plane t = q = 0 and u = 1."""
    s, t, u, p, q = 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(3):
        s += V[c] * N[c, 0] * N[c, 0]
        p += N[c, 0] * P[c]
    if N.shape[1] == 1:
        return s, 0.0, 1.0, p, 0.0
    for c in range(3):
        t += V[c] * N[c, 0] * N[c, 1]
        u += V[c] * N[c, 1] * N[c, 1]
        q += N[c, 1] * P[c]
    return s, t, u, p, q


@njit(**_COMPILED)
def _whitened(s, t, u, p, q):  # type: ignore[no-untyped-def]
    """The one or two residuals of unit variance whose squares sum to χ², of these sums."""
    return p / np.sqrt(s), (q - t / s * p) / np.sqrt(u - t * t / s)


@njit(**_COMPILED)
def _across(P, V, N, Q, R):  # type: ignore[no-untyped-def]
    """Write Q and R; return the residuals."""
    s, t, u, p, q = _sums(P, V, N)
    det = s * u - t * t
    for c in range(3):
        x, y = u * N[c, 0] / det, 0.0
        if N.shape[1] == 2:
            x, y = (u * N[c, 0] - t * N[c, 1]) / det, (s * N[c, 1] - t * N[c, 0]) / det
        R[c] = x * p + y * q
        for d in range(3):
            Q[c, d] = x * N[d, 0] + (y * N[d, 1] if N.shape[1] == 2 else 0.0)
    return _whitened(s, t, u, p, q)


@njit(**_COMPILED)
def _beyond(P, V, main, most):  # type: ignore[no-untyped-def]
    """How far light along a color is below 0 or above `most`, beyond what noise does; its deviation."""
    along, s = 0.0, 0.0
    for c in range(3):
        along += main[c] * P[c]
        s += V[c] * main[c] * main[c]
    s = np.sqrt(s)
    return min(along / s + _BEYOND, 0.0) + max((along - most) / s - _BEYOND, 0.0), s


@njit(**_COMPILED)
def _within(P, V, Q, R, M, k, W):  # type: ignore[no-untyped-def]
    """Write k̂ and its variance W, padded to two dimensions."""
    k[1], W[0, 1], W[1, 0], W[1, 1] = 0.0, 0.0, 0.0, 1.0
    for i in range(M.shape[1]):
        k[i] = 0.0
        for c in range(3):
            k[i] += M[c, i] * (P[c] - V[c] * R[c])
        for j in range(M.shape[1]):
            w = 0.0
            for c in range(3):
                w += M[c, i] * V[c] * M[c, j]
                for d in range(3):
                    w -= M[c, i] * V[c] * Q[c, d] * V[d] * M[d, j]
            W[i, j] = w


@njit(**_COMPILED)
def _inverse(K, a, W, A):  # type: ignore[no-untyped-def]
    """Write A⁻¹ of A = α²K + W."""
    p, q, r = a * a * K[0, 0] + W[0, 0], a * a * K[0, 1] + W[0, 1], a * a * K[1, 1] + W[1, 1]
    det = p * r - q * q
    A[0, 0], A[0, 1], A[1, 0], A[1, 1] = r / det, -q / det, -q / det, p / det


@njit(**_COMPILED)
def residuals(C, B, V_C, V_B, alpha, N, main, most, e):  # type: ignore[no-untyped-def]
    """Write residuals e (3, h, w) of unit variance: two across the model, one of impossible light.

    Light along the color `main` is neither negative nor more than alpha times `most`.
    """
    P, V = np.empty(3), np.empty(3)
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            _light(C[y, x], B[y, x], V_C[y, x], V_B[y, x], alpha[y, x], P, V)
            e[0, y, x], e[1, y, x] = _whitened(*_sums(P, V, N))
            e[2, y, x], _ = _beyond(P, V, main, alpha[y, x] * most)


@njit(**_COMPILED)
def second_moments(C, B, V_C, V_B, alpha, weights, N, M):  # type: ignore[no-untyped-def]
    """Mean of k̂k̂ᵀ − W over that of α², (2, 2): K of the object's colors, seen within the model."""
    P, V, R, Q = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    k, W, K, total = np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2)), 0.0
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            a = alpha[y, x]
            weight = weights[y, x] * a * a
            if weight == 0:
                continue
            _light(C[y, x], B[y, x], V_C[y, x], V_B[y, x], a, P, V)
            _across(P, V, N, Q, R)
            _within(P, V, Q, R, M, k, W)
            total += weight * a * a
            for i in range(M.shape[1]):
                for j in range(M.shape[1]):
                    K[i, j] += weight * (k[i] * k[j] - W[i, j])
    return K / max(total, 1e-30)


@njit(**_COMPILED)
def _kept(k, W, K, a, A, kept):  # type: ignore[no-untyped-def]
    """Write A⁻¹ and k, the best estimate of light."""
    _inverse(K, a, W, A)
    for i in range(2):
        kept[i] = 0.0
        for j in range(2):
            kept[i] += a * a * (K[i, 0] * A[0, j] + K[i, 1] * A[1, j]) * k[j]


@njit(**_COMPILED)
def _feigned_of_line(P, V, M, power, turned):  # type: ignore[no-untyped-def]
    """What `feigned_by_noise` adds for a pixel with light of this power along a line that turns.

    Across l there is χ² = P·P − (l·P)²/(l·l) left, with products weighted by 1/V. k̂ = l·P/(l·l) has
    the variance 1/(l·l), and all of it but the best estimate, k̂ − k, is noise.
    """
    ll, lp, tt, tp, tl = 0.0, 0.0, 0.0, 0.0, 0.0
    for c in range(3):
        l, t, u = M[c, 0], turned[c], 1 / V[c]
        ll += u * l * l
        lp += u * l * P[c]
        tt += u * t * t
        tp += u * t * P[c]
        tl += u * t * l
    noise = lp / (ll * (1 + power * ll))
    rest = tp - noise * tl
    return noise * (noise * ll - 2 * lp) + (tp * tp - rest * rest) / tt


@njit(**_COMPILED)
def feigned_by_noise(C, B, V_C, V_B, alpha, weights, N, M, K, main, most, turned):  # type: ignore[no-untyped-def]
    """By how much a turn of N to `turned` lowers the sum of squares only because k̂ has noise.

    Impossible light is no noise.
    """
    P, V, R, Q = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    k, W, A, total = np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2)), 0.0
    kept, best = np.zeros(2), np.empty(3)
    pole = np.cross(turned[:, 0], turned[:, 1]) if turned.shape[1] == 2 else turned[:, 0]
    for y in range(alpha.shape[0]):
        for x in range(alpha.shape[1]):
            if weights[y, x] == 0:
                continue
            _light(C[y, x], B[y, x], V_C[y, x], V_B[y, x], alpha[y, x], P, V)
            beyond, _ = _beyond(P, V, main, alpha[y, x] * most)
            if beyond != 0:
                continue
            if M.shape[1] == 1:
                total += weights[y, x] * _feigned_of_line(P, V, M, alpha[y, x] ** 2 * K[0, 0], pole)
                continue
            _across(P, V, N, Q, R)
            _within(P, V, Q, R, M, k, W)
            _kept(k, W, K, alpha[y, x], A, kept)
            for c in range(3):
                best[c] = V[c] * R[c]
                for i in range(M.shape[1]):
                    best[c] += M[c, i] * kept[i]
            e, f = _across(best, V, turned, Q, R)
            total += weights[y, x] * (e * e + f * f)
            e, f = _across(P, V, turned, Q, R)
            total -= weights[y, x] * (e * e + f * f)
    return total


@njit(**_COMPILED)
def normal_equations(J, C, B, V_C, V_B, alpha, weights, bend, N, M, K, main, most):  # type: ignore[no-untyped-def]
    """Half the curvature (n + 2, n + 2) and gradient (n + 2,) of a sum of squares.

    Of the curvature `bend` (h, w) times the square of each pixel's gradient is taken off. J (h, w, n)
    are derivatives of alpha, 0 in most pixels; the last two parameters are the turns of M_j towards
    N_i, i first. K is (2, 2), 0 beyond the rank.
    """
    h, w, n = J.shape
    H, g = np.zeros((n + 2, n + 2)), np.zeros(n + 2)
    P, V, R, Q = np.empty(3), np.empty(3), np.empty(3), np.empty((3, 3))
    k, W, A = np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2))
    QB, kept, S, NQN = np.empty(3), np.zeros(2), np.zeros((2, 2)), np.zeros((2, 2))
    turn_beyond, slopes = np.zeros(2), np.zeros(2)
    rank = M.shape[1]
    for y in range(h):
        for x in range(w):
            weight, a = weights[y, x], alpha[y, x]
            if weight == 0:
                continue
            _light(C[y, x], B[y, x], V_C[y, x], V_B[y, x], a, P, V)
            beyond, s = _beyond(P, V, main, a * most)
            if a == 0 and beyond == 0:
                continue  # neither alpha nor light that could turn the color
            _across(P, V, N, Q, R)
            _within(P, V, Q, R, M, k, W)
            if beyond != 0:  # impossible light is no noise
                W[:] = 0.0
                kept[:] = k
            else:
                _kept(k, W, K, a, A, kept)
            for i in range(2):
                for j in range(2):
                    S[i, j] = 0.0
                    for m in range(2):
                        S[i, j] += a * a * (K[i, 0] * A[0, m] + K[i, 1] * A[1, m]) * W[m, j]
            for i in range(N.shape[1]):
                for j in range(N.shape[1]):
                    NQN[i, j] = 0.0
                    for c in range(3):
                        for d in range(3):
                            NQN[i, j] += N[c, i] * Q[c, d] * N[d, j]
            for c in range(3):
                QB[c] = 0.0
                for d in range(3):
                    QB[c] += Q[c, d] * (B[y, x, d] + (1 - a) * V_B[y, x, d] * R[d])
            by_light = -most / s if beyond > 0 else 0.0
            aa, ae = 0.0, 0.0
            for c in range(3):
                behind = B[y, x, c] + (1 - a) * V_B[y, x, c] * R[c]
                aa += behind * QB[c]
                ae += R[c] * behind
                by_light += main[c] * B[y, x, c] / s
            if beyond != 0:
                aa += by_light * by_light
                ae += by_light * beyond
            aa -= bend[y, x] * ae * ae
            for t in range(2):
                i, j = t // rank, t % rank
                ne, nb, np_, mm = 0.0, 0.0, 0.0, 0.0
                for c in range(3):
                    ne += N[c, i] * R[c]
                    nb += N[c, i] * QB[c]
                    np_ += N[c, i] * P[c] / s
                    mm += M[c, j] * main[c]
                turn_beyond[t] = mm * np_ if beyond != 0 else 0.0
                gradient = turn_beyond[t] * beyond - kept[j] * ne
                slopes[t] = gradient
                cross = turn_beyond[t] * by_light - kept[j] * nb - bend[y, x] * gradient * ae
                g[n + t] += weight * gradient
                for p in range(n):
                    if J[y, x, p] != 0:
                        H[n + t, p] += weight * cross * J[y, x, p]
                for v in range(t + 1):
                    b, c = v // rank, v % rank
                    curvature = NQN[i, b] * (kept[j] * kept[c] + S[j, c])
                    curvature += turn_beyond[t] * turn_beyond[v]
                    curvature -= bend[y, x] * slopes[t] * slopes[v]
                    H[n + t, n + v] += weight * curvature
            for p in range(n):
                slope = weight * J[y, x, p]
                if slope != 0:
                    g[p] += ae * slope
                    for q in range(p + 1):
                        H[p, q] += aa * slope * J[y, x, q]
    for p in range(n + 2):
        for q in range(p):
            H[q, p] = H[p, q]
    return H, g

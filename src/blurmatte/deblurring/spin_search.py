"""Search for the spin of a ball: the evidence of rotations on a coarse lattice, without start values.

In this file P is the premultiplied light of blocks of pixels and W its inverse variance. With the
rotation vector ω, the light is that of a texture o that turns with the ball and of a field β on it that
does not, its shading,

    P = A(ω) o + C β + G h + noise,

where C has the harmonics of `spin` as columns. Shading is a factor of the texture: an estimate of it is
in A, and C β is a first-order model of its error. Highlights h are white, the same in all channels, at
nodes of a lattice that does not turn. All are marginalized, o with the prior exp(−λ oᵀ Q o / 2) of
`priors`, β and h with independent normal priors; log Z(ω) follows from a Cholesky factor of the
equations of the nodes and Schur complements for β and h.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Literal

import numpy as np
import scipy

from blurmatte.checks import Array, Bools
from blurmatte.deblurring import sphere_kernel
from blurmatte.deblurring.lattice import COARSE_STEP_PX, Sphere
from blurmatte.deblurring.operator import (
    Entries,
    SeenMoments,
    Sparse,
    poses_of,
    row_sums,
    seen_moments,
    sparse,
)
from blurmatte.deblurring.priors import Differences
from blurmatte.deblurring.spin import Spin, harmonics
from blurmatte.deblurring.view import View
from blurmatte.descent import descended, distinct

# Grid, lattice and climbs of the search; angles in radians.
NODES_PER_RADIUS = 5
_MAX_ROTATION = np.pi  # radians per exposure
SPACING = np.radians(28)  # of the grid of rotations: maxima of log Z are about 30° wide
_MAX_STEP = np.radians(12)  # of a climb
_MIN_GAIN = 3.0  # of log Z, by a step
_MAX_STEPS = 10  # of a climb
_NEAR = np.radians(15)  # starts that are nearer are one
_SAME_MODE = np.radians(8)  # maxima that are nearer are one
_MAX_MODES = 2  # of each contrast
_GLOSS_CELLS = 5  # of the lattice of highlights, 18° each
_GLOSS_STD = 0.1  # of highlights at a node, linear light
_FIELD_STD = 0.2  # of the coefficients of shading, linear light
CONTRASTS = 0.4, 0.15, 0.05  # of neighbors of the coarse lattice, linear light


@dataclass(frozen=True, eq=False)
class Solved:
    """The most probable texture (n, 3), field (k, 3) and highlights, and what they derive from.

    The rotation vector (3,) is in radians per exposure; the log evidence is up to a constant of the
    search.
    """

    rotation: Array
    log_evidence: float
    noise_scale: float
    factor: Array
    texture: Array
    field: Array
    coupling: Array
    schur: Array
    gloss: Array | None = None

    @property
    def cost(self) -> float:
        """Minus the log evidence."""
        return -self.log_evidence


@dataclass(frozen=True, eq=False)
class Search:
    """Blocks of pixels of one picture, and when they see which part of the ball.

    Parameters
    ----------
    sphere : Sphere
    t : (T,) float
        Moments.
    entries : tuple
        Of m blocks, as arguments of the kernels: the first entry of each (m + 1,); moment, part of the
        exposure (q,) and normal (q, 1, 3) in the middle of the block of each entry.
    P : (m, 3) float
        Premultiplied light of each block.
    W : (m,) float
        Its inverse variance, the same for all channels.
    """

    sphere: Sphere
    t: Array
    entries: Entries
    P: Array
    W: Array

    @classmethod
    def of(cls, view: View, weight: Array | None = None) -> "Search":
        """The search at the path and shading of a view with a spin: its channels have one weight.

        Evidences of two paths compare under the same weight (h w, 1).
        """
        sweep = view.sweep
        fastest = replace(view, spin=Spin(np.array([0, 0, _MAX_ROTATION])))
        count = fastest.moment_count(COARSE_STEP_PX)
        poses = poses_of(sweep, count=count)
        seen = seen_moments(sweep, view.pixels, poses)
        alpha = seen.alpha(poses.durations)
        weight = (view.weight(alpha) if weight is None else weight)[:, 0]
        use = weight > 0
        sphere = Sphere.of(sweep.radius, sweep.radius / NODES_PER_RADIUS)
        entries = _entries(seen, use, count, view.spin)
        return cls(sphere, poses.t, entries, view.light(alpha)[use], weight[use])

    @cached_property
    def prior(self) -> Array:
        """(n, n) Q."""
        differences = Differences(self.sphere.size, self.sphere.stencils)
        return np.asarray(differences.quadratic(differences.weights(np.ones(1))).toarray())

    @cached_property
    def C(self) -> Array:
        """(m, k) light of the harmonics."""
        first, _, weight, normal = self.entries
        return row_sums(first, weight, harmonics(normal[:, 0]))

    @cached_property
    def G(self) -> Array:
        """(m, k) light of white highlights at the nodes that are visible."""
        dense = self._rows(np.zeros(3), Sphere.of(1.0, np.pi / 2 / _GLOSS_CELLS)).toarray()
        return np.asarray(dense[:, dense.any(axis=0)])

    def operator(self, rotation: Array) -> Sparse:
        """A(ω)."""
        return self._rows(rotation, self.sphere)

    def _rows(self, rotation: Array, sphere: Sphere) -> Sparse:
        """From a color at the nodes of a sphere to the light of the blocks."""
        turns = Spin(rotation).turns(self.t)
        rows = sphere_kernel.rows_of(self.entries, turns, sphere.node, sphere.size)
        return sparse(rows, sphere.size)

    def _equations(self, rotation: Array, contrast: float, light: Array) -> tuple[Array, Array]:
        """Upper triangle of AᵀWA + λ Q (n, n), and AᵀW times light (m, k)."""
        N, right = contrast**-2 * self.prior, np.zeros((self.sphere.size, light.shape[1]))
        turns, weighted = Spin(rotation).turns(self.t), self.W[:, None] * light
        sphere_kernel.add_equations(
            self.entries, turns, self.sphere.node, self.W, weighted, N, right
        )
        return N, right

    def solved(self, rotation: Array, contrasts: Sequence[float]) -> list[Solved]:
        """The marginal likelihood of a rotation, for each of some contrasts of the texture."""
        N, right = self._equations(rotation, contrasts[0], np.hstack([self.C, self.P]))
        matrices = [N + (c**-2 - contrasts[0] ** -2) * self.prior for c in contrasts[1:]]
        pairs = zip([N, *matrices], contrasts, strict=True)
        return [self._solved(rotation, matrix, right, contrast) for matrix, contrast in pairs]

    def _solved(self, rotation: Array, matrix: Array, right: Array, contrast: float) -> Solved:
        """The marginal likelihood for a contrast; the upper triangle of the matrix is overwritten."""
        factor, _ = scipy.linalg.lapack.dpotrf(matrix.T, lower=1, overwrite_a=1, clean=0)
        light, field, k = self.W[:, None] * self.P, self.W[:, None] * self.C, self.C.shape[1]
        right = _whitened(factor, right)
        coupling, texture = right[:, :k], right[:, k:]
        schur = self.C.T @ field + np.eye(k) / _FIELD_STD**2 - coupling.T @ coupling
        of_field = self.C.T @ light - coupling.T @ texture
        beta = np.asarray(np.linalg.solve(schur, of_field), float)
        misfit = float((light * self.P).sum() - (texture**2).sum() - (of_field * beta).sum())
        texture = texture - coupling @ beta
        texture = _whitened(factor, texture, transposed=1)
        freedom, nodes = len(self.P) - 1, self.sphere.size - 1
        volume = 2 * np.log(np.diag(factor)).sum() + np.linalg.slogdet(schur)[1]
        log_z = 1.5 * (-2 * nodes * np.log(contrast) - freedom * np.log(misfit) - volume)
        scale = misfit / (3 * freedom)
        return Solved(rotation, float(log_z), scale, factor, texture, beta, coupling, schur)

    def glossy(self, rotation: Array, contrast: float) -> Solved:
        """`solved` with highlights."""
        k = self.C.shape[1] + 3
        N, right = self._equations(rotation, contrast, np.hstack([self.C, self.P, self.G]))
        at, light = self._solved(rotation, N, right[:, :k], contrast), self.W[:, None] * self.G
        of_nodes = _whitened(at.factor, right[:, k:])
        field_light = self.C.T @ light
        of_field = field_light - at.coupling.T @ of_nodes
        schur = self.G.T @ light - of_nodes.T @ of_nodes
        schur = 3 * (schur - of_field.T @ np.linalg.solve(at.schur, of_field))
        schur += np.eye(len(schur)) / _GLOSS_STD**2
        own = light.T @ self.P - right[:, k:].T @ at.texture - field_light.T @ at.field
        right = own.sum(axis=1)
        found = np.linalg.solve(schur, right)
        freedom = 3 * (len(self.P) - 1)
        before = freedom * at.noise_scale
        after = before - float(right @ found)
        gain = -freedom * np.log(after / before) - np.linalg.slogdet(_GLOSS_STD**2 * schur)[1]
        texture, field = _without(at, of_nodes @ found, of_field @ found)
        return replace(
            at,
            log_evidence=at.log_evidence + float(gain) / 2,
            noise_scale=after / freedom,
            texture=texture,
            field=field,
            gloss=found,
        )

    def information(self, at: Solved) -> tuple[Array, Array]:
        """Curvature (3, 3) and gradient (3,) of −log Z(ω), without the change of volume."""
        spin = Spin(at.rotation)
        J = sphere_kernel.turned(
            *(self.entries, spin.turns(self.t), spin.jacobians(self.t)),
            *(self.sphere.node, at.texture),
        ).reshape(len(self.P), 9)  # (channel, parameter)
        A = self.operator(at.rotation)
        r = self.P - A @ at.texture - self.C @ at.field
        r -= 0 if at.gloss is None else (self.G @ at.gloss)[:, None]
        weighted = self.W[:, None] * J
        of_nodes = _whitened(at.factor, A.T @ weighted)
        of_field = self.C.T @ weighted - at.coupling.T @ of_nodes
        full = J.T @ weighted - of_nodes.T @ of_nodes
        full -= of_field.T @ np.linalg.solve(at.schur, of_field)
        H = sum(full[3 * c : 3 * c + 3, 3 * c : 3 * c + 3] for c in range(3))
        g = np.einsum("pck,pc->k", weighted.reshape(-1, 3, 3), r)
        return np.asarray(H / at.noise_scale), -g / at.noise_scale

    def climbed(self, rotation: Array, contrast: float) -> Solved:
        """The maximum of the evidence near a rotation."""

        def moved(at: Solved, step: Array) -> Solved:
            """After a step of at most 12°."""
            step = step * min(1, _MAX_STEP / max(float(np.linalg.norm(step)), 1e-12))
            return self.glossy(at.rotation + step, contrast)

        start = self.glossy(rotation, contrast)
        end, _ = descended(start, self.information, moved, _MAX_STEPS, _MIN_GAIN)
        return end

    def ranked(self, rotations: Iterable[Array]) -> list[Array]:
        """Rotations by their evidence without highlights, the likeliest first."""
        return sorted(rotations, key=lambda w: self.solved(w, CONTRASTS[1:2])[0].cost)

    def _maxima(self, starts: Iterable[Array], contrast: float) -> list[Array]:
        """Rotations of distinct maxima of the evidence near some, the likeliest first."""
        found = sorted((self.climbed(w, contrast) for w in starts), key=lambda one: one.cost)
        return distinct([one.rotation for one in found], are_near)

    def modes(self, ranked: Sequence[Array], around: Array, starts: int) -> list[Array]:
        """Rotations of distinct maxima of the evidence: the likeliest of each contrast of the texture.

        The largest contrast may explain errors of path and shading as texture of a fast spin, and a
        small one misses fine texture. Maxima for the middle contrast are starts for the others. Further
        starts than the `starts` likeliest of the grid are `around` a rotation, whose maximum may be
        narrower than the grid.
        """
        near = (around + sign * _NEAR * axis for axis in np.eye(3) for sign in (-1, 1))
        middle = self._maxima([*ranked[:starts], around, *near], CONTRASTS[1])
        likeliest = middle[:_MAX_MODES]
        for contrast in (CONTRASTS[0], CONTRASTS[2]):
            likeliest += self._maxima(middle, contrast)[:_MAX_MODES]
        return distinct(likeliest, are_near)


def _without(at: Solved, of_nodes: Array, of_field: Array) -> tuple[Array, Array]:
    """Texture and field for the light less that of highlights, with these projections."""
    change = np.linalg.solve(at.schur, of_field)
    nodes = _whitened(at.factor, of_nodes - at.coupling @ change, transposed=1)
    return at.texture - nodes[:, None], at.field - change[:, None]


def _whitened(factor: Array, right: Array, transposed: Literal[0, 1] = 0) -> Array:
    """L⁻¹ or L⁻ᵀ of a Cholesky factor times columns."""
    return np.asarray(
        scipy.linalg.solve_triangular(
            factor, right, lower=True, trans=transposed, check_finite=False
        )
    )


def rotation_grid(spacing: float) -> Array:
    """(n, 3) rotation vectors up to half a turn on a body-centered cubic lattice."""
    edge = spacing * 2 ** (1 / 3)  # of a cube with two points
    steps = np.arange(-int(_MAX_ROTATION / edge) - 1, int(_MAX_ROTATION / edge) + 2)
    corners = np.stack(np.meshgrid(steps, steps, steps), axis=-1).reshape(-1, 3)
    points = edge * np.concatenate([corners, corners + 0.5])
    return np.asarray(points[np.linalg.norm(points, axis=1) <= _MAX_ROTATION])


def are_near(one: Array, other: Array) -> bool:
    """Whether two rotations are of one maximum."""
    return bool(np.linalg.norm(one - other) <= _SAME_MODE)


def _entries(seen: SeenMoments, use: Bools, count: int, spin: Spin | None) -> Entries:
    """First entries of the blocks in use; moment, weight and normals of their entries."""
    first, moment, part = seen.covered
    each = np.diff(first)
    kept = np.repeat(use, each)
    begin = np.concatenate([[0], np.cumsum(each[use])]).astype(np.int64)
    normal = seen.normals[kept].mean(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    light = 1.0 if spin is None else spin.light(normal)
    return begin, moment[kept], part[kept] * light / count, normal[:, None]

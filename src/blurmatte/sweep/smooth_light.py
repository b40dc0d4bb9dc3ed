"""What alpha would be if the object's light changed little from place to place, whatever its colors.

The sweep leaves the brightness of each pixel free, or all of a plane of colors: a wrong alpha adds the
plate to the object's light, outline, texture and all, and nothing is left over. But what is painted on
a thing is smeared by its motion. This asks the part of the picture that the sweep does not.
"""

from dataclasses import dataclass

import numpy as np

from blurmatte.sweep.data import Data
from blurmatte.sweep.descent import State, light_of, seen
from blurmatte.sweep.field import Grid, field_of
from blurmatte.sweep.student import belief
from blurmatte.sweep.verdict import OPAQUE, coherence_of_noise

_RADIUS = 20.0  # pixels: enough to tell what a fifth of it does
_TOLD = 0.03  # of alpha, what must be told
_PAINTED = 3.0  # mean square that right sweeps leave: a field is not all that is painted on things


@dataclass(frozen=True)
class SmoothLight:
    """What smooth light says against a sweep.

    Parameters
    ----------
    share : float
        Of the places in which it would tell a wrong alpha.
    astray_of_places : float
        How wrong it finds alpha there, root mean square, beyond what noise and paint leave of the right
        one; the sweep's alpha of each place is 1.
    astray : float
        The same if the usual alpha of the sweep is 1, so that faint ends hardly count.
    """

    share: float
    astray_of_places: float
    astray: float


def smooth_light(data: Data, state: State) -> SmoothLight:
    """Ask it; the object may have any color at each node of a field, neighbors need not be alike."""
    coarse = data.coarse_enough(float(state.shape[0]), _RADIUS)
    if coarse is not data:
        data, state = coarse, seen(coarse, state)
    light, alpha = light_of(data), state.swept.alpha
    field = field_of(light, alpha, data.weight, data.pitch, alike=False)
    e = field.residuals(light, alpha)
    seen_through = np.where(alpha < OPAQUE, alpha, 0)
    place = 2 * data.pitch
    J = Grid.over(seen_through, place).hats(seen_through)
    H, g = field.information(J, light, alpha, data.weight * belief((e**2).sum(axis=0)), e)
    information = np.diag(H)
    told = information > _TOLD**-2
    if not told.any():
        return SmoothLight(0.0, 0.0, 0.0)
    z2 = g[told] ** 2 / information[told]
    noise = max(coherence_of_noise(data, state, place), _PAINTED)
    beyond = max(float(np.sum(z2 - noise)), 0.0)
    hats = J[..., told]
    local = np.einsum("yxj,yx->j", hats, alpha) / hats.sum(axis=(0, 1))
    usual = np.mean(alpha[alpha > 0] ** 2)
    by_place, by_usual = (np.sum(information[told] * unit) for unit in (local**2, usual))
    return SmoothLight(
        float(np.mean(told)),
        float(np.sqrt(beyond / by_place)),
        float(np.sqrt(beyond / by_usual)),
    )

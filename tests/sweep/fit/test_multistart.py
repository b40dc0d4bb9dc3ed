"""Where descents begin, and when nothing else is begun with."""

import numpy as np

from blurmatte.radiometry import with_noise
from blurmatte.rendering import Ball, Camera, Scene, Sheet, Shot, plain_plate, render
from blurmatte.streaks import require_streaks
from blurmatte.sweep.fit.levenberg_marquardt import ROUGHLY, descend, seen
from blurmatte.sweep.fit.multistart import FAMILIES, Search
from blurmatte.trajectory import Trajectory

SIZE = (200, 140)
GRAY = plain_plate(SIZE, (0.4, 0.4, 0.4), 4)
WAY = Trajectory.line((62, 50), (130, 84))
BLUE = np.array([0.15, 0.35, 0.7])


def searched(body, quality=None):
    scene = Scene(GRAY, WAY, body)
    shot = Shot(scene, Camera(code_std=1.5 / 255, jpeg_quality=quality))
    pictures = with_noise(*shot.photograph(render(scene, 160)))
    return Search.of(require_streaks(*pictures)[0], *pictures, None)


def begun_with(search, monkeypatch):
    """How many families are asked from each curve and radius, the last one the best path's."""
    asked, ends = [], Search._ends

    def counted(self, curve, radius, rank, families=None):
        found = ends(self, curve, radius, rank, families)
        asked.append(len({state.family for state in found}))
        return found

    monkeypatch.setattr(Search, "_ends", counted)
    best = search.best(1)
    return asked, best


def test_what_is_explained_is_asked_only_for_its_own_family(monkeypatch):
    """invariant"""
    asked, _ = begun_with(searched(Ball(16, BLUE)), monkeypatch)
    assert asked == [len(FAMILIES), 1, 1, 1, len(FAMILIES)]


def test_where_all_end_alike_from_two_radii_no_third_is_tried(monkeypatch):
    """invariant: no disc explains a square, and yet there is one that fits it best."""
    search = searched(Sheet(30, 30, BLUE))
    asked, best = begun_with(search, monkeypatch)
    assert asked == [len(FAMILIES)] * 3
    rough = descend(search.coarse, seen(search.coarse, best), search.bounds, enough=ROUGHLY)
    for curve, radius in search.curves[2:]:
        others = search._ends(curve, radius, 1)
        assert min(state.cost for state in others if state.family is best.family) > rough.cost - 1

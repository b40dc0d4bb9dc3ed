import numpy as np

from blurmatte.streaks import Streak, joined_behind


def test_a_streak_goes_on_behind_an_occluder():
    """exact: two parts on both sides of a post are one, a third one elsewhere is not."""
    parts = [Streak.from_box(box, (80, 40)) for box in
             ((10, 10, 30, 20), (40, 12, 60, 22), (10, 34, 14, 38))]  # fmt: skip
    occluder = np.zeros((40, 80), bool)
    occluder[:, 30:40] = True
    joined = joined_behind(parts, occluder)
    assert [s.box[::2] for s in joined] == [(10, 60), (10, 14)]
    assert joined[0].mask[15, 30:40].all()
    assert not joined[0].mask[30:, 30:40].any()
    assert [s.box for s in joined_behind(parts, np.zeros_like(occluder))] == [s.box for s in parts]

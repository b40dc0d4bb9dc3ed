"""What is said against an end of a search."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.radiometry import SRGB, LinearImage, with_noise
from blurmatte.rendering import Ball, Camera, Scene, Shot, colorful_plate, render
from blurmatte.streaks import require_streaks
from blurmatte.sweep.fit.ranking import CLEARLY, price
from blurmatte.sweep.fit.levenberg_marquardt import seen, state_at
from blurmatte.sweep.end import End
from blurmatte.sweep.frame import Frame
from blurmatte.sweep.freer import if_it_changes, if_not_round
from blurmatte.sweep.highlight import Highlight
from blurmatte.sweep.fit.multistart import Search
from blurmatte.sweep.smooth_light import smooth_light
from blurmatte.sweep.model.student_t import VARIANCE
from blurmatte.sweep.model.residual_statistics import MAX_MISFIT, coherence, overstated
from blurmatte.trajectory import Trajectory

PATH = Trajectory.line((44, 42), (112, 68))
PLATE = colorful_plate((160, 112), 2, tile=20)
GREEN = (0.25, 0.7, 0.12)


def search_of(body, **camera):
    """The search for an object that went along, as a camera takes it."""
    scene = Scene(PLATE, PATH, body)
    shot = Shot(scene, Camera(code_std=1.5 / 255, **camera), plate_frames=3, seed=1)
    image, plate = with_noise(*shot.photograph(render(scene, 160)))
    return Search.of(require_streaks(image, plate)[0], image, plate, None)


def told(end, share):
    """An end of which smooth light would tell a wrong alpha in this share of the places."""
    said = replace(smooth_light(end.search.data, end.state), share=share, astray_of_places=0.0)
    fresh = replace(end, state=replace(end.state))
    fresh.__dict__["_said"] = said
    return fresh


@pytest.fixture(scope="module")
def as_noise():
    search = search_of(Ball(11, GREEN))
    return End(search, search.best(1))


@pytest.fixture(scope="module")
def hangs_together():
    """Of two paints, told as one in a compressed picture: what that leaves is no noise."""
    search = search_of(Ball(11, GREEN, second_color=(0.3, 0.6, 0.25)), jpeg_quality=90)
    return End(search, search.best(1))


def test_what_leaves_but_noise_needs_no_other_to_tell_it(as_noise):
    assert coherence(as_noise.search.data, as_noise.state) < 2
    for share in (0.0, 0.15, 0.3):
        assert told(as_noise, share).objection == ""


def test_what_is_freer_than_a_disc_is_contradicted_by_fewer_pixels(as_noise):
    """What something small does on a disc, an outline or a highlight would have taken up."""
    search, disc = as_noise.search, as_noise.state
    spots = np.random.default_rng(0).uniform(size=disc.swept.alpha.shape) < 0.15
    data = replace(search.data, C=search.data.C + spots[..., None] * [0.0, 0.0, 0.3])
    words = "is contradicted by 17% of its pixels, too many for what is that free"
    spot = Highlight(np.zeros(2), 3.0, np.zeros(3))
    for order, highlight, said in ((1, None, ""), (2, None, words), (1, spot, words)):
        silhouette = replace(disc.silhouette, order=order)
        shape = silhouette.like(disc.silhouette, disc.shape)
        state = state_at(data, disc.family, disc.path, silhouette, shape, disc.frame)
        end = End(replace(search, data=data), replace(state, converged=True), highlight=highlight)
        assert told(end, 0.3).objection == said


def test_an_outline_is_rejected_if_places_find_another_alpha(as_noise):
    """Like planes of colors they take up more than a disc of one paint."""
    search, disc = as_noise.search, as_noise.state
    silhouette = replace(disc.silhouette, order=2)
    shape = silhouette.like(disc.silhouette, disc.shape)
    state = state_at(search.data, disc.family, disc.path, silhouette, shape, disc.frame)
    for places, believed in ((0.15, True), (0.25, False)):
        end = told(End(search, replace(state, converged=True)), 0.3)
        said = replace(end.__dict__["_said"], astray_of_places=places, astray=0.05)
        end.__dict__["_said"] = said
        assert (end.misfit <= MAX_MISFIT) is believed
        assert ("off by 25%" in end.objection) is not believed


def test_a_rim_may_not_be_all_there_is(as_noise):
    """By a quarter of the radius at most, whether lens or file blurred it."""
    search, disc = as_noise.search, as_noise.state
    for blur, believed in ((2.0, True), (3.5, False)):
        end = told(End(search, replace(disc), blur), 0.3)
        assert (end.objection == "") == believed
    assert "blurred" in end.objection


def test_an_outline_of_a_rim_that_is_held_is_none(as_noise):
    """It would be softer if files blurred more; a disc may be just that soft."""
    search, disc = as_noise.search, as_noise.state
    for order, softness, believed in ((1, 2.0, True), (2, 1.5, True), (2, 2.0, False)):
        silhouette = replace(disc.silhouette, order=order, soft=True)
        shape = silhouette.like(disc.silhouette, disc.shape)
        shape[-1] = softness
        state = state_at(search.data, disc.family, disc.path, silhouette, shape, disc.frame)
        end = told(End(search, replace(state, converged=True)), 0.3)
        assert ("blurred" not in end.objection) is believed


def test_what_gains_about_what_its_parameters_cost_is_about_as_likely(as_noise):
    """Exact: a bulge costs two parameters; less than clearly more or less is about the same."""
    search, disc = as_noise.search, as_noise.state
    oval = replace(disc.silhouette, order=2)
    shape = oval.like(disc.silhouette, disc.shape)
    other = state_at(search.data, disc.family, disc.path, oval, shape, disc.frame)
    trust = max(overstated(search.data, state) for state in (disc, other))
    cost = price(search.data, 2)
    for gain, as_likely, clearly in (
        (cost - CLEARLY - 1, False, False),
        (cost - CLEARLY + 1, True, False),
        (max(cost, CLEARLY) - 1, True, False),
        (max(cost, CLEARLY) + 1, True, True),
    ):
        end = End(search, replace(other, cost=disc.cost - trust * gain))
        assert end.is_about_as_likely_as(as_noise) is as_likely
        assert end.is_clearly_likelier_than(as_noise) is clearly


@pytest.mark.parametrize("texture", [False, True])
def test_of_any_colors_no_rim_is_blurred(as_noise, texture):
    """However sure texture seems to be: what a disc cannot be, its rim would be."""
    search, disc = as_noise.search, as_noise.state
    free = state_at(
        search.data, disc.family, disc.path, disc.silhouette, disc.shape, Frame.of(np.eye(3))
    )
    for blur, words in ((0.0, ""), (0.8, "has a blurred rim, which of any colors may be")):
        end = told(End(search, replace(free, converged=True), blur), 1.0)
        end.__dict__["_said"] = replace(end.__dict__["_said"], astray=0.0)
        end.__dict__["_off_by_texture"] = 0.01 if texture else np.inf
        assert end.objection.startswith(words)
        assert bool(end.objection) == bool(words)


def test_what_explains_clearly_more_if_it_changes_much_is_no_answer(as_noise):
    """Neither what hardly changes, as a ball that comes nearer, nor what noise may feign."""
    pays = price(as_noise.search.data, 3)
    for change, gain, objected in ((0.15, 9 * pays, 0), (0.3, 0.9 * pays, 0), (0.3, 1.1 * pays, 1)):
        end = told(as_noise, 1.0)
        freedom = np.array([0.0, change, 0.0])
        end.__dict__["_if_it_changes"] = replace(end._if_it_changes, freedom=freedom, gain=gain)
        words = "would explain clearly more if its shape changed by 30% while it went"
        assert end.objection == (words if objected else "")


@pytest.mark.parametrize("bulges", [1, 2])
def test_outlines_are_less_known_for_they_may_change(as_noise, order):
    """exact: what `if_it_changes` says comes on top of what noise leaves; a disc must not change."""
    disc, data = as_noise.state, as_noise.search.data
    silhouette = replace(disc.silhouette, order=order)
    shape = silhouette.like(disc.silhouette, disc.shape)
    state = state_at(data, disc.family, disc.path, silhouette, shape, disc.frame)
    found = End(as_noise.search, state).sweep(LinearImage(np.full((8, 8, 3), 0.5))).covariance
    trust, freer = overstated(data, state) * VARIANCE, if_it_changes(data, state)
    alone = trust * np.linalg.pinv(state.information(data)[0], hermitian=True)
    more = trust * freer.less_known + np.outer(freer.step, freer.step)
    n = len(found)
    assert_allclose(found, (alone + (order > 1) * more)[:n, :n], rtol=1e-9, atol=1e-12)


def test_a_disc_that_seems_to_change_is_less_known(as_noise):
    """exact: as an outline is, if that explains more than it costs."""
    still, changing = (End(as_noise.search, as_noise.state) for _ in range(2))
    pays = price(as_noise.search.data, 3)
    freer = replace(still._if_it_changes, freedom=np.array([0.1, 0, 0]), gain=2 * pays)
    changing.__dict__["_if_it_changes"] = freer
    image = LinearImage(np.full((8, 8, 3), 0.5))
    before, after = (end.sweep(image).covariance for end in (still, changing))
    trust = overstated(still.search.data, still.state) * VARIANCE
    more = trust * freer.less_known + np.outer(freer.step, freer.step)
    n = len(before)
    assert_allclose(after, before + more[:n, :n], rtol=1e-9, atol=1e-12)
    assert changing.sweep(image).stats["changes"] == 0.1


def test_noise_that_is_said_to_be_louder_is_all_that_is_left(as_noise):
    search, disc = as_noise.search, as_noise.state
    spots = np.random.default_rng(0).uniform(size=disc.swept.alpha.shape) < 0.1
    C = search.data.C + spots[..., None] * [0.0, 0.0, 0.5]
    for louder, words in (
        (1.0, ""),
        (2.0, "is contradicted by 11% of its pixels, even if the file hides most of its noise"),
    ):
        data = replace(search.data, C=C).raised(louder)
        state = state_at(data, disc.family, disc.path, disc.silhouette, disc.shape, disc.frame)
        end = End(replace(search, data=data), replace(state, converged=True))
        assert told(end, 0.3).objection == words
        assert end.sweep(LinearImage(np.full((8, 8, 3), 0.5))).stats["louder"] == 1.0


def test_what_leaves_more_must_be_told_by_smooth_light(hangs_together):
    assert coherence(hangs_together.search.data, hangs_together.state) > 2
    assert told(hangs_together, 0.3).objection == ""
    less = told(hangs_together, 0.15)
    assert "a wrong alpha would leave no trace" in less.objection
    assert less.misfit == np.inf


def test_a_plane_of_colors_must_not_leave_what_hangs_together(hangs_together):
    """Though no pixel contradicts it: many that are alike do."""
    search = hangs_together.search
    plane = End(search, search.best(2))
    assert plane._said.share > 0.2
    for left, too_much in ((0.0, False), (2.0, True)):
        e = plane.state.e.copy()
        e[0] += left * (plane.state.swept.alpha > 0)
        said = End(search, replace(plane.state, e=e)).objection
        assert ("hangs together" in said) is too_much


def test_what_an_error_covers_is_believed(as_noise):
    """What is contested by little is unsure by half of it; by more it is no answer."""
    for by, believed in ((0.0, True), (0.15, True), (0.25, False)):
        end = End(as_noise.search, replace(as_noise.state, contested=by))
        assert (end.misfit <= MAX_MISFIT) is believed
        assert_allclose(end.unsure, np.hypot(end.astray, by / np.sqrt(2)), rtol=1e-12)


def test_an_outline_that_is_contested_at_all_is_no_answer(as_noise):
    """There may be more that explain as much."""
    search, disc = as_noise.search, as_noise.state
    silhouette = replace(disc.silhouette, order=2)
    shape = silhouette.like(disc.silhouette, disc.shape)
    state = state_at(search.data, disc.family, disc.path, silhouette, shape, disc.frame)
    for by, believed in ((0.0, True), (0.15, False)):
        end = told(End(search, replace(state, converged=True, contested=by)), 0.3)
        assert (end.misfit <= MAX_MISFIT) is believed


def test_another_end_contests_by_how_far_its_alpha_is(as_noise):
    data, state = as_noise.search.data, as_noise.state
    shape = state.shape * 1.2
    larger = state_at(data, state.family, state.path, state.silhouette, shape, state.frame)
    end = as_noise.contested_by(larger)
    assert 0.15 < end.state.contested < 0.4
    assert end.contested_by(state).state.contested == end.state.contested


def test_what_contests_a_disc_contests_the_same_of_more_colors(as_noise):
    data, state = as_noise.search.data, as_noise.state
    contested = replace(as_noise, state=replace(state, contested=0.5))
    for larger, by in ((1.02, 0.5), (1.3, 0.0)):
        shape, frame = state.shape * larger, Frame.of(np.eye(3)[:, :2])
        plane = state_at(data, state.family, state.path, state.silhouette, shape, frame)
        assert End(as_noise.search, plane).contested_as(contested).state.contested == by


def test_in_a_file_a_disc_is_less_known_for_it_need_not_be_round(as_noise):
    """exact: what `if_not_round` says comes on top where a file took of what tells."""
    data, disc = as_noise.search.data, as_noise.state
    image = LinearImage(np.full((8, 8, 3), 0.5))
    inverse = np.linalg.pinv(disc.information(data)[0], hermitian=True)
    plain, filed = (
        End(as_noise.search, disc, covariance=covariance).sweep(image).covariance
        for covariance in (None, overstated(data, disc) * inverse)
    )
    freer = if_not_round(data, disc)
    more = overstated(data, disc) * VARIANCE * freer.less_known
    more += np.outer(freer.step, freer.step)
    n = len(plain)
    radius = len(disc.path)
    assert more[radius, radius] > 0.01 * plain[radius, radius]
    assert_allclose(filed, plain + more[:n, :n], rtol=1e-9)


def test_color_is_as_unsure_as_alpha(as_noise):
    """oracle: what light is left if alpha is more by a part, and by how much its color is turned."""
    data, state = as_noise.search.data, as_noise.state
    certain, unsure = (End(as_noise.search, replace(state, contested=by)) for by in (0.0, 0.1))
    by = np.sqrt(unsure.unsure**2 - certain.unsure**2)
    alpha = state.swept.alpha
    colors = []
    for more in (1.0, 1 + by):
        light = data.C - (1 - more * alpha)[..., None] * data.B
        color = np.einsum("yx,yxc->c", data.weight * alpha, light)
        colors.append(color / np.linalg.norm(color))
    turned = np.degrees(np.arccos(colors[0] @ colors[1]))
    image = LinearImage(np.full((8, 8, 3), 0.5))
    stds = [end.sweep(image).model.evidence["shape"] for end in (certain, unsure)]
    assert_allclose(np.sqrt(2 * (stds[1] ** 2 - stds[0] ** 2)), turned, rtol=0.15)


def test_a_plane_that_is_not_told_is_no_answer():
    search = search_of(Ball(11, GREEN, second_color=(0.7, 0.2, 0.3)))
    state = search.best(2)
    covariance = np.linalg.pinv(state.information(search.data)[0], hermitian=True)
    image = LinearImage(np.full((8, 8, 3), 0.5))
    for degrees, believed in ((13.0, True), (40.0, False)):
        covariance[-2:, -2:] = np.diag([np.radians(degrees) ** 2 / VARIANCE, 0])
        stats = End(search, state, covariance=covariance).sweep(image).stats
        assert (stats["misfit"] <= MAX_MISFIT) is believed
        assert ("hardly known colors" in stats["objection"]) is not believed


def test_an_outline_of_hardly_known_size_is_no_answer(as_noise):
    """It takes up what a wrong shape leaves, as a disc does not."""
    data, disc = as_noise.search.data, as_noise.state
    image = LinearImage(np.full((8, 8, 3), 0.5))
    for order, most in ((1, 0.25), (2, 0.03)):
        silhouette = replace(disc.silhouette, order=order)
        shape = silhouette.like(disc.silhouette, disc.shape)
        state = state_at(data, disc.family, disc.path, silhouette, shape, disc.frame)
        state, k = replace(state, converged=True), len(disc.path)
        for part, believed in ((0.8 * most, True), (1.2 * most, False)):
            covariance = 1e-6 * np.eye(state.size)
            covariance[k, k] = (part * disc.shape[0]) ** 2 / VARIANCE
            stats = told(End(as_noise.search, state, covariance=covariance), 0.3).sweep(image).stats
            assert ("hardly known size" in stats["objection"]) is not believed


@pytest.mark.parametrize("quality", [90, 75])
def test_more_than_a_fine_file_makes_of_noise_is_said(quality):
    """Of a coarse one nobody knows: what the plate's own did to it is as large."""
    ball, two = (
        search_of(Ball(11, GREEN, second_color=second), jpeg_quality=quality, chroma="4:2:0")
        for second in (None, (0.6, 0.25, 0.2))
    )
    right, wrong = (End.before_bleeding(s, s.best(1), SRGB) for s in (ball, two))
    assert right.objection == ""
    assert right._beyond_file < 1.5
    assert (wrong._beyond_file > 1.9) == (quality == 90)
    assert (wrong._beyond_file == 1) == (quality == 75)
    right = replace(right)
    right.__dict__["_beyond_file"] = 2.43
    assert right.objection == "leaves 2.4 times what its file makes of noise"


@pytest.mark.parametrize("quality", [90, 75])
def test_in_a_fine_file_few_pixels_contradict_what_is_right(quality):
    search = search_of(Ball(11, GREEN), jpeg_quality=quality, chroma="4:2:0")
    end = End.before_bleeding(search, search.best(1), SRGB)
    data, state = end.search.data, end.state
    spots = np.random.default_rng(0).uniform(size=state.swept.alpha.shape) < 0.15
    spotted = data.with_light(data.C + spots[..., None] * [0.0, 0.0, 0.3])
    state = replace(seen(spotted, state), converged=True)
    doubted = replace(end, search=replace(end.search, data=spotted), state=state)
    doubted.__dict__["_beyond_file"] = 1.0
    words = "of its pixels, too many for what is that free"
    assert (words in doubted.objection) == (quality == 90)

"""The catalog of Cycles scenes, and their photographs, without Blender."""

import json

import numpy as np
import pytest
from benchmarks.cycles.catalog import KINDS, MOMENTS, PARTS, PLACES, Place, scene, scenes
from benchmarks.cycles.photograph import SETUPS, composed, enlarged, photograph_scene
from benchmarks.cycles.pictures import Picture
from benchmarks.cycles.rendering import mixed

PLACE = Place("gray_room", "lamp")


def test_catalog_has_400_scenes_of_25_kinds_with_unique_names():
    names = [s.name for s in scenes()]
    assert len(names) >= 400
    assert len(set(names)) == len(names)
    assert len(KINDS) >= 25


def test_parts_share_neither_kinds_nor_rooms_nor_cameras():
    for first, second in zip(PARTS, (*PARTS[1:], PARTS[0]), strict=True):
        assert not {p.room for p in PLACES[first]} & {p.room for p in PLACES[second]}
        cameras = [{repr(s) for s in SETUPS[part].values()} for part in (first, second)]
        assert not cameras[0] & cameras[1]
        kinds = [{s.kind for s in scenes((part,))} for part in (first, second)]
        assert not kinds[0] & kinds[1]


def test_scenes_are_deterministic():
    assert scene("thrown ball", 3).mapping() == scene("thrown ball", 3).mapping()
    assert scene("thrown ball", 3).mapping() != scene("thrown ball", 4).mapping()


def test_a_scene_is_plain_json():
    again = json.loads(json.dumps(scene("two crossing balls", 0).mapping()))
    assert len(again["movers"]) == 2
    assert len(again["path"]) == MOMENTS


def test_projection_inverts_lifting():
    rng = np.random.default_rng(0)
    pixels, depth = rng.uniform(0, 300, (9, 2)), rng.uniform(1, 4, 9)
    np.testing.assert_allclose(PLACE.project(PLACE.lift(pixels, depth)), pixels, rtol=1e-12)


def test_the_axis_of_the_camera_meets_the_middle_of_the_picture():
    np.testing.assert_allclose(PLACE.project(np.array([[0.0, 0.0, -2.0]])), [[239.5, 159.5]])


def test_the_outline_of_a_sphere_is_that_of_cast_rays():
    center, radius = np.array([[0.4, -0.2, -1.5]]), 0.12
    (xy,), (disc,) = PLACE.outline(center, radius)
    y, x = np.mgrid[120:320:0.25, 300:480:0.25]
    rays = np.stack([x - 239.5, 159.5 - y, np.full_like(x, -PLACE.focal)], axis=-1)
    along = rays @ center[0] / np.linalg.norm(rays, axis=-1)
    hit = (center[0] ** 2).sum() - along**2 <= radius**2
    np.testing.assert_allclose([x[hit].mean(), y[hit].mean()], xy, atol=0.02)
    np.testing.assert_allclose(np.sqrt(hit.sum() / 16 / np.pi), disc, rtol=1e-3)


@pytest.mark.parametrize("kind", [k for k in KINDS if k != "ball leaving the picture"])
def test_paths_stay_in_the_picture(kind):
    for number in range(4):
        made = scene(kind, number)
        assert np.all((made.path > 0) & (made.path < np.array(made.place.size)))


def test_part_of_a_run_has_scenes_of_all_parts():
    first = mixed(PARTS)[:40]
    assert {s.part for s in first} == set(PARTS)


def test_picture_is_the_composition_of_its_truth():
    rng = np.random.default_rng(1)
    alpha, light = rng.uniform(0, 1, (12, 18)), rng.uniform(0, 1, (12, 18, 3))
    plate = rng.uniform(0, 1, (12, 18, 3))
    maps = composed(
        {"alpha": alpha, "light": light, "field": np.full((4, 6, 3), 0.9)}, {"light": plate}
    )
    np.testing.assert_allclose(maps["behind"], 0.9 * plate, rtol=1e-6)
    expected = light + (1 - alpha[..., None]) * 0.9 * plate
    np.testing.assert_allclose(maps["image"], expected, rtol=1e-6)


def test_enlarging_keeps_a_linear_field():
    x = np.broadcast_to(np.arange(8.0)[None, :, None], (5, 8, 3))
    wide = enlarged(x, (15, 24))
    np.testing.assert_allclose(np.diff(wide[6, 3:-3, 0]), 1 / 3, rtol=1e-6)


@pytest.fixture
def rendered(tmp_path):
    """A scene as written by the renderer: a gray disc of radius 9 before a plate of noise."""
    job = scene("matte ball", 0).mapping() | {"alpha_std": 0.001, "rolling_shutter": 0.0}
    rng = np.random.default_rng(2)
    y, x = np.mgrid[:48, :72]
    alpha = np.clip(9.5 - np.hypot(x - 30, y - 20), 0, 1).astype(np.float32)
    scene_maps = {
        "alpha": alpha,
        "light": alpha[..., None] * np.float32([0.2, 0.4, 0.6]),
        "field": np.ones((16, 24, 3), np.float32),
    }
    plate = rng.uniform(0.2, 0.4, (48, 72, 3)).astype(np.float32)
    for folder in ("linear", "plates"):
        (tmp_path / folder).mkdir()
    (tmp_path / "linear" / f"{job['name']}.json").write_text(json.dumps(job))
    np.savez(tmp_path / "linear" / f"{job['name']}.npz", **scene_maps)
    np.savez(tmp_path / "plates" / f"{job['plate']}.npz", light=plate, small=plate[::3, ::3])
    return tmp_path, job["name"], alpha


def test_pictures_of_all_cameras_agree_with_the_truth(rendered):
    root, name, alpha = rendered
    assert photograph_scene(root, name) == len(SETUPS["learn"])
    picture = Picture(root, "learn", name, "png")
    image, plate = picture.read()
    truth = picture.truth()
    np.testing.assert_allclose(truth.layer.alpha, alpha, atol=1e-6)
    np.testing.assert_allclose(picture.facts.mean_color, [0.2, 0.4, 0.6], rtol=1e-5)
    assert picture.facts.round
    predicted = truth.layer.premultiplied + (1 - alpha[..., None]) * plate.rgb
    assert np.sqrt(np.mean((image.rgb - predicted) ** 2)) < 3 / 255


def test_truth_is_blurred_by_the_lens(rendered):
    root, name, alpha = rendered
    photograph_scene(root, name)
    seen = Picture(root, "learn", name, "phone").truth().layer.alpha
    np.testing.assert_allclose(seen.sum(), alpha.sum(), rtol=1e-4)
    assert np.abs(np.diff(seen, axis=0)).max() < np.abs(np.diff(alpha, axis=0)).max()


def test_second_run_writes_nothing(rendered):
    root, name, _ = rendered
    photograph_scene(root, name)
    assert photograph_scene(root, name) == 0

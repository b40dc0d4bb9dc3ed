"""Scenes on disk, and scores of answers."""

import re
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from blurmatte.errors import FileError
from blurmatte.files.models import path_to_mapping, read_color_model
from blurmatte.files.reading import read
from blurmatte.files.writing import write
from blurmatte.layer import Layer
from blurmatte.matting import Pixelwise, solve
from blurmatte.radiometry import NoiseModel
from blurmatte.rendering import Ball, Camera, Scene, Shot, colorful_plate, render
from blurmatte.rendering.scene import Nearby, Shadow
from blurmatte.scenes import (
    ProgramAnswer,
    find_scenes,
    mean_score,
    read_answer,
    read_truth,
    save_shot,
    score,
    score_table,
)
from blurmatte.trajectory import Trajectory

SCENE = Scene(
    colorful_plate((96, 64), 1, tile=16),
    Trajectory.line((24.3, 30), (66, 38.2)),
    Ball(8, (0.9, 0.45, 0.05), ambient=0.6),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A scene on disk."""
    place = tmp_path_factory.mktemp("scenes") / "ball"
    save_shot(place, Shot(SCENE, Camera(NoiseModel(1e-5, 5e-4), bits=16), seed=2))
    return place


@pytest.fixture(scope="module")
def truth(folder):
    return read_truth(folder)


def test_truth_round_trips(folder, truth):
    rendering = render(SCENE)
    assert_allclose(truth.layer.alpha, rendering.layer.alpha, atol=1e-7)
    assert_allclose(truth.trajectory.xy, SCENE.trajectory.xy)
    assert truth.radius == 8
    assert len(truth.subframes) == 8
    image, layer = read(folder / "truth" / "image.exr"), truth.layer
    again = layer.premultiplied + (1 - layer.alpha[..., None]) * truth.plate.rgb
    assert_allclose(image.rgb, again, atol=1e-6)
    model = read_color_model(folder / "truth" / "model.json")
    assert_allclose(model.basis, rendering.model.basis)


@pytest.mark.parametrize("bits", [8, 12, 16])
def test_pictures_equal_the_photographs(tmp_path, bits):
    shot = Shot(SCENE, Camera(NoiseModel(1e-5, 5e-4), bits=bits), seed=2)
    save_shot(tmp_path, shot)
    image, plate = shot.photograph(render(SCENE))
    assert_allclose(read(tmp_path / "image.png").rgb, image.rgb, atol=2e-5)
    assert_allclose(read(tmp_path / "plate.png").rgb, plate.rgb, atol=2e-5)
    assert (read(tmp_path / "image.png").meta.levels == 256) == (bits == 8)


def check_composed(folder, scene, *names):
    """The image is the plate without what these files have of it, and the layer; returns these."""
    save_shot(folder, Shot(scene, Camera(bits=None)))
    truth, lost = read_truth(folder), [read(folder / f"truth/{name}.exr").rgb for name in names]
    rest = 1 - truth.layer.alpha[..., None] - sum(lost)
    image = read(folder / "image.exr").rgb
    assert_allclose(image, truth.layer.premultiplied + rest * truth.plate.rgb, atol=1e-6)
    return lost


def test_image_is_composed_with_the_written_shadow(tmp_path):
    check_composed(tmp_path, replace(SCENE, shadow=Shadow((12, 9), 2)), "shadow")


def test_image_is_composed_with_the_written_light(tmp_path):
    scene = replace(SCENE, nearby=Nearby(0.05, 0.02, 1.5), shadow=Shadow((12, 9), 2))
    _, near = check_composed(tmp_path, scene, "shadow", "nearby")
    assert near.max() > 0.01


def test_truth_is_blurred_by_the_optics(tmp_path):
    camera = Camera(bits=None, blur=0.8, defocus=1.5)
    save_shot(tmp_path, Shot(SCENE, camera))
    truth, rendering = read_truth(tmp_path), render(SCENE)
    layer = rendering.layer
    assert_allclose(truth.layer.alpha, camera.through_optics(layer.alpha), atol=1e-6)
    assert_allclose(truth.plate.rgb, camera.through_optics(rendering.plate.rgb), atol=1e-6)
    passed = (1 - layer.alpha[..., None]) * rendering.plate.rgb
    image = truth.layer.premultiplied + camera.through_optics(passed)
    assert_allclose(read(tmp_path / "image.exr").rgb, image, atol=1e-6)
    assert_allclose(read(tmp_path / "truth" / "image.exr").rgb, image, atol=1e-6)
    still = camera.through_optics(rendering.subframes(8)[3].alpha)
    assert_allclose(truth.subframes[3].alpha, still, atol=1e-6)


def test_score_of_the_truth_is_perfect(folder, truth):
    answer = ProgramAnswer(truth.layer, trajectory=truth.trajectory, subframes=truth.subframes)
    perfect = score(answer, truth)
    zeros = ("alpha_rmse", "alpha_sad", "alpha_gradient_error", "alpha_sum_bias", "false_alpha")
    for name in (*zeros, "premultiplied_rmse"):
        assert getattr(perfect, name) == 0
    assert perfect.color_degrees == pytest.approx(0, abs=1e-4)
    assert perfect.recomposite_psnr == np.inf
    assert perfect.trajectory_iou == 1
    assert perfect.subframe_psnr == 100
    assert perfect.subframe_ssim == pytest.approx(1)
    assert perfect.alpha_spread is None


def test_solution_is_scored_with_its_errors(folder, truth, tmp_path):
    image, plate = read(folder / "image.png"), read(folder / "plate.png")
    model = read_color_model(folder / "truth" / "model.json")
    write(tmp_path / "layer.exr", solve(image, plate, model, Pixelwise()))
    ours = score(read_answer(tmp_path), truth)
    assert ours.alpha_rmse < 0.02
    assert 0.8 < ours.alpha_spread < 1.2
    assert ours.color_degrees < 1
    assert ours.trajectory_iou is None


@pytest.mark.parametrize("name", ["layer.png", "layer.tif", "layer.exr"])
def test_layers_of_any_kind_are_read(truth, tmp_path, name):
    write(tmp_path / name, truth.layer)
    for place in (tmp_path, tmp_path / name):
        found = score(read_answer(place), truth)
        assert found.alpha_rmse < 2e-5
        assert found.premultiplied_rmse < 2e-5


def test_alpha_alone_has_no_color(truth, tmp_path):
    write(tmp_path / "alpha.png", truth.layer.alpha)
    found = score(read_answer(tmp_path), truth)
    assert found.alpha_rmse < 2e-5
    assert found.premultiplied_rmse is None
    assert found.color_degrees is None
    assert found.recomposite_psnr is None


def test_paths_and_subframes_are_read(truth, tmp_path):
    write(tmp_path / "layer.exr", truth.layer)
    write(tmp_path / "path.json", path_to_mapping(truth.trajectory))
    for n, frame in enumerate(truth.subframes):
        write(tmp_path / f"subframe_{n:02}.exr", frame)
    found = score(read_answer(tmp_path), truth)
    assert found.trajectory_iou == 1
    assert found.subframe_psnr == 100
    fewer = replace(read_answer(tmp_path), subframes=truth.subframes[:3])
    with pytest.raises(ValueError, match="the result has 3 sub-frames, the truth 8"):
        score(fewer, truth)


def test_missing_answer_is_counted_as_a_miss(truth):
    miss = score(None, truth)
    assert not miss.answered
    assert miss.alpha_sum_bias == -1
    streak = truth.layer.alpha[truth.layer.alpha > 0].astype(float)
    assert miss.alpha_rmse == pytest.approx(np.sqrt(np.mean(streak**2)))
    assert miss.recomposite_psnr < 40
    good = score(ProgramAnswer(truth.layer, trajectory=truth.trajectory), truth)
    both = mean_score([good, miss])
    assert not both.answered
    assert both.trajectory_iou == 0.5
    assert both.alpha_sum_bias == 0.5


def test_table_omits_metrics_that_are_none(truth):
    table = score_table({"a": score(ProgramAnswer(truth.layer), truth), "b": score(None, truth)})
    head, first, second, mean, _ = table.splitlines()
    assert head.split()[:3] == ["scene", "answered", "alpha"]
    assert "TIoU" not in head
    assert first.split()[:3] == ["a", "yes", "0"]
    assert second.split()[:2] == ["b", "miss"]
    assert mean.split()[:2] == ["mean", "miss"]


def test_table_has_standard_errors_of_its_means(truth):
    whole, miss = score(ProgramAnswer(truth.layer), truth), score(None, truth)
    rmse = (0.1, 0.2, 0.6)
    scores = {str(value): replace(whole, alpha_rmse=value) for value in rmse}
    scores["2"] = replace(scores.pop("0.2"), alpha_sum_bias=-0.4, color_units=3.0)
    scores = {name: replace(one, color_degrees=None) for name, one in scores.items()}
    scores["0.1"] = replace(scores["0.1"], color_units=None)
    scores["0.6"] = replace(scores["0.6"], color_units=None)
    head, *_, mean, error = (re.split(r"  +", row) for row in score_table(scores).splitlines())
    at = head.index("alpha RMSE")
    assert (error[0], mean[at]) == ("std error", "0.3")
    assert float(error[at]) == pytest.approx(np.std(rmse, ddof=1) / np.sqrt(3), rel=0.05)
    bias = head.index("sum bias")
    assert float(error[bias]) == pytest.approx(0.4 / 3, rel=0.05)  # (0.4, 0, 0), absolute
    assert error[head.index("color units")] == "-"
    path = replace(whole, trajectory_iou=0.8)
    head, *_, error = (
        re.split(r"  +", row) for row in score_table({"a": path, "b": miss}).splitlines()
    )
    assert float(error[head.index("TIoU")]) == pytest.approx(0.4)  # a missing path counts as 0


def test_scenes_are_found_in_nested_folders(folder, tmp_path):
    assert find_scenes(folder) == [folder]
    assert find_scenes(folder.parent) == [folder]
    with pytest.raises(FileError, match="holds no scene with its truth"):
        find_scenes(tmp_path)


def test_rejects_wrong_folders(truth, tmp_path):
    with pytest.raises(FileError, match=r"holds no result; one of layer.exr"):
        read_answer(tmp_path)
    with pytest.raises(FileError, match=r"cannot be read|does not exist|no such file"):
        read_answer(tmp_path / "layer.exr")
    (tmp_path / "path.json").write_text("{}")
    write(tmp_path / "layer.exr", truth.layer)
    with pytest.raises(FileError, match=r"path.json: give .* holds no path"):
        read_answer(tmp_path)
    small = Layer(truth.layer.alpha[1:], truth.layer.premultiplied[1:])
    with pytest.raises(TypeError, match="a score must be a Score, got float"):
        score_table({"ball": 0.3, "drop": 0.4})
    with pytest.raises(TypeError, match="a score must be a Score, got str"):
        mean_score("ball")
    with pytest.raises(ValueError, match=r"the result is 96x63 pixels and the truth 96x64"):
        score(ProgramAnswer(small), truth)

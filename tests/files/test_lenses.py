"""Calibrated cameras as JSON."""

import json

import numpy as np
import pytest
from numpy.testing import assert_allclose

import blurmatte as bm


def test_intrinsics_round_trip(tmp_path):
    """exact: every digit."""
    lens = bm.Intrinsics(
        801.25, 799.1, 320, 240, np.array([0.1, 0.2, 0, 0]), True, 0.3 * np.eye(8), (640, 480)
    )
    bm.write(tmp_path / "cam.json", lens)
    again = bm.read_intrinsics(tmp_path / "cam.json")
    assert np.array_equal(again.values, lens.values)
    assert np.array_equal(again.covariance, lens.covariance)
    assert again.fisheye
    assert again.size == (640, 480)
    bm.write(tmp_path / "cam.json", bm.Intrinsics(801.25, 799.1, 320, 240))
    assert bm.read_intrinsics(tmp_path / "cam.json").size is None


def test_std_alone_gives_a_diagonal_covariance(tmp_path):
    """exact: standard deviations of the first four numbers."""
    path = tmp_path / "cam.json"
    path.write_text(json.dumps({"fx": 800, "fy": 801, "cx": 3, "cy": 4, "std": [1, 2, 3, 4]}))
    assert_allclose(bm.read_intrinsics(path).std, [1, 2, 3, 4])


@pytest.mark.parametrize("storage", [True, False], ids=["FileStorage", "lists"])
def test_calibration_of_opencv_is_read(tmp_path, storage):
    """oracle: as written by OpenCV; zeros of richer models are ignored."""
    path, K = tmp_path / "cam.json", np.array([[800.0, 0, 320], [0, 790, 240], [0, 0, 1]])
    k = np.array([[0.1, -0.2, 1e-3, 2e-3, 0.3]])
    if storage:
        cv2 = pytest.importorskip("cv2")
        file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
        file.write("camera_matrix", K)
        file.write("distortion_coefficients", k)
        file.write("image_width", 640)
        file.write("image_height", 480)
        file.release()
    else:
        k = np.pad(k, ((0, 0), (0, 9)))
        path.write_text(json.dumps({"cameraMatrix": K.tolist(), "distCoeffs": k.tolist()}))
    lens = bm.read_intrinsics(path)
    assert_allclose(lens.values[:9], [800, 790, 320, 240, *k[0, :5]])
    assert lens.size == ((640, 480) if storage else None)


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("cam.yml", "%YAML:1.0", "holds no calibrated camera [(]must be an object"),
        ("cam.xml", "<a/>", "let OpenCV write the calibration as .json or .yml"),
        ("cam.json", '{"K": [1,0,1,0,1,1,0,0,1], "fx": 1}', "give a matrix or fx, not both"),
        ("cam.json", "{", "is no JSON"),
        ("cam.json", "[1]", "holds no calibrated camera"),
        ("cam.json", '{"fx": 1}', "holds no calibrated camera"),
        ("cam.json", '{"fx":1,"fy":1,"cx":1,"cy":1,"fisheye":1}', "fisheye must be true or false"),
        (
            "cam.json",
            '{"fx":1,"fy":1,"cx":1,"cy":1,"size":9}',
            "size must be 2 whole numbers from 1 to 1e[+]06, got 9",
        ),
        ("cam.json", '{"K": [[1,2,0],[0,1,0],[0,0,1]]}', "matrix must not be skewed, got 2"),
    ],
)
def test_invalid_intrinsics_raise_file_error(tmp_path, name, text, says):
    """door: a FileError that says what to give."""
    (tmp_path / name).write_text(text)
    with pytest.raises(bm.errors.FileError, match=says):
        bm.read_intrinsics(tmp_path / name)


FISHEYE = [165.0, 165, 159.5, 119.5, -0.02, 0.012, -0.006, 0.001]
K, D = [165.0, 0, 159.5, 0, 165.0, 119.5, 0, 0, 1], [-0.02, 0.012, -0.006, 0.001]
SIZED = {"image_width": 320, "image_height": 240}
KALIBR = """cam0:
  cam_overlaps: [1]
  camera_model: pinhole
  distortion_coeffs: [-0.02, 0.012, -0.006, 0.001]
  distortion_model: equidistant
  intrinsics: [165.0, 165.0, 159.5, 119.5]
  resolution: [320, 240]
  rostopic: /cam0/image_raw
  T_cam_imu:
  - [1.0, 0.0, 0.0, 0.1]
  - [0.0, 1.0, 0.0, 0.0]
"""
ROS = """# from the calibrator
image_width: 320
image_height: 240
camera_name: "narrow: stereo"
camera_matrix:
  rows: 3
  cols: 3
  data: [165., 0, 159.5,  # the first row
         0, 165.0, 119.5, 0, 0, 1]
distortion_model: equidistant
distortion_coefficients: {}
rectification_matrix:
  rows: 1
  cols: 1
  data: [1]
"""
ROS_TOPIC = """header:
  seq: 3
  frame_id: "cam"
height: 240
width: 320
distortion_model: "equidistant"
D: [-0.02, 0.012, -0.006, 0.001]
K: [165.0, 0.0, 159.5, 0.0, 165.0, 119.5, 0.0, 0.0, 1.0]
binning_x: 0
roi:
  x_offset: 0
  do_rectify: False
---
"""


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("own.json", {**dict(zip(("fx", "fy", "cx", "cy"), FISHEYE, strict=False)),
                      "distortion": D, "fisheye": True, "size": [320, 240]}),
        ("opencv.json", {**SIZED, "camera_matrix": {"data": K}, "fisheye_model": 1, "flags": 0,
                         "distortion_coefficients": {"rows": 4, "cols": 1, "data": D}}),
        ("ros.json", {**SIZED, "K": K, "D": D, "distortion_model": "equidistant"}),
        ("kalibr.yaml", KALIBR),
        ("ros.yaml", ROS.replace("{}", "\n  data: [-0.02, 0.012, -0.006, 0.001]")),
        ("topic.yaml", ROS_TOPIC),
        ("cameras.txt", "# list\n1 OPENCV_FISHEYE 320 240 165 165 160 120 -0.02 0.012 -0.006 0.001\n"),
    ],
)  # fmt: skip
def test_fisheye_lens_is_read_in_the_words_of_each_program(tmp_path, name, text):
    """exact: the same lens; COLMAP's first pixel is centered at (0.5, 0.5)."""
    text = text if isinstance(text, str) else json.dumps(text)
    (tmp_path / name).write_text(text)
    lens = bm.read_intrinsics(tmp_path / name)
    assert lens.fisheye
    assert_allclose(lens.values, FISHEYE)
    assert lens.size == (320, 240)


@pytest.mark.parametrize(
    ("model", "right"),
    [
        ("SIMPLE_PINHOLE 640 480 800 320.5 240.5", [800, 800, 320, 240]),
        ("PINHOLE 640 480 800 790 320.5 240.5", [800, 790, 320, 240]),
        ("SIMPLE_RADIAL 640 480 800 320.5 240.5 0.1", [800, 800, 320, 240, 0.1, 0, 0, 0]),
        ("RADIAL 640 480 800 320.5 240.5 0.1 0.2", [800, 800, 320, 240, 0.1, 0.2, 0, 0]),
        ("OPENCV 640 480 800 790 320.5 240.5 1 2 3 4", [800, 790, 320, 240, 1, 2, 3, 4]),
        (
            "FULL_OPENCV 640 480 800 790 320.5 240.5 1 2 3 4 5 6 7 8",
            [800, 790, 320, 240, 1, 2, 3, 4, 5, 6, 7, 8],
        ),
    ],
)
def test_models_of_colmap_are_read(tmp_path, model, right):
    """exact: the order of OpenCV."""
    (tmp_path / "cameras.txt").write_text(f"1 {model}\n")
    lens = bm.read_intrinsics(tmp_path / "cameras.txt")
    assert_allclose(lens.values, right)
    assert not lens.fisheye


@pytest.mark.parametrize(
    ("name", "text", "says"),
    [
        ("a.json", {"K": K, "dist": D}, "unknown key 'dist'"),
        ("a.json", {"K": K, "D": D, "distortion_model": "fov"}, "distortion_model must be one of"),
        ("a.json", {"K": K, "D": D, "fisheye_model": 1, "fisheye": False}, "contradict each other"),
        ("a.json", {"K": K, "D": D, "fisheye_model": 2}, "fisheye_model"),
        ("a.json", {"K": K, "D": D, "distortion_model": "none"}, "there are coefficients"),
        ("a.json", {"K": K, "binning_x": 2}, "binning_x must be 0 or 1"),
        ("a.json", {"K": K, "roi": {"x_offset": 4}}, "roi.x_offset must be 0"),
        ("a.yaml", KALIBR.replace("pinhole", "omni"), "camera_model must be pinhole, got 'omni'"),
        ("a.yaml", KALIBR + KALIBR.replace("cam0", "cam1"), "leave one of its cameras"),
        ("a.yaml", KALIBR + "  resolution: [1, 2]\n", "has the key resolution twice"),
        ("a.yaml", "fx: &a 1\nfy: *a", "aliases are not supported in line 2"),
        ("a.yaml", "fx: 2026-11-27", "fx must be a number"),
        ("a.yaml", "fx: !!set {a, b}", "fx must be a number"),
        ("a.yaml", "fx: [1, 2", "expected ',' or ']'"),
        ("a.yaml", "fx: " + "[" * 2000, "nested too deep"),
        ("a.yaml", "fx: 1\n   fy: 2", "in line 2"),
        ("a.yaml", "fx: .nan\nfy: 1\ncx: 1\ncy: 1", "fx must be a number from"),
        ("cameras.txt", "1 FOV 640 480 1 1 1 1 1", "the model 'FOV' cannot be used"),
        ("cameras.txt", "1 PINHOLE 640 480 1 1 1", "has the parameters fx fy cx cy, got 3"),
        ("cameras.txt", "1 PINHOLE 640 480 1 1 1 x", "could not convert string to float"),
        ("cameras.txt", "1 PINHOLE 9 9 1 1 1 1\n2 PINHOLE 9 9 1 1 1 1\n", "leave the line of one"),
    ],
)
def test_lens_of_another_model_is_refused(tmp_path, name, text, says):
    """door: never taken for a lens that is not stated."""
    (tmp_path / name).write_text(text if isinstance(text, str) else json.dumps(text))
    with pytest.raises(bm.errors.FileError) as caught:
        bm.read_intrinsics(tmp_path / name)
    assert says in str(caught.value)


@pytest.mark.parametrize("extension", ["json", "yml"])
@pytest.mark.parametrize("fisheye", [0, 1])
def test_calibration_sample_of_opencv_is_read(tmp_path, extension, fisheye):
    """oracle: the keys of its sample programs, written by OpenCV."""
    cv2 = pytest.importorskip("cv2")
    path = tmp_path / f"cam.{extension}"
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    file.write("calibration_time", "Fri 27 Nov 2026 12:00:00")
    file.write("nr_of_frames", 12)
    file.write("image_width", 320)
    file.write("image_height", 240)
    file.write("flags", 4)
    file.write("fisheye_model", fisheye)
    file.write("camera_matrix", np.reshape(K, (3, 3)))
    file.write("distortion_coefficients", np.reshape(D, (4, 1)))
    file.write("avg_reprojection_error", 0.2)
    file.write("extrinsic_parameters", np.zeros((12, 6)))
    file.release()
    lens = bm.read_intrinsics(path)
    assert_allclose(lens.values, FISHEYE)
    assert lens.fisheye == bool(fisheye)
    assert lens.size == (320, 240)

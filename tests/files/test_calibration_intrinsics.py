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
        ("cam.yml", "%YAML:1.0", "let OpenCV write the calibration as .json"),
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
    with pytest.raises(bm.FileError, match=says):
        bm.read_intrinsics(tmp_path / name)

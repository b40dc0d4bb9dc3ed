"""Scenes with a known answer that several tests look at, and where real pictures lie."""

import os
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
from tests.scenes import on_line

from blurmatte.rendering import Ball, colorful_plate

SIZE = (192, 128)
SLOW = {
    line
    for line in (Path(__file__).parent / "slow.txt").read_text(encoding="utf-8").splitlines()
    if not line.startswith("#")
}


def pytest_addoption(parser):
    parser.addoption("--cpu-times", type=Path, help="write the CPU seconds of each test here")


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Slow tests, and cases off the diagonal of a product, belong to the battery."""
    products = defaultdict(list)
    for item in items:
        if item.get_closest_marker("diagonal"):
            products[item.nodeid.split("[")[0]].append(item)
        if item.nodeid in SLOW:
            item.add_marker(pytest.mark.battery)
    for cases in products.values():
        for item in off_diagonal(cases):
            item.add_marker(pytest.mark.battery)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item):
    """Write how many CPU seconds a test took, those of its processes included."""
    path, start = item.config.getoption("--cpu-times"), sum(os.times()[:4])
    try:
        return (yield)
    finally:
        if path is not None:
            with path.open("a", encoding="utf-8") as file:
                file.write(f"{sum(os.times()[:4]) - start:.2f} {item.nodeid}\n")


def off_diagonal(cases):
    """The cases of a product that are not needed to run each value of each parameter once."""
    parameters = [
        {name: id(value) for name, value in case.callspec.params.items()} for case in cases
    ]
    values = {
        name: list(dict.fromkeys(each[name] for each in parameters)) for name in parameters[0]
    }
    longest = max(values, key=lambda name: len(values[name]))
    for case, each in zip(cases, parameters, strict=True):
        k = values[longest].index(each[longest])
        if any(each[name] != several[k % len(several)] for name, several in values.items()):
            yield case


def moving_ball(plate, second_color=None):
    """An orange ball of radius 14 that moves by twice its width; alpha up to 0.28."""
    ball = Ball(14, (0.7, 0.35, 0.1), second_color=second_color)
    return on_line(plate, (45, 35), (145, 92), ball)


@pytest.fixture(scope="session")
def paint():
    """One paint, before tiles of all hues."""
    return moving_ball(colorful_plate(SIZE, 1, tile=30))


@pytest.fixture(scope="session")
def paints():
    """Two paints, before tiles of all hues."""
    return moving_ball(colorful_plate(SIZE, 1, tile=30), np.array([0.1, 0.3, 0.7]))


@pytest.fixture(params=["paint", "paints"])
def rendering(request):
    """A scene of rank 1, then one of rank 2."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def real_data():
    """Folder of the real pictures, which are not part of the repository."""
    folder = Path(os.environ.get("BLURMATTE_REAL_DATA", "../shared/data/real"))
    folder = Path(__file__).parents[1] / folder
    if not (folder / "floorball_plate.png").exists():
        pytest.skip(f"no real pictures in {folder}; BLURMATTE_REAL_DATA names their folder")
    return folder

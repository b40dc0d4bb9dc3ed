"""Results must not change when names and structure change."""

import json

import pytest
from benchmarks.golden import GOLDEN, differences, entry_of_scene, machine, scenes

SCENES = scenes()


def known():
    """The recorded results; other processors round differently."""
    recorded = json.loads(GOLDEN.read_text())
    if recorded["machine"] != machine():
        pytest.skip(f"recorded on {recorded['machine']}, this is {machine()}")
    return recorded["scenes"]


@pytest.mark.battery
@pytest.mark.parametrize("name", SCENES)
def test_results_are_as_recorded(name):
    found = json.loads(json.dumps(entry_of_scene(*SCENES[name])))
    assert not differences(known()[name], found)


def test_differences_are_found():
    one = {"alpha": [1.0, 1e6], "grade": "assumed"}
    assert not differences(one, {"alpha": [1.0, 1e6 + 1e-4], "grade": "assumed"})
    assert differences(one, {"alpha": [1.0, 1e6 + 1e-2], "grade": "assumed"})
    assert differences(one, {"alpha": [1.0, 1e6], "grade": "plausible"})
    assert differences(one, {"alpha": [1.0], "grade": "assumed"})

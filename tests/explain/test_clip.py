"""Sentences about the layers of a clip."""

from collections import Counter

from blurmatte.background import ClipShot
from blurmatte.explain.clip import saved_in_words, without_layer_in_words


def test_layers_are_counted_by_grade():
    grades = Counter({"plausible": 2, "confirmed": 3})
    shots = [ClipShot(0, 4), ClipShot(4, 9)]
    said = saved_in_words(grades, shots, plates=2)
    assert said[0] == "5 layers: 3 confirmed, 2 plausible."
    assert said[1].startswith("2 shots: ")
    assert said[2] == "The background is the plate of the first shot."
    assert saved_in_words(Counter(), shots[:1], plates=1) == ["No layers."]


def test_frames_without_a_layer_have_a_reason():
    assert without_layer_in_words([], 5) == []
    (line,) = without_layer_in_words(["too dark", "too dark", "hidden"], 7)
    assert line == "3 of 7 frames have no layer: too dark (2 of them)"

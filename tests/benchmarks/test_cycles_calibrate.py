"""The fit of the calibration: a synthetic relation is recovered, and held-out kinds stay unseen."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from benchmarks.cycles import calibrate
from benchmarks.cycles.calibrate import (
    JOURNAL,
    QUANTILE,
    Sample,
    by_kind,
    fit,
    gather,
    read_samples,
)
from numpy.testing import assert_allclose, assert_array_equal

from blurmatte.sweep.assess.calibration import (
    COMPRESSED,
    UNCOMPRESSED,
    ErrorCalibration,
    ErrorTerms,
)

TERMS = list(vars(ErrorTerms()))
TRUE = {
    "mean": 0.8,
    "radius": 1.5,
    "noise": 0.4,
}  # of the made-up errors; those of the others are 0
INTERCEPT, SPREAD = -0.7, 0.25  # the spread of the log of the errors
KINDS = ("ball", "star", "sheet")


def made_up(count=600, seed=0, coefficients=TRUE, kinds=KINDS):
    """Samples whose log error is linear in the terms, with normal scatter."""
    rng = np.random.default_rng(seed)
    samples = []
    for n in range(count):
        terms = dict(zip(TERMS, rng.uniform(0, 1.5, len(TERMS)), strict=True))
        claim = float(np.exp(rng.uniform(-6, -3)))
        log_ratio = INTERCEPT + sum(c * terms[name] for name, c in coefficients.items())
        error = claim * float(np.exp(log_ratio + SPREAD * rng.normal()))
        kind = kinds[n % len(kinds)]
        samples.append(Sample("learn", f"s{n}", "png", kind, n % 2 == 0, terms, claim, error))
    return samples


def ratios(content, samples):
    """Errors over calibrated errors."""
    fitted = ErrorCalibration(**content)
    return np.array([
        one.error / one.claim / fitted.factor(
            ErrorTerms(**one.terms), COMPRESSED if one.compressed else UNCOMPRESSED
        )
        for one in samples
    ])  # fmt: skip


def test_fit_recovers_a_synthetic_relation():
    """honest: coefficients within a few standard errors; the intercept is that of the quantile."""
    from scipy.stats import norm

    content = fit(made_up(), "made up")
    for name in TERMS:
        assert_allclose(content["coefficients"][name], TRUE.get(name, 0.0), atol=0.1)
    # Terms that are 0 in truth can only add, so what they take comes off the intercept.
    assert_allclose(content["intercept"], INTERCEPT + SPREAD * norm.ppf(QUANTILE), atol=0.2)
    assert content["provenance"] == "made up"


def test_the_calibrated_error_is_the_quantile_of_the_errors():
    """exact up to rounding: the stated fraction of the samples is below a quantile line."""
    samples = made_up()
    content = {**fit(samples, ""), "class_factors": {COMPRESSED: 1.0, UNCOMPRESSED: 1.0}}
    assert_allclose(np.mean(ratios(content, samples) < 1), QUANTILE, atol=0.03)


def test_no_coefficient_is_negative():
    """It is 0 where the true one is negative."""
    content = fit(made_up(coefficients={"mean": -0.8, "radius": 1.5}), "")
    assert all(c >= 0 for c in content["coefficients"].values())
    assert content["coefficients"]["mean"] == 0
    assert content["coefficients"]["radius"] > 1


@pytest.mark.parametrize("compressed", [True, False])
def test_twice_the_error_is_exceeded_by_one_of_twenty_of_a_class(compressed):
    """honest: of new samples, also where errors of one class of files are larger."""

    def larger(samples):
        return [replace(s, error=s.error * (3 if s.compressed else 1)) for s in samples]

    content = fit(larger(made_up()), "")
    new = [s for s in larger(made_up(seed=1)) if s.compressed == compressed]
    assert_allclose(np.mean(ratios(content, new) > 2), 0.05, atol=0.04)
    assert content["class_factors"][COMPRESSED] > 1.5 * content["class_factors"][UNCOMPRESSED]


def test_held_out_ratios_do_not_depend_on_samples_of_their_kind():
    """exact: they are excluded from the fit."""
    samples = made_up(150)
    stars = np.array([one.kind == "star" for one in samples])
    wild = [replace(s, error=100 * s.error) if s.kind == "star" else s for s in samples]
    before, after = (calibrate._left_out_ratios(x) for x in (samples, wild))
    assert_allclose((after - before)[stars], np.log(100), rtol=1e-9)
    assert np.abs((after - before)[~stars]).max() > 0.05  # the fits for the others have


def test_table_has_a_row_for_each_kind():
    table = by_kind(made_up(150))
    assert [row[0] for row in table.rows] == sorted(KINDS)
    assert [row[1] for row in table.rows] == [50, 50, 50]


def test_samples_are_read_back_from_the_journal(tmp_path, monkeypatch):
    """exact: a second run solves only what is missing."""
    samples = {one.scene: one for one in made_up(4)}
    pictures = [SimpleNamespace(part="learn", scene=name, camera="png") for name in samples]
    solved = []

    def sample(picture):
        solved.append(picture.scene)
        return None if picture.scene == "s2" else samples[picture.scene]  # no answer

    def run(function, jobs, processes):
        return ((job, function(job)) for job in jobs)

    monkeypatch.setattr(calibrate, "_sample", sample)
    monkeypatch.setattr(calibrate, "run_each", run)
    monkeypatch.setattr(calibrate, "find_pictures", lambda root, parts, cameras: pictures)
    assert read_samples(tmp_path / JOURNAL) == []
    first = gather(tmp_path, ["png"], 2, 1)
    assert first == read_samples(tmp_path / JOURNAL) == [samples["s0"], samples["s1"]]
    everything = gather(tmp_path, ["png"], None, 1)
    assert solved == ["s0", "s1", "s2", "s3"]
    assert everything == read_samples(tmp_path / JOURNAL)
    assert [one.scene for one in everything] == ["s0", "s1", "s3"]


def test_picture_that_cannot_be_solved_is_no_sample(tmp_path, monkeypatch):
    """door: jobs are called with the arguments in their order."""
    pictures = [SimpleNamespace(part="learn", scene="s", camera="png")]
    monkeypatch.setattr(calibrate, "_sample", repr)
    monkeypatch.setattr(calibrate, "find_pictures", lambda root, parts, cameras: pictures)
    assert gather(tmp_path, ["png"], None, 1) == []


def test_package_reads_what_calibrate_writes(tmp_path, monkeypatch):
    """exact"""
    samples = made_up(60)
    path = tmp_path / "calibration.json"
    monkeypatch.setattr(calibrate, "gather", lambda *asked: samples)
    assert calibrate.calibrate(tmp_path, None, 1, path) == path
    written = ErrorCalibration(**json.loads(path.read_text(encoding="utf-8")))
    assert set(written.coefficients) == set(TERMS)
    assert "60 pictures of Blender Cycles" in written.provenance
    expected = fit(samples, written.provenance)
    assert_array_equal(list(written.coefficients.values()), list(expected["coefficients"].values()))

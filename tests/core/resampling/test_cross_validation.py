"""Exposures held out: what a true, a lying and a fragile result look like."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.errors import CalibrationError, Cancelled, ConfigError
from rigcal.resampling import cross_validate

TWO = {"lidar": ("plane", 0.0), "cam": ("pose", 0.0)}
THREE = TWO | {"other": ("pose", 10.0)}


def test_a_true_result_explains_what_it_has_not_seen(make_ring):
    """The excess scatters about what the covariance says, with the deviation that it says."""
    off = []
    for seed in range(6):
        ring = make_ring(seed, THREE, count=48)
        result = cross_validate(ring.rig, ring.registry, ring.observations, folds=4, seed=seed)
        assert result.holds
        assert not any(fold.problem for fold in result.folds)
        for sensor in result.sensors.values():
            assert sensor.fitted_rms < sensor.held_out_rms
        off.append((result.excess - result.expected) / result.deviation)
    assert abs(np.mean(off)) < 3 / np.sqrt(len(off))
    assert 0.4 < np.std(off) < 1.6


def test_every_exposure_is_held_out_once(make_ring):
    ring = make_ring(0, TWO, count=30)
    result = cross_validate(ring.rig, ring.registry, ring.observations, folds=5)
    held = [name for fold in result.folds for name in fold.exposures]
    seen = {o.exposure for o in ring.observations if o.candidates}
    assert sorted(held) == sorted(seen)
    sizes = [len(fold.exposures) for fold in result.folds]
    assert max(sizes) - min(sizes) <= 1


def test_boards_that_tremble_beyond_the_stated_noise_do_not_hold(make_ring, trembling):
    """What an exposure's measurements err alike is not in a covariance from the stated noise."""
    ring, rng = make_ring(3, THREE, count=90), np.random.default_rng(0)
    rig = replace(ring.rig, noise="configured")
    moved = tuple(trembling(o, rng, 0.008) if o.sensor != "lidar" else o for o in ring.observations)
    assert cross_validate(rig, ring.registry, ring.observations, folds=3).holds
    assert not cross_validate(rig, ring.registry, moved, folds=3).holds


def test_what_rests_on_a_few_exposures_is_named(make_ring):
    """Seven exposures join the lidar to the cameras; without one fold of them nothing does."""
    ring = make_ring(0, THREE, count=24)
    result = cross_validate(ring.rig, ring.registry, ring.observations, folds=4)
    assert not result.holds
    (problem,) = (fold.problem for fold in result.folds if fold.problem)
    assert "nothing links: {lidar}; {cam, other}" in problem


def test_where_every_exposure_is_needed_there_is_nothing_to_hold_out(make_ring):
    """Two lasers are linked by five boards, not by four."""
    ring = make_ring(4, {"lidar": ("plane", 0.0), "other": ("plane", 0.0)}, count=5)
    message = r"none of 5 folds gives a calibration that explains .*; the sensors fall into 2"
    with pytest.raises(CalibrationError, match=message):
        cross_validate(ring.rig, ring.registry, ring.observations, folds=5)


def test_a_sensor_that_no_fold_explains_has_no_figures(make_ring):
    """What is seen in one exposure only is lost with the fold that holds it out."""
    ring = make_ring(0, THREE, count=48)
    first = next(o for o in ring.observations if o.sensor == "other" and o.candidates)
    seen = tuple(o for o in ring.observations if o.sensor != "other" or o is first)
    result = cross_validate(ring.rig, ring.registry, seen, folds=4)
    assert set(result.sensors) == {"lidar", "cam"}
    (fold,) = (fold for fold in result.folds if fold.problem)
    assert first.exposure in fold.exposures
    assert "other" in fold.problem


def test_the_same_seed_gives_the_same_and_the_data_stay(make_ring):
    ring = make_ring(5, TWO, count=24)
    first, again = (
        cross_validate(ring.rig, ring.registry, ring.observations, folds=3, seed=7)
        for _ in range(2)
    )
    assert first == again
    other = cross_validate(ring.rig, ring.registry, ring.observations, folds=3, seed=8)
    assert other.folds != first.folds


@pytest.mark.parametrize("folds", [1, 100])
def test_folds_that_cannot_be(make_ring, folds):
    ring = make_ring(0, TWO, count=12)
    with pytest.raises(ConfigError, match=f"{folds} folds of .* exposures"):
        cross_validate(ring.rig, ring.registry, ring.observations, folds=folds)


def test_it_can_be_cancelled(make_ring):
    ring = make_ring(0, TWO, count=24)

    def stop(what, done, total):
        if done == 2:
            raise Cancelled

    with pytest.raises(Cancelled):
        cross_validate(ring.rig, ring.registry, ring.observations, progress=stop)

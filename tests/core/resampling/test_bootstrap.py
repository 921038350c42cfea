"""Exposures drawn anew: the scatter is the covariance where the noise is as modelled."""

from dataclasses import replace

import numpy as np
import pytest

from rigcal.errors import CalibrationError, ConfigError, NotConvergedError
from rigcal.graph import joint
from rigcal.resampling import bootstrap

RIG = {"lidar": ("plane", 0.0), "cam": ("pose", 0.0), "other": ("pose", 10.0)}


def sizes(scatter):
    """Standard deviations of the translation: by the draws, over those reported."""
    ratio = np.trace(scatter.covariance[3:, 3:]) / np.trace(scatter.reported[3:, 3:])
    return float(np.sqrt(ratio))


def test_it_agrees_with_a_covariance_that_is_true(make_ring):
    ring = make_ring(0, RIG, count=30)
    result = bootstrap(ring.rig, ring.registry, ring.observations, draws=60)
    assert (result.draws, result.failed) == (60, 0)
    assert set(result.sensors) == {"cam", "other"}
    for scatter in result.sensors.values():
        assert 0.6 < sizes(scatter) < 1.6


def test_it_sees_errors_that_an_exposure_shares(make_ring, trembling):
    """Each board shifts by 6 mm between the two cameras' frames; the noise is held as it was."""
    ring, rng = make_ring(1, RIG, count=60), np.random.default_rng(0)
    moved = tuple(trembling(o, rng, 0.006) if o.sensor == "other" else o for o in ring.observations)
    rig = replace(ring.rig, noise="configured")
    steady = bootstrap(rig, ring.registry, ring.observations, draws=60)
    result = bootstrap(rig, ring.registry, moved, draws=60)
    assert sizes(result.sensors["other"]) > 1.4 * sizes(steady.sensors["other"])


def test_the_same_seed_gives_the_same(make_ring):
    ring = make_ring(2, RIG, count=30)
    first, again = (
        bootstrap(ring.rig, ring.registry, ring.observations, draws=20, seed=3) for _ in range(2)
    )
    for name, scatter in first.sensors.items():
        np.testing.assert_array_equal(scatter.covariance, again.sensors[name].covariance)


def test_too_few_draws(make_ring):
    ring = make_ring(0, RIG, count=12)
    with pytest.raises(ConfigError, match="5 draws tell no scatter; expected 20 or more"):
        bootstrap(ring.rig, ring.registry, ring.observations, draws=5)


def test_a_sensor_that_is_seldom_drawn(make_ring):
    """A camera of which one exposure is left: a third of the draws do without it, or more."""
    ring = make_ring(3, RIG, count=60)
    once = once_each(ring, "other")
    result = bootstrap(ring.rig, ring.registry, once, draws=40)
    assert 5 < result.failed < 30


def test_draws_that_determine_nothing_are_counted(make_ring):
    """Three planes fix a laser; one or two of them, drawn again and again, do not."""
    ring = make_ring(4, {"lidar": ("plane", 0.0), "other": ("plane", 0.0)}, count=5)
    result = bootstrap(ring.rig, ring.registry, ring.observations, draws=40)
    rng = np.random.default_rng(0)
    different = [len(set(rng.integers(5, size=5))) for _ in range(1000)]
    expected = 40 * np.mean(np.array(different) < 3)
    assert result.failed + result.draws == 40
    assert expected / 2 < result.failed < 2 * expected


def test_a_draw_without_a_minimum_is_counted_and_the_others_go_on(make_ring, monkeypatch):
    ring, solve = make_ring(2, RIG, count=30), joint.solve
    minima = iter([True] * 11 + [False, True, False] + [True] * 100)

    def sometimes(*args, **options):
        if not next(minima):
            raise NotConvergedError("its steps do not end")
        return solve(*args, **options)

    monkeypatch.setattr(joint, "solve", sometimes)
    result = bootstrap(ring.rig, ring.registry, ring.observations, draws=20)
    assert (result.draws, result.failed) == (18, 2)


def test_more_draws_fail_than_not(make_ring):
    ring = make_ring(3, RIG | {"third": ("pose", -10.0)}, count=60)
    once = once_each(ring, "other", "third")
    with pytest.raises(CalibrationError, match=r"draws from the .* exposures leave"):
        bootstrap(ring.rig, ring.registry, once, draws=40)


def once_each(ring, *sensors):
    """The observations, of these sensors one each, all in different exposures."""
    rest = [o for o in ring.observations if o.sensor not in sensors]
    for i, sensor in enumerate(sensors):
        rest.append([o for o in ring.observations if o.sensor == sensor and o.candidates][2 * i])
    return rest

"""Pairs that close loops: a wrong one is named, left out of the tree, and reported."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

from rigcal.estimation import calibrate
from rigcal.geometry import se3
from rigcal.graph import stages
from rigcal.graph.loops import check_loops
from rigcal.graph.pairwise import PairResult, calibrate_pair

SIGMA = np.repeat([1e-3, 2e-3], 3)
WRONG = np.array([0, 0.1, 0, 0.05, 0, 0.1])


def make_pairs(names, links, rng, wrong=()):
    """Pairs with noise of the covariance that they state; those in `wrong` are off by WRONG."""
    T_w = dict(zip(names, se3.exp(rng.normal(0, 1, (len(names), 6))), strict=True))
    pairs = []
    for a, b in links:
        xi = rng.normal(0, SIGMA) + (WRONG if (a, b) in wrong else 0)
        T = se3.inverse(T_w[a]) @ T_w[b] @ se3.exp(xi)
        pairs.append(PairResult(a, b, 40, T, np.diag(SIGMA**2), {"0": (0, 0)}, 0.003))
    return pairs


def dropped(pairs):
    checked, _ = check_loops(pairs)
    return {(p.a, p.b) for p in checked if p.T_a_b is None}


ALL = list(itertools.combinations("abcde", 2))


@pytest.mark.parametrize("wrong", [[("a", "b")], [("b", "d")], [("a", "b"), ("c", "d")]])
def test_wrong_pairs_are_named_whichever_they_are(wrong):
    for seed in range(5):
        pairs = make_pairs("abcde", ALL, np.random.default_rng(seed), wrong)
        assert dropped(pairs) == set(wrong)
        (bad, *_) = [p for p in check_loops(pairs)[0] if p.T_a_b is None]
        assert "their transform contradicts other pairs: loop" in bad.reason
        assert "it is not used" in bad.reason


def test_right_pairs_are_left_alone():
    for seed in range(40):
        assert not dropped(make_pairs("abcde", ALL, np.random.default_rng(seed)))


def test_a_loop_of_four_counts_where_there_is_none_of_three():
    square = [("a", "b"), ("b", "c"), ("c", "d"), ("a", "d"), ("d", "e"), ("e", "c")]
    # a-b and b-c lie in the square only: the square fails, and cannot tell which of the two.
    checked, warnings = check_loops(
        make_pairs("abcde", square, np.random.default_rng(0), [("a", "b")])
    )
    assert all(p.T_a_b is not None for p in checked)
    (warning,) = warnings
    assert "one of its pairs is wrong, and no other loop tells which" in warning
    # c-d closes the square and the triangle, and both fail.
    pairs = make_pairs("abcde", square, np.random.default_rng(0), [("c", "d")])
    assert dropped(pairs) == {("c", "d")}


def test_a_single_loop_names_none():
    triangle = [("a", "b"), ("b", "c"), ("a", "c")]
    checked, warnings = check_loops(
        make_pairs("abc", triangle, np.random.default_rng(1), [("b", "c")])
    )
    assert all(p.T_a_b is not None for p in checked)
    assert len(warnings) == 1
    assert warnings[0].startswith("loop a - b - c - a closes with ")


def test_a_loop_that_fails_by_the_sum_of_small_errors_accuses_no_pair_by_itself():
    """Each of its pairs also closes a loop with d that holds."""
    pairs = make_pairs("abcd", itertools.combinations("abcd", 2), np.random.default_rng(0))
    off = {("a", "b"): 0.016, ("b", "c"): 0.016, ("a", "c"): -0.016}
    pairs = [
        replace(p, T_a_b=se3.exp(np.array([0, 0, 0, off.get((p.a, p.b), 0.0), 0, 0])))
        for p in pairs
    ]
    checked, warnings = check_loops(pairs)
    assert all(p.T_a_b is not None for p in checked)
    (warning,) = warnings
    assert warning.startswith("loop a - b - c - a closes with 0 deg and 48 mm: one of its pairs")


@pytest.mark.parametrize("count", [5, 10])
def test_where_nearly_all_pairs_contradict_each_other_none_is_accused(count):
    names = "abcdefghij"[:count]
    links = list(itertools.combinations(names, 2))
    pairs = make_pairs(names, links, np.random.default_rng(0))
    strange = se3.exp(np.random.default_rng(1).normal(0, 1, (len(pairs), 6)))
    pairs = [replace(p, T_a_b=T) for p, T in zip(pairs, strange, strict=True)]
    checked, warnings = check_loops(pairs)
    assert all(p.T_a_b is not None for p in checked)
    assert len(warnings) == count * (count - 1) * (count - 2) / 6


def test_what_all_exposures_share_is_no_contradiction():
    """A biased range moves one sensor against all others by more than their noise."""
    pairs = make_pairs("abcd", itertools.combinations("abcd", 2), np.random.default_rng(2))
    shift = se3.exp(np.array([0, 0, 0, 0.015, 0, 0]))
    pairs[0] = replace(pairs[0], T_a_b=pairs[0].T_a_b @ shift)
    assert not dropped(pairs)


@pytest.fixture
def spoilt(monkeypatch):
    """spoilt(a, b): the pair comes out wrong, as if both had taken another thing for the board."""

    def spoilt(*names):
        def wrong(pairs, target, rng, of):
            result = calibrate_pair(pairs, target, rng, of)
            if set(of) == set(names):
                result = replace(result, T_a_b=result.T_a_b @ se3.exp(WRONG))
                # It looks like the best of all, so that the tree would take it.
                result = replace(result, covariance=result.covariance * 1e-2)
            return result

        monkeypatch.setattr(stages, "calibrate_pair", wrong)

    return spoilt


def test_a_calibration_does_without_the_bad_pair_and_says_so(make_ring, spoilt):
    kinds = {"lidar": ("plane", 0.0), "a": ("pose", 0.0), "b": ("pose", 30.0), "c": ("pose", -30.0)}
    ring = make_ring(0, kinds, count=40)
    spoilt("lidar", "b")
    result = calibrate(ring.rig, ring.registry, ring.observations)
    (warning,) = [w for w in result.warnings if "contradicts other pairs" in w]
    assert {"lidar", "b"} == set(warning.split(": ")[0].split(" - "))
    for sensor, T in ring.T_root.items():
        e = se3.log(se3.inverse(result.T("lidar", sensor)) @ T)
        assert np.linalg.norm(e) < 0.01

"""Range residuals of a line candidate as functions of the target's pose."""

from __future__ import annotations

import numpy as np

from rigcal.geometry import se3
from rigcal.geometry.bend import range_to_bend
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import plane_of_target
from rigcal.observation import Candidate
from rigcal.plugin.contract import Residual
from rigcal.residual import beam_residual, bent_beam_residual, biased_beam_residual
from rigcal.targets.target import Target
from rigcal_lrf2d.config import Lrf2dConfig
from rigcal_lrf2d.line import total_least_squares
from rigcal_lrf2d.scan import directions


def residual(candidate: Candidate, config: Lrf2dConfig, target: Target) -> Residual:
    """Whitened range errors of the candidate's beams against the face of the target.

    Of a flat one their sum of squares depends on the two parameters of its trace in z = 0 only, so
    it is compressed to two rows (`rigcal.residual.beam_residual`). The sigma of a range holds the
    noise of the beam's angle at its incidence. Where the config asks to refine the ranges' bias, it
    is a function of that too, and has a row more; where the target's asks for its bend, of that,
    and has one row more.
    """
    angles, ranges = _beams(candidate, config)
    d_s = directions(angles)
    line = total_least_squares(d_s[:, :2] * ranges[:, None])
    ratio = float(candidate.measurement.get("noise_ratio", 1.0))
    sigma = ratio * line.sigma(d_s[:, :2], config.noise)
    n, d = np.append(line.normal, 0.0), float(line.d)
    if target.may_bend:
        bias_m = config.range_bias_m if config.refine else None
        return bent_beam_residual(d_s, ranges, sigma, n, d, target.bend, planar=True, bias_m=bias_m)
    if config.refine:
        return biased_beam_residual(
            d_s, ranges, sigma, n, d, planar=True, bias_m=config.range_bias_m
        )
    return beam_residual(d_s, ranges, sigma, n, d, planar=True)


def errors(candidate: Candidate, config: Lrf2dConfig, target: Target, T_s_t: Array) -> Array:
    """(N,) measured range minus the range at which the beam meets the target's face, m.

    Infinite for a beam parallel to the plane.
    """
    angles, ranges = _beams(candidate, config)
    if target.bend.any():
        p_t = se3.inverse(T_s_t)[:3, 3]
        expected = range_to_bend(p_t, directions(angles) @ T_s_t[:3, :3], target.bend)
        return ranges - expected
    n, d = plane_of_target(T_s_t)
    with np.errstate(divide="ignore"):
        result: Array = ranges + d / (directions(angles) @ n)
    return result


def measured_at(candidate: Candidate, config: Lrf2dConfig, target: Target, T_s_t: Array) -> Array:
    """The candidate's returns (N, 3) in the sensor's frame, m."""
    angles, ranges = _beams(candidate, config)
    result: Array = directions(angles) * ranges[:, None]
    return result


def _beams(candidate: Candidate, config: Lrf2dConfig) -> tuple[Array, Array]:
    """Angles (N,) rad and ranges (N,) m of a candidate, without the bias of the config."""
    return (
        np.asarray(candidate.measurement["angles"], np.float64),
        np.asarray(candidate.measurement["ranges"], np.float64) - config.range_bias_m,
    )

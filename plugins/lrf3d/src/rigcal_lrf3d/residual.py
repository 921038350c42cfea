"""Residuals of a plane candidate's returns as functions of the target's pose."""

from __future__ import annotations

import numpy as np

from rigcal.errors import ObservationError
from rigcal.geometry import se3
from rigcal.geometry.bend import height_by_bend, range_to_bend
from rigcal.geometry.se3 import Array
from rigcal.geometry.shapes import plane_of_target
from rigcal.observation import Candidate, PlaneGeometry
from rigcal.plugin.contract import Residual
from rigcal.residual import beam_residual, bent_beam_residual, biased_beam_residual
from rigcal.targets.target import Target
from rigcal_lrf3d.cloud import without_bias
from rigcal_lrf3d.config import Lrf3dConfig
from rigcal_lrf3d.plane import beams, range_errors, sigma_on


def residual(candidate: Candidate, config: Lrf3dConfig, target: Target) -> Residual:
    """Whitened errors of the candidate's returns against a target's face; 3 rows if it is flat.

    Where the beams start at the sensor: measured range minus the range at which each beam meets
    the plane. Otherwise: distance from the plane, with the part of the range noise that falls on
    the plane's normal; for that part the direction of the beam is taken as from the origin. Where
    the config asks to refine the ranges' bias, it is a function of that too, and has a row more;
    where the target's asks for its bend, of that, and has three rows more.
    """
    points, geometry = _points(candidate, config), candidate.geometry
    if not isinstance(geometry, PlaneGeometry):
        raise ObservationError(
            f"a 3D laser's candidate has {type(geometry).__name__}, expected PlaneGeometry"
        )
    n, d = geometry.normal, geometry.d
    ranges, directions = beams(points)
    cosine = directions @ n
    ratio = float(candidate.measurement.get("noise_ratio", 1.0))
    sigma = ratio * sigma_on(points, n, d, config.noise)
    at_sensor = config.beams_start_at_sensor
    # A beam of unit length that falls on the plane along its normal measures the distance.
    beam = (
        (directions, ranges, sigma)
        if at_sensor
        else (np.broadcast_to(-n, points.shape), np.ones(len(points)), sigma * np.abs(cosine))
    )
    origins = None if at_sensor else points + n
    gain = 1.0 if at_sensor else -cosine
    if target.may_bend:
        bias_m = config.range_bias_m if config.refine else None
        return bent_beam_residual(
            *beam, n, d, target.bend, origins=origins, bias_m=bias_m, gain=gain
        )
    if config.refine:
        return biased_beam_residual(
            *beam, n, d, origins=origins, bias_m=config.range_bias_m, gain=gain
        )
    return beam_residual(*beam, n, d, origins=origins)


def errors(candidate: Candidate, config: Lrf3dConfig, target: Target, T_s_t: Array) -> Array:
    """(N,) errors of the candidate's returns (m): along the beams where they start at the sensor
    (measured minus expected range), else distances from the target's face (positive behind it).
    """
    points = _points(candidate, config)
    if target.bend.any():
        return _errors_of_bent(points, config, target.bend, T_s_t)
    n, d = plane_of_target(T_s_t)
    if config.beams_start_at_sensor:
        return range_errors(points, n, float(d))[0]
    result: Array = -(points @ n + d)
    return result


def _errors_of_bent(points: Array, config: Lrf3dConfig, bend: Array, T_s_t: Array) -> Array:
    T_t_s = se3.inverse(T_s_t)
    p_t = se3.apply(T_t_s, points)
    if not config.beams_start_at_sensor:
        below: Array = height_by_bend(p_t) @ bend - p_t[:, 2]
        return below
    ranges, directions = beams(points)
    return ranges - range_to_bend(T_t_s[:3, 3], directions @ T_s_t[:3, :3], bend)


def measured_at(candidate: Candidate, config: Lrf3dConfig, target: Target, T_s_t: Array) -> Array:
    """The candidate's returns (N, 3) in the sensor's frame, m."""
    return _points(candidate, config)


def _points(candidate: Candidate, config: Lrf3dConfig) -> Array:
    """Returns (N, 3) of a candidate, without the bias of the config."""
    return without_bias(np.asarray(candidate.measurement["points"], dtype=np.float64), config)

"""What an exposure with the board at a pose would tell of the sensors' poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rigcal.errors import ConfigError, PluginError, RigcalError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.graph.edge import SensorTargetEdge
from rigcal.graph.information import Ends, eliminate
from rigcal.graph.numbers import Numbers
from rigcal.graph.stack import EdgeStack, poses_of
from rigcal.observation import Candidate
from rigcal.planning.candidates import BoardPose
from rigcal.planning.site import Site
from rigcal.plugin.contract import SensorConfig, SensorType
from rigcal.residual import residual_of
from rigcal.scene import Scene
from rigcal.targets.target import Target


@dataclass(frozen=True, eq=False)
class Pool:
    """Board poses, and the information (K, 6 S + Q, 6 S + Q) that each gives of the poses of all
    sensors and the numbers that the rig asks to refine.

    The root is one of them: no sensor is held.
    """

    poses: tuple[BoardPose, ...]
    information: Array


def weigh(
    site: Site,
    poses: Sequence[BoardPose],
    numbers: Numbers,
    scales: Mapping[str, float],
    rng: np.random.Generator,
) -> Pool:
    """What each pose would tell, by the residuals of simulated observations at the true poses.

    `scales` are sensors' noise over the configured one, 1 where missing. The pose of the board is
    unknown, and eliminated. Poses at which fewer than two sensors find the board are left out, and
    those whose exposures an estimate of its bend would leave out.
    """
    edges: list[SensorTargetEdge] = []
    kept: list[BoardPose] = []
    for pose in poses:
        found = _edges(site, pose, str(len(kept)), scales, rng)
        counts = any(e.in_plane for e in found) or not site.targets[pose.target].may_bend
        if len(found) > 1 and counts:
            edges += found
            kept.append(replace(pose, seen_by=tuple(e.sensor for e in found)))
    return Pool(tuple(kept), _information(site, kept, edges, numbers))


def _edges(
    site: Site,
    pose: BoardPose,
    exposure: str,
    scales: Mapping[str, float],
    rng: np.random.Generator,
) -> list[SensorTargetEdge]:
    target, edges = site.targets[pose.target], []
    for name in pose.seen_by:
        kind, config = site.kinds[name], site.rig.sensors[name]
        T_s_t = se3.inverse(site.T_root_s[name]) @ pose.T_root_t
        try:
            candidate = _observed(kind, T_s_t, config, target, rng)
            if candidate is None:
                continue
            residual = residual_of(kind, candidate, config, target)
        except PluginError:
            raise
        except RigcalError as error:
            raise ConfigError(f"sensors.{name}: {error}") from error
        except (Exception, SystemExit) as error:
            raise PluginError(
                f"sensor '{name}': type '{config.type}' fails to simulate what it sees of a board: "
                f"{type(error).__name__}: {error}; its plugin needs mending"
            ) from error
        scale, in_plane = scales.get(name, 1.0), candidate.tells_turn
        edges.append(SensorTargetEdge(name, exposure, residual, scale, in_plane=in_plane))
    return edges


def _observed(
    kind: SensorType,
    T_s_t: Array,
    config: SensorConfig,
    target: Target,
    rng: np.random.Generator,
) -> Candidate | None:
    """What the sensor reports of a target at `T_s_t`, without a detector if its type can."""
    if kind.observe is not None:
        return kind.observe(T_s_t, config, target, rng)
    assert kind.simulate is not None, "of sensors that `can_be_planned`"
    frame = kind.simulate(np.eye(4), Scene(target, T_s_t), config, rng, kind.effects())
    candidates = kind.detect(frame, config, target).candidates
    return candidates[0] if candidates else None


def _information(
    site: Site, poses: Sequence[BoardPose], edges: Sequence[SensorTargetEdge], numbers: Numbers
) -> Array:
    """(K, 6 S + Q, 6 S + Q), the board of each exposure eliminated."""
    count = len(site.T_root_s)
    size = 6 * count + len(numbers)
    if not edges:
        return np.zeros((0, size, size))
    exposures = [str(k) for k in range(len(poses))]
    stack = EdgeStack(edges, list(site.T_root_s), exposures, numbers)
    T_s_t = stack.relative(poses_of(site.T_root_s), np.stack([p.T_root_t for p in poses]))
    stack.check(T_s_t, numbers)
    H, A = stack.blocks(T_s_t, numbers=numbers).H, se3.adjoint(se3.inverse(T_s_t))
    # What is known beforehand is known once, and not of every exposure.
    beforehand = np.diag(np.concatenate([np.zeros(6 * count), numbers.known]))
    result = []
    for k in range(len(poses)):
        own = stack.exposure == k
        ends = Ends(stack.sensor[own], np.zeros(own.sum(), np.int64), A[own])
        result.append(eliminate(H[own], ends, count, 1, numbers)[0] - beforehand)
    return np.stack(result)

"""The result: a tree of transforms with covariances, statistics, and what was left out and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rigcal.diagnosis.verdict import Verdict
from rigcal.errors import ConfigError
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.validation import nearest_of


@dataclass(frozen=True)
class ResidualStatistics:
    """Unwhitened errors of a sensor's inlier measurements, in `unit`."""

    unit: str
    rms: float
    count: int


@dataclass(frozen=True)
class RefinedNumber:
    """A number that was estimated beside the poses: where it started, and what it was found to be.

    `sigma` is its standard deviation; all three in `unit`, which is empty for a pure number.
    """

    value: float
    sigma: float
    start: float
    unit: str = ""


@dataclass(frozen=True, eq=False)
class SensorResult:
    """One sensor of the tree.

    `T_parent_sensor` (4, 4): `p_parent = T @ p_sensor`; the root has itself as `parent` and the
    identity. `covariance` (6, 6) over [rotation rad, translation m], right perturbation, in the
    sensor's frame; None for the root, for a fixed pose, and in truth files. `observations` were
    detected, `inliers` of them used. `noise_scale` is the estimated over the configured noise.
    `refined` holds what its config asked to refine, by the number's name. `sigmas` are standard
    deviations (6,) as of the covariance, by the noise as "configured" and as "estimated".
    """

    parent: str
    T_parent_sensor: Array
    covariance: Array | None = None
    observations: int | None = None
    inliers: int | None = None
    residual: ResidualStatistics | None = None
    noise_scale: float | None = None
    refined: Mapping[str, RefinedNumber] = field(default_factory=dict)
    sigmas: Mapping[str, Array] = field(default_factory=dict)


@dataclass(frozen=True)
class Rejection:
    """Data of one sensor in one exposure that the result does not rest on, and why."""

    sensor: str
    exposure: str
    origin: str
    reason: str


@dataclass(frozen=True)
class GraphError:
    """Sum of squared errors (m^2) over all edges of MSG-Cal's graph but sensor-sensor ones.

    `pairwise_m2` at the spanning tree of the pairs, `solution_m2` at the result, over the same
    `edges`.
    """

    pairwise_m2: float
    solution_m2: float
    edges: int


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """`matrix` (6 S, 6 S) of the poses `T_root_s` of `sensors` together, each as its own is."""

    sensors: tuple[str, ...]
    matrix: Array


@dataclass(frozen=True, eq=False)
class Calibration:
    """A tree of sensors rooted at `root`; `sensors` includes the root."""

    root: str
    sensors: Mapping[str, SensorResult]
    target_poses: Mapping[str, Array] = field(default_factory=dict)
    """`T_root_t` (4, 4) per exposure."""
    rejected: tuple[Rejection, ...] = ()
    warnings: tuple[str, ...] = ()
    provenance: Mapping[str, object] = field(default_factory=dict)
    """Versions, seed, input hashes, settings: plain strings and numbers."""
    holds_ns: Mapping[str, tuple[int, int]] = field(default_factory=dict)
    """From when to when the target stood at each of `target_poses`, true time; in truth files."""
    graph_error: GraphError | None = None
    refined_targets: Mapping[str, Mapping[str, RefinedNumber]] = field(default_factory=dict)
    """What the rig asked to refine of its targets, by target and name: `scale`, and `bend_x`,
    `bend_y`, `bend_xy`.
    """
    joint_covariance: JointCovariance | None = None
    verdict: Verdict | None = None
    """What the data determine; not part of the file."""

    def T(self, a: str, b: str) -> Array:
        """`T_a_b` (4, 4) between any two sensors of the tree; ConfigError for an unknown name."""
        return se3.inverse(self._T_root(a)) @ self._T_root(b)

    def covariance(self, a: str, b: str) -> Array:
        """(6, 6) of `T(a, b)` over [rotation rad, translation m], right perturbation, in frame b.

        `T_a_b` moves by what b moves, less the adjoint of `T_b_a` times what a moves. ConfigError
        where only the covariances of single sensors are known.
        """
        T_b_a = self.T(b, a)
        if self.joint_covariance is None:
            raise ConfigError(
                "this calibration has no covariance between sensors; make it again with "
                "`rigcal calibrate`, or hold both sensors against the root"
            )
        names, matrix = self.joint_covariance.sensors, self.joint_covariance.matrix
        rows = np.zeros((6, len(matrix)))
        for name, part in ((b, np.eye(6)), (a, -se3.adjoint(T_b_a))):
            if name in names:  # the root and fixed sensors do not move
                at = 6 * names.index(name)
                rows[:, at : at + 6] += part
        result: Array = rows @ matrix @ rows.T
        return result

    @property
    def up(self) -> Array:
        """(3,) unit vector in the root's frame: the mean of the boards' y axes, which are mostly
        held upright; z of the root where they disagree.
        """
        poses = np.array(list(self.target_poses.values())).reshape(-1, 4, 4)
        mean = poses[:, :3, 1].mean(axis=0) if len(poses) else np.zeros(3)
        size = float(np.linalg.norm(mean))
        return mean / size if size > 0.3 else np.array([0.0, 0.0, 1.0])

    def _T_root(self, name: str) -> Array:
        if name != self.root and name not in self.sensors:
            raise ConfigError(f"no sensor '{name}'{nearest_of(name, [*self.sensors])}")
        T = np.eye(4)
        seen: set[str] = set()
        while name != self.root:
            if name not in self.sensors or name in seen:
                known = ", ".join(self.sensors)
                raise ConfigError(
                    f"no way from sensor '{name}' to root '{self.root}' (has: {known})"
                )
            seen.add(name)
            T = self.sensors[name].T_parent_sensor @ T
            name = self.sensors[name].parent
        return T

"""A calibration and its recording on one time line, for the viewer rerun (https://rerun.io)."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from rigcal.belonging import check_calibration, check_observations
from rigcal.calibration import Calibration
from rigcal.errors import ConfigError, InputError
from rigcal.exposures import name_in_result
from rigcal.files import replacing
from rigcal.fusing.colour import by_range
from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Observation
from rigcal.plugin.contract import FrameView
from rigcal.plugin.registry import Registry
from rigcal.progress import Progress
from rigcal.refined import rig_as_refined
from rigcal.report.boards import boards_in_root, dense, sorted_exposures
from rigcal.report.frames import show_frames
from rigcal.report.scene3d import magnification, reach_of, semi_axes
from rigcal.report.view import rims
from rigcal.rig import Rig

_MOST_POINTS = 20_000
_JPEG_QUALITY = 80
_COLOURS = {"after": (36, 100, 180), "before": (230, 140, 30)}
_NOT_NOW = (150, 150, 150)
_AXES = np.diag([255, 255, 255])
_AXIS_M = 0.1
# Points on the screen.
_DOT, _LINE = -1.0, -0.6


def write_timeline(
    path: Path | str,
    calibration: Calibration,
    observations: Sequence[Observation],
    rig: Rig,
    registry: Registry,
    recording: Path | None = None,
    before: Calibration | None = None,
    progress: Progress | None = None,
) -> None:
    """Write a file (.rrd) for the viewer rerun: rig, boards, images, scans, clouds per exposure.

    Everything stands twice if there is a calibration `before`. Frames are shown where there is a
    recording. ConfigError if rerun is not installed (`pip install "rigcal[view]"`), and for a
    calibration of another rig; InputError if the file cannot be written, RecordingError if the
    recording cannot be read. Then the file stays as it was.
    """
    rerun = _rerun()
    target = Path(path)
    if target.suffix.lower() != ".rrd":
        raise InputError(f"{target}: expected a file that ends in .rrd, by which rerun knows it")
    if not target.parent.is_dir():
        raise InputError(f"{target}: there is no folder {target.parent}")
    _check(rig, observations, calibration, before)
    stream = rerun.RecordingStream("rigcal")
    with replacing(target) as file:
        stream.save(file)
        with _flushed(stream):
            scene = _Scene(stream, rig, registry, observations)
            scene.fill(calibration, before, recording, progress)


def show_timeline(
    calibration: Calibration,
    observations: Sequence[Observation],
    rig: Rig,
    registry: Registry,
    recording: Path | None = None,
    before: Calibration | None = None,
    progress: Progress | None = None,
) -> None:
    """The same in rerun's own window, which stays when the call returns. Errors as there."""
    rerun = _rerun()
    _check(rig, observations, calibration, before)
    stream = rerun.RecordingStream("rigcal")
    stream.spawn()
    with _flushed(stream):
        scene = _Scene(stream, rig, registry, observations)
        scene.fill(calibration, before, recording, progress)


def _check(
    rig: Rig,
    observations: Sequence[Observation],
    calibration: Calibration,
    before: Calibration | None,
) -> None:
    check_observations(rig, observations)
    check_calibration(rig, calibration)
    if before is not None:
        check_calibration(rig, before)


def _rerun() -> Any:
    try:
        import rerun
    except ImportError:
        raise ConfigError(
            'the viewer needs rerun, which is not installed: pip install "rigcal[view]"'
        ) from None
    return rerun


@contextmanager
def _flushed(stream: Any) -> Iterator[None]:
    """What was handed over so far is kept, whatever happens."""
    try:
        yield
    finally:
        stream.flush()
        stream.disconnect()


@dataclass(frozen=True, eq=False)
class _Solution:
    """A calibration as it is drawn: under its name, in its colour."""

    name: str
    calibration: Calibration
    rig: Rig
    outlines: Mapping[str, Array]

    @property
    def colour(self) -> tuple[int, int, int]:
        return _COLOURS[self.name]


class _Scene:
    """Draws into a stream. Entities: rig/<solution>/..., images/<camera>/..., exposures."""

    def __init__(
        self, stream: Any, rig: Rig, registry: Registry, observations: Sequence[Observation]
    ) -> None:
        import rerun

        self.rr, self.stream, self.rig, self.registry = rerun, stream, rig, registry
        self.observations = [replace(o, exposure=name_in_result(rig, o)) for o in observations]

    def fill(
        self,
        calibration: Calibration,
        before: Calibration | None,
        recording: Path | None,
        progress: Progress | None,
    ) -> None:
        """Everything there is."""
        given = {"after": calibration} | ({"before": before} if before else {})
        solutions = [
            _Solution(name, c, rig_as_refined(self.rig, self.registry, c), self._outlines(c))
            for name, c in given.items()
        ]
        reach = _reach(calibration)
        self._layout(reach)
        self._upright(calibration)
        for solution in solutions:
            self._place(solution, calibration.root)
            self._rig(solution, reach)
            self._boards(solution)
        number = self._exposures(solutions[0])
        if recording is not None:
            self._frames(calibration, solutions, number, recording, progress)

    def _outlines(self, c: Calibration) -> Mapping[str, Array]:
        return boards_in_root(c, self.observations, self.rig, self.registry)

    def _layout(self, reach: float) -> None:
        import rerun.blueprint as blueprint

        pictures = [
            blueprint.Spatial2DView(origin=f"images/{name}", name=name)
            for name, config in self.rig.sensors.items()
            if self.registry.sensor_type(config.type).project is not None
        ]
        # From behind and above, level: the eye stands in the rig's frame with z up.
        eye = blueprint.EyeControls3D(
            position=reach * np.array([-1.6, 1.2, 1.4]), look_target=np.zeros(3), eye_up=(0, 0, 1)
        )
        space = blueprint.Spatial3DView(origin="rig", name=self.rig.name, eye_controls=eye)
        log = blueprint.TextLogView(origin="exposures", name="exposures")
        side = [blueprint.Grid(*pictures)] if pictures else []
        left = blueprint.Vertical(space, log, row_shares=[4, 1])
        views = blueprint.Horizontal(left, *side)
        self.stream.send_blueprint(blueprint.Blueprint(views, collapse_panels=True))

    def _log(self, path: Sequence[str], *what: Any, static: bool = False) -> None:
        self.stream.log(list(path), *what, static=static)

    def _upright(self, c: Calibration) -> None:
        self._log(["rig"], self.rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        self._log(["rig"], self.rr.Transform3D(mat3x3=_upright(c.up)), static=True)

    def _place(self, solution: _Solution, root: str) -> None:
        """A tree that hangs from another root stands so that this one is where it is."""
        c = solution.calibration
        if root in c.sensors and root != c.root:
            T = c.T(root, c.root)
            pose = self.rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3])
            self._log(["rig", solution.name], pose, static=True)

    def _rig(self, solution: _Solution, reach: float) -> None:
        """Sensors with axes, fields of view and uncertainty, in the root's frame."""
        rr, c = self.rr, solution.calibration
        poses = {name: c.T(c.root, name) for name in c.sensors}
        axes = {name: semi_axes(c, name, np.eye(4)) for name in poses}
        times = magnification([a for a in axes.values() if a is not None], _extent(c))
        for name, T in poses.items():
            at = ["rig", solution.name, name]
            pose = rr.Transform3D(translation=T[:3, 3], mat3x3=T[:3, :3])
            self._log(at, pose, static=True)
            arrows = rr.Arrows3D(vectors=_AXIS_M * np.eye(3), colors=_AXES, labels=[name, "", ""])
            self._log([*at, "axes"], arrows, static=True)
            curves = self._rims(solution, name, reach)
            if curves:
                strips = rr.LineStrips3D(curves, colors=[solution.colour], radii=[_LINE])
                self._log([*at, "view"], strips, static=True)
            if (semi := axes[name]) is not None:
                self._ellipsoid([*at, f"one sigma x {times}"], times * semi, solution)

    def _rims(self, solution: _Solution, name: str, reach: float) -> list[Array]:
        if name not in self.rig.sensors:
            return []
        config = solution.rig.sensors[name]
        return rims(self.registry.sensor_type(config.type), config, reach)

    def _ellipsoid(self, at: Sequence[str], axes: Array, solution: _Solution) -> None:
        half = np.linalg.norm(axes, axis=0)
        R = axes / np.maximum(half, 1e-15)
        R[:, 2] *= np.sign(np.linalg.det(R)) or 1.0
        turn = self.rr.Quaternion(xyzw=se3.quaternion_from_rotation(R))
        shape = self.rr.Ellipsoids3D(
            half_sizes=[half], quaternions=[turn], colors=[solution.colour]
        )
        self._log(at, shape, static=True)

    def _boards(self, solution: _Solution) -> None:
        """All boards in grey."""
        strips = [_closed(outline) for outline in solution.outlines.values()]
        if strips:
            shape = self.rr.LineStrips3D(strips, colors=[_NOT_NOW], radii=[_LINE])
            self._log(["rig", solution.name, "boards"], shape, static=True)

    def _exposures(self, solution: _Solution) -> dict[str, int]:
        """The time line: what became of every exposure, and its board; their numbers."""
        seen = {o.exposure for o in self.observations if o.candidates}
        calibration, outlines = solution.calibration, solution.outlines
        names = sorted_exposures(seen | set(calibration.target_poses))
        reasons: dict[str, list[str]] = {}
        for r in calibration.rejected:
            reasons.setdefault(r.exposure, []).append(f"{r.sensor}: {r.reason}")
        for number, name in enumerate(names):
            self.stream.set_time("exposure", sequence=number)
            text = "\n".join([f"exposure {name}", *reasons.get(name, [])])
            level = "INFO" if name in calibration.target_poses else "WARN"
            self._log(["exposures"], self.rr.TextLog(text, level=level))
            board = [_closed(outlines[name])] if name in outlines else []
            shape = self.rr.LineStrips3D(board, colors=[solution.colour], radii=[0.006])
            self._log(["rig", solution.name, "board"], shape)
        return {name: number for number, name in enumerate(names)}

    def _frames(
        self,
        calibration: Calibration,
        solutions: Sequence[_Solution],
        number: Mapping[str, int],
        recording: Path,
        progress: Progress | None,
    ) -> None:
        """Clouds and scans in place; images with the boards and the points laid over them."""
        clouds: dict[str, dict[str, Array]] = {}

        def show(o: Observation, view: FrameView) -> None:
            self.stream.set_time("exposure", sequence=number[o.exposure])
            if o.stamp_ns:
                self.stream.set_time("time", timestamp=1e-9 * o.stamp_ns)
            if view.points is not None:
                p = _thinned(view.points)
                clouds.setdefault(o.exposure, {})[o.sensor] = p
                for solution in solutions:
                    if o.sensor in solution.calibration.sensors:
                        colours = by_range(np.linalg.norm(p, axis=1))
                        dots = self.rr.Points3D(p, colors=colours, radii=[_DOT])
                        self._log(["rig", solution.name, o.sensor, "points"], dots)
            if view.image is not None:
                picture = self.rr.Image(view.image).compress(jpeg_quality=_JPEG_QUALITY)
                self._log(["images", o.sensor], picture)
                for solution in solutions:
                    self._over_image(solution, o, clouds.get(o.exposure, {}))

        wanted = [
            o
            for o in self.observations
            if o.exposure in number and o.origin and o.sensor in calibration.sensors
        ]
        # Points first: they are laid over the images.
        wanted.sort(key=lambda o: self._kind(o.sensor).project is not None)
        show_frames(recording, calibration, self.rig, self.registry, wanted, show, progress)

    def _kind(self, sensor: str) -> Any:
        return self.registry.sensor_type(self.rig.sensors[sensor].type)

    def _over_image(self, solution: _Solution, o: Observation, clouds: Mapping[str, Array]) -> None:
        c, at = solution.calibration, ["images", o.sensor, solution.name]
        if o.sensor not in c.sensors:
            return
        if o.exposure in solution.outlines:
            p_root = dense(solution.outlines[o.exposure])
            uv, inside = self._project(solution, o, se3.apply(c.T(o.sensor, c.root), p_root))
            line = _closed(uv) if inside.all() else uv[inside]
            self._log([*at, "board"], self.rr.LineStrips2D([line], colors=[solution.colour]))
        for laser, p in clouds.items():
            if laser in c.sensors:
                p_c = se3.apply(c.T(o.sensor, laser), p)
                uv, inside = self._project(solution, o, p_c)
                ranges = np.linalg.norm(p_c[inside], axis=1)
                dots = self.rr.Points2D(uv[inside], colors=by_range(ranges), radii=[1.5])
                self._log([*at, laser], dots)

    def _project(
        self, solution: _Solution, o: Observation, p: Array
    ) -> tuple[Array, NDArray[np.bool_]]:
        project = self._kind(o.sensor).project
        if project is None or not len(p):
            return np.zeros((len(p), 2)), np.zeros(len(p), bool)
        uv, inside = project(p, solution.rig.sensors[o.sensor])
        return uv, inside


def _places(c: Calibration) -> Array:
    return np.array([c.T(c.root, name)[:3, 3] for name in c.sensors])


def _extent(c: Calibration) -> float:
    return max(float(np.ptp(_places(c), axis=0).max()), 0.1)


def _reach(c: Calibration) -> float:
    boards = np.array([T[:3, 3] for T in c.target_poses.values()]).reshape(-1, 3)
    return reach_of(_places(c), boards, _extent(c))


def _thinned(points: Array) -> Array:
    """Finite points (N, 3), at most so many, spread over all."""
    p = points[np.all(np.isfinite(points), axis=1)]
    step = -(-len(p) // _MOST_POINTS) or 1
    result: Array = p[::step]
    return result


def _upright(up: Array) -> Array:
    """(3, 3) the least rotation that turns `up` (3,) to z."""
    axis = np.cross(up, [0.0, 0.0, 1.0])
    sine = np.linalg.norm(axis)
    if sine < 1e-9:
        return np.eye(3) if up[2] > 0 else np.diag([1.0, -1.0, -1.0])
    return se3.exp_so3(axis / sine * np.arctan2(sine, up[2]))


def _closed(outline: Array) -> Array:
    return np.vstack([outline, outline[:1]])

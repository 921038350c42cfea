"""What a sensor plugin hands over: one frozen `SensorType`.

Only `config`, `message_types`, `decode` and `detect` are required. Everything else has a default
in core (residuals by geometry) or is optional (simulation). Heavy imports (open3d, cv2) belong
inside the functions: listing plugins must import none of them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar, Literal, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.observation import Candidate, Detection, MeanGeometry
from rigcal.plugin.refinable import Refinable
from rigcal.recording.message import Definitions, Message, Source
from rigcal.scene import Scene
from rigcal.targets.target import Target

CONTRACT_VERSION = 1


class RotationConfig(BaseModel):
    """A unit quaternion by named keys."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    x: float
    y: float
    z: float
    w: float

    @model_validator(mode="after")
    def _is_unit(self) -> RotationConfig:
        norm = float(np.linalg.norm([self.x, self.y, self.z, self.w]))
        if abs(norm - 1) > 1e-3:
            raise ValueError(f"the quaternion has length {norm:.6g}, expected 1")
        return self


class PoseConfig(BaseModel):
    """A sensor's pose in its parent: `p_parent = R p_sensor + t`.

    `rpy_deg` is roll, pitch, yaw about the parent's fixed x, y, z, as in URDF.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    parent: str
    translation_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    rpy_deg: tuple[float, float, float] | None = None
    rotation: RotationConfig | None = None

    @model_validator(mode="after")
    def _one_rotation(self) -> PoseConfig:
        if self.rpy_deg is not None and self.rotation is not None:
            raise ValueError("give either rpy_deg or rotation, not both")
        return self

    @property
    def T_parent_sensor(self) -> Array:
        """(4, 4)."""
        if self.rotation is not None:
            q = self.rotation
            R = se3.rotation_from_quaternion(np.array([q.x, q.y, q.z, q.w]))
        else:
            R = se3.rotation_from_rpy(np.radians(self.rpy_deg or (0.0, 0.0, 0.0)))
        return se3.transform(R, np.array(self.translation_m))


class SensorConfig(BaseModel):
    """What every sensor in rig.yaml has; sensor types add their own fields.

    Subclasses write `class XConfig(SensorConfig, frozen=True)` and `type: Literal["x"] = "x"`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    optical: ClassVar[bool] = False
    """Whether its frame is an optical one (z forward, x right, y down). Files for ROS then have
    two frames: one with x forward, and the optical one hanging from it."""

    type: str
    topic: str | None = Field(default=None, description="topic of the sensor in a bag")
    files: str | None = Field(default=None, description="glob of its files in a folder recording")
    target: str | None = Field(default=None, description="target it looks at, if several are named")
    pose: PoseConfig | None = Field(default=None, description="truth for simulate; see `initial`")
    initial: Literal["pose"] | None = Field(
        default=None, description="`pose`: start the estimate from the pose given here"
    )
    fixed: bool = Field(default=False, description="keep the pose given here, do not estimate it")
    refine: tuple[str, ...] = Field(
        default=(), description="what of this sensor is estimated together with the poses"
    )

    @model_validator(mode="after")
    def _pose_is_there(self) -> SensorConfig:
        if (self.fixed or self.initial) and self.pose is None:
            key = "fixed: true" if self.fixed else "initial: pose"
            raise ValueError(f"{key} needs a pose: add `pose: {{parent: ..., ...}}`")
        return self

    @property
    def source(self) -> Source:
        """Where a recording keeps this sensor's data."""
        return Source(topic=self.topic, files=self.files)


class Effects(BaseModel):
    """What a scenario may say of one simulated sensor: its clock, and what spoils its data.

    All is off by default. Sensor types add their own fields in a subclass, written
    `class XEffects(Effects, frozen=True)`.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)

    rate_hz: float | None = Field(
        default=None, gt=0, description="frames per second of a continuous recording"
    )
    phase_s: float = Field(default=0.0, ge=0, description="first frame after the recording's start")
    clock_offset_s: float = Field(default=0.0, description="its stamps are late by")
    jitter_s: float | None = Field(
        default=None, ge=0, description="its stamps vary by up to; default: the scenario's"
    )


@dataclass(frozen=True, eq=False)
class FrameView:
    """A frame as people see it: `image` (H, W) grey or (H, W, 3) RGB, or `points` (N, 3) in the
    sensor's frame, m.
    """

    image: NDArray[np.uint8] | None = None
    points: Array | None = None


class Residual(Protocol):
    """The whitened error of one observation as a function of the target's pose in the sensor.

    Calling it with `T_s_t` (4, 4) returns r (m,), whose entries have unit variance and are
    independent when the measurements have the configured noise, and J (m, 6), its derivative by a
    right perturbation of `T_s_t` ([rotation, translation]). `block` rows belong to one measurement
    (two for a pixel): robust weights are given per block; m is a multiple of it. `dof` is the
    number m of rows, which are independent: many measurements may be compressed to fewer rows.

    A class may offer a classmethod `stack` (see `StackableResidual`) that evaluates many residuals
    at once. Without it they are called one by one: the same result, at the cost of a call each.
    """

    @property
    def block(self) -> int:
        """Rows per measurement."""
        ...

    @property
    def dof(self) -> int:
        """Rows of r."""
        ...

    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        """R (m,) and J (m, 6) at `T_s_t`."""
        ...


Stacked = Callable[[Array], tuple[Array, Array]]
"""K residuals as one function: `T_s_t` (K, 4, 4) -> r (N,) and J (N, 6), row by row in order."""


class StackableResidual(Residual, Protocol):
    """A residual that knows how to evaluate many of its class in one call: for speed."""

    @classmethod
    def stack(cls, residuals: Sequence[Self]) -> Stacked:
        """One function for residuals of one sensor with equal `block`.

        Its rows are those of the residuals, one after the other. A subclass does not inherit it:
        it is used only where the class itself defines it.
        """
        ...


Frame = Any
"""A decoded message, in whatever form (numpy) the plugin's own functions share."""

Decode = Callable[[Message, Any], Frame]
Detect = Callable[[Frame, Any, Target], Detection]
MakeResidual = Callable[[Candidate, Any, Target], Residual]
Fit = Callable[[Mapping[str, Any], Any, Target], Detection]
Observe = Callable[[Array, Any, Target, np.random.Generator], Candidate | None]
Simulate = Callable[[Array, Scene, Any, np.random.Generator, Any], Frame]
Encode = Callable[[Frame, Any, int, str], Any]
Transport = Callable[[Any, Any], Any]
Errors = Callable[[Candidate, Any, Target, Array], Array]
MeasuredAt = Callable[[Candidate, Any, Target, Array], Array]
View = Callable[[Message, Any], FrameView]
Combine = Callable[[Sequence[Candidate], MeanGeometry, Any, Target], Candidate]
Near = Callable[[Frame, Any, Target, Array], Detection]
Describe = Callable[[Any], Mapping[str, Any]]
Project = Callable[[Array, Any], tuple[Array, NDArray[np.bool_]]]


@dataclass(frozen=True)
class SensorType:
    """One kind of sensor.

    name            what rig.yaml says after `type:`
    config          its pydantic class
    message_types   ROS names and file suffixes that `decode` accepts
    message_definitions  .msg text by ROS name, of types among them that ROS does not bring and
                    of those they refer to
    decode          (message, config) -> frame; raises RecordingError on data that it cannot use
    detect          (frame, config, target) -> Detection, all candidates in the sensor's own frame
    combine         (candidates, mean, config, target) -> Candidate: those of several frames in
                    which the target stands still, as one. The `MeanGeometry` is that of their
                    geometries, and says how much less noise they have together. None: the mean
                    itself, or with a `residual` of its own the frame nearest to it
    near            (frame, config, target, T_s_t) -> Detection: a second look at a frame in which
                    `detect` did not find the target, that knows about where it is; it must answer
                    with what the frame shows, not with what was predicted
    residual        (candidate, config, target) -> Residual; None: the default of the geometry
    errors          (candidate, config, target, T_s_t) -> (N,) or (N, 2) unwhitened errors of the
                    raw measurements in `unit`, for statistics; None: by geometry, in metres
    unit            unit of `errors`: "px", "m"
    fit             (arrays by name, config, target) -> Detection: as `detect`, from measurements
                    that somebody else found on the target (the corners in an image, the points of
                    a cloud that are on the board), under the names of the candidates' own; raises
                    ObservationError for arrays that are missing or do not fit together
    measured_at     (candidate, config, target, T_s_t) -> (N, 3) where in the sensor's frame, on the
                    target, each row of `errors` was measured; reports show errors by place
    observe         (T_s_t, config, target, rng) -> Candidate or None: what a flawless detector
                    would report of a target in plain view, with the configured noise
    simulate        (T_w_s, scene, config, rng, effects) -> frame
    effects         class of what a scenario may say of it; `Effects` if it has none of its own
    encode          (frame, config, stamp_ns, frame_id) -> ROS message (see `recording.ros`)
    transport       (message of `encode`, effects) -> the message as it is recorded, perhaps of
                    another type: compressed, say; None: as it is
    message_type    ROS name of what `encode` makes
    extra_messages  (config, stamp_ns, frame_id) -> {topic suffix: (type, message)}: what goes
                    along with each frame (a camera's CameraInfo)
    sees            (points (N, 3) in the sensor's frame, config) -> (N,) which are in its view
    flat            whether it looks along the plane z = 0 of its frame only, where `sees` holds
    view            (message, config) -> FrameView: the data as pictures and reports show them
    project         (points (N, 3) in the sensor's frame, config) -> pixels (N, 2) in the image of
                    its `view`, and which (N,) are in it; for sensors that make images
    angular         whether it measures directions only: a target s times as large and s times as
                    far looks the same to it
    describes       by ROS name of a message type, its own or one that is published beside it (a
                    camera's CameraInfo): (message) -> the fields of its config that the message
                    fills in; `rigcal init` asks for it. ConfigError for a message that cannot be
                    used
    refinable       numbers of its config that the data may refine, by the name that `refine` lists;
                    its residuals are then `RefinableResidual`
    bends           whether `residual` and `errors` know that a target may be bent: of one that is
                    (`Target.may_bend`) the residual starts at `Target.bend`, and is a
                    `RefinableResidual` by it after the config's own numbers. A rig that asks to
                    refine the bend of a target takes such sensors only
    """

    name: str
    config: type[SensorConfig]
    message_types: tuple[str, ...]
    decode: Decode
    detect: Detect
    residual: MakeResidual | None = None
    errors: Errors | None = None
    unit: str = "m"
    measured_at: MeasuredAt | None = None
    observe: Observe | None = None
    simulate: Simulate | None = None
    encode: Encode | None = None
    transport: Transport | None = None
    message_type: str | None = None
    extra_messages: Callable[[Any, int, str], dict[str, tuple[str, Any]]] | None = None
    effects: type[Effects] = Effects
    sees: Callable[[Array, Any], NDArray[np.bool_]] | None = None
    flat: bool = False
    view: View | None = None
    project: Project | None = None
    angular: bool = False
    refinable: Mapping[str, Refinable] = field(default_factory=dict, hash=False)
    combine: Combine | None = None
    near: Near | None = None
    message_definitions: Definitions = field(default_factory=dict, hash=False)
    describes: Mapping[str, Describe] = field(default_factory=dict, hash=False)
    contract: int = CONTRACT_VERSION
    fit: Fit | None = None
    bends: bool = False

"""The conformance kit finds what is wrong: a beacon's faults fail the checks that are for them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from pydantic import ConfigDict

from rigcal.geometry import se3
from rigcal.geometry.se3 import Array
from rigcal.plugin import (
    Candidate,
    Detection,
    Message,
    ObservationError,
    PointGeometry,
    RecordingError,
    Scene,
    SensorConfig,
    SensorType,
)
from rigcal.recording import ros
from rigcal.residual import PointResidual
from rigcal.testing import SensorConformance

POINT = "geometry_msgs/msg/PointStamped"


class BeaconConfig(SensorConfig, frozen=True):
    type: Literal["beacon"] = "beacon"
    sigma_m: float = 0.01


def _decode(message: Message, config: Any) -> Array:
    p = message.value.point
    return np.array([p.x, p.y, p.z])


def _detect(frame: Array, config: Any, target: Any) -> Detection:
    if not np.isfinite(frame).all() or not frame.any():
        return Detection((), "no return")
    point = PointGeometry(frame, config.sigma_m**2 * np.eye(3), np.zeros(3))
    return Detection((Candidate(point, {"p": frame[None]}),))


def _residual(candidate: Candidate, config: Any, target: Any) -> PointResidual:
    measured = np.reshape(candidate.measurement["p"], 3).astype(np.float64)
    return PointResidual(np.zeros(3), measured, np.eye(3) / config.sigma_m)


def _simulate(T_w_s: Array, scene: Scene, config: Any, rng: np.random.Generator, _: Any) -> Array:
    if scene.T_w_t is None:
        return np.zeros(3)
    p_s: Array = (se3.inverse(T_w_s) @ scene.T_w_t)[:3, 3]
    noisy: Array = p_s + rng.normal(0, config.sigma_m, 3)
    return noisy if p_s[0] > 0 else np.zeros(3)


def _encode(frame: Array, config: Any, stamp_ns: int, frame_id: str) -> Any:
    point = ros.make("geometry_msgs/msg/Point", **dict(zip("xyz", frame, strict=True)))
    return ros.make(POINT, header=ros.header(stamp_ns, frame_id), point=point)


def _sees(points: Array, config: Any) -> Any:
    return points[:, 0] > 0


BEACON = SensorType("beacon", BeaconConfig, (POINT,), _decode, _detect, _residual, sees=_sees)
BEACON = replace(BEACON, simulate=_simulate, encode=_encode, message_type=POINT)


class TestBeacon(SensorConformance):
    """A type without faults passes."""

    sensor_type = BEACON
    config = BeaconConfig(topic="/beacon")
    # It is not installed.
    test_discovery_finds_it_and_imports_nothing_heavy = None  # type: ignore[assignment]


class TestReceiver(SensorConformance):
    """A type that does not simulate passes with messages that its author makes."""

    sensor_type = replace(BEACON, simulate=None, encode=None)
    config = BeaconConfig(topic="/beacon")
    test_discovery_finds_it_and_imports_nothing_heavy = None  # type: ignore[assignment]

    def message(self, T_s_t: Array, config: Any, rng: np.random.Generator) -> Message:
        """The board's origin as a point."""
        frame = T_s_t[:3, 3] + rng.normal(0, config.sigma_m, 3)
        return Message(POINT, _encode(frame, config, 0, "sensor"), 0, None, "a point of ours")


def stage_of(kind: SensorType, folder: Path, **parts: Any) -> Any:
    """The kit for a sensor type, as pytest would make it; `parts` are of its class."""
    parts = {"sensor_type": kind, "config": kind.config(topic="/beacon"), "__test__": False} | parts
    stage = type("Stage", (SensorConformance,), parts)()
    stage.folder = folder
    return stage


@dataclass(frozen=True, eq=False)
class Twisted:
    """A residual whose Jacobian or rows are not what they should be."""

    good: PointResidual
    rows: Callable[[Array], Array] = lambda r: r
    columns: Callable[[Array], Array] = lambda J: J
    block: int = 3
    dof: int = 3

    def __call__(self, T_s_t: Array) -> tuple[Array, Array]:
        r, J = self.good(T_s_t)
        return self.rows(r), self.columns(J)


def _twisted(**parts: Any) -> SensorType:
    return replace(BEACON, residual=lambda *a: Twisted(_residual(*a), **parts))


def _blind(frame: Array, config: Any, target: Any) -> Detection:
    return Detection((), "blind")


def _biased(*a: Any) -> Array:
    return _simulate(*a) + 0.001


def _own_noise(T_w_s: Array, scene: Scene, config: Any, rng: Any, effects: Any) -> Array:
    return _simulate(T_w_s, scene, config, np.random.default_rng(0), effects)


def _loud(T_w_s: Array, scene: Scene, config: Any, rng: Any, effects: Any) -> Array:
    return _simulate(T_w_s, scene, config.model_copy(update={"sigma_m": 0.02}), rng, effects)


def _in_the_world(T_w_s: Array, scene: Scene, config: Any, rng: Any, effects: Any) -> Array:
    frame = _simulate(T_w_s, scene, config, rng, effects)
    return frame + T_w_s[:3, 3]


def _fragile(message: Message, config: Any) -> Array:
    frame = _decode(message, config)
    if not np.isfinite(frame).all():
        raise ZeroDivisionError
    return frame


def _too_sure(candidates: Any, mean: Any, config: Any, target: Any) -> Candidate:
    surer = replace(mean.geometry, covariance=mean.geometry.covariance / 30)
    return replace(candidates[0], geometry=surer)


def _echo(frame: Array, config: Any, target: Any, T_s_t: Array) -> Detection:
    return _detect(T_s_t[:3, 3], config, target)


def _reporting(variances: Any) -> SensorType:
    """The beacon with a covariance of another size; its own residual does not go by it."""

    def detect(frame: Array, config: Any, target: Any) -> Detection:
        found = _detect(frame, config, target)
        stated = config.sigma_m**2 * np.diag(np.broadcast_to(variances, 3))
        return Detection(
            tuple(
                replace(c, geometry=replace(c.geometry, covariance=stated))
                for c in found.candidates
            ),
            found.reason,
        )

    return replace(BEACON, detect=detect)


def _unstamped(frame: Array, config: Any, stamp_ns: int, frame_id: str) -> Any:
    return _encode(frame, config, 0, frame_id)


def _unframed(frame: Array, config: Any, stamp_ns: int, frame_id: str) -> Any:
    return _encode(frame, config, stamp_ns, "")


def _info(config: Any, stamp_ns: int, frame_id: str) -> dict[str, tuple[str, Any]]:
    return {"info": (POINT, _encode(np.zeros(3), config, 0, frame_id))}


def _unready(r: Array) -> Array:
    if not np.isfinite(r).all():
        raise FloatingPointError("no number")
    return r


def _tied(frame: Array, config: Any, target: Any) -> Detection:
    """Ranges of three receivers, told apart by their place in the array."""
    found = _detect(frame, config, target)
    return Detection(
        tuple(replace(c, measurement={"p": frame}) for c in found.candidates), found.reason
    )


class OpenConfig(SensorConfig, frozen=True, extra="allow"):
    type: Literal["beacon"] = "beacon"
    sigma_m: float = 0.01


class LooseConfig(BeaconConfig, frozen=True):
    model_config = ConfigDict(allow_inf_nan=True)


def _trusting(frame: Array, config: Any, target: Any) -> Detection:
    if not frame.any():
        raise ZeroDivisionError
    return _detect(frame, config, target)


FAULTS: dict[str, tuple[SensorType, str, str]] = {
    "Jacobian": (
        _twisted(columns=lambda J: J * [1, 1, 1, 1, 1.01, 1]),
        "jacobian_is_the_derivative",
        "in column translation y; the worst, row .*columns are rotation .rad., then translation",
    ),
    "order of columns": (
        _twisted(columns=lambda J: J[:, [3, 4, 5, 0, 1, 2]]),
        "jacobian_is_the_derivative",
        "in column rotation x, .* right perturbation",
    ),
    "whitening": (
        _twisted(rows=lambda r: r / 1.3),
        "residual_is_whitened",
        "the residual at the truth: the errors are only .* the configured noise",
    ),
    "correlation": (
        _twisted(rows=lambda r: r @ np.linalg.cholesky(np.eye(3) / 2 + 0.5).T),
        "residual_is_whitened",
        "rows 1 and 2 of the residual .* whiten it by the configured noise",
    ),
    "columns": (
        _twisted(columns=lambda J: J[:, :5]),
        "residual_has_the_shape_that_it_announces",
        r"have shapes \(3,\) and \(3, 5\); expected \(3,\) and \(3, 6\) of its dof 3",
    ),
    "order": (
        replace(BEACON, detect=_tied),
        "order_of_measurements_does_not_matter",
        r"rows of measurement 'p' \(3,\) were shuffled.* as one row, \(1, 3\)",
    ),
    "blind": (
        replace(BEACON, detect=_blind),
        "board_in_view_is_in_the_frame",
        "the board is in view, but not detected: blind",
    ),
    "bias": (
        replace(BEACON, simulate=_biased),
        "frame_without_noise_is_explained_by_the_true_pose",
        r"what `detect` reports are 0\.00173 m rms at the true pose, expected below 0\.0001 m",
    ),
    "own noise": (
        replace(BEACON, simulate=_own_noise),
        "same_seed_gives_the_same_frame",
        "another seed gives the same frame: draw the noise from `rng`",
    ),
    "loud": (
        replace(BEACON, simulate=_loud),
        "noise_of_frames_is_the_configured_one",
        "whitened residuals of frames: the errors are 1.* times the configured noise",
    ),
    "loud, NEES": (
        replace(BEACON, simulate=_loud),
        "covariance_is_true",
        r"\(NEES\): the errors are 2.* times the configured noise",
    ),
    "world": (
        replace(BEACON, simulate=_in_the_world),
        "moving_sensor_and_scene_together_changes_nothing",
        "depends on where the sensor stands: simulate it by T_w_s",
    ),
    "fragile": (
        replace(BEACON, decode=_fragile),
        "damaged_message_is_an_error_or_a_whole_answer",
        r"point\.x not finite: decode raised ZeroDivisionError; raise rigcal\.errors\.Rec",
    ),
    "too sure": (
        replace(BEACON, residual=None, combine=_too_sure),
        "frames_together_know_more_and_not_too_much",
        "8 frames together: the errors are 4.* times the configured noise",
    ),
    "one for all": (
        replace(BEACON, combine=lambda candidates, *_: candidates[0]),
        "frames_together_know_more_and_not_too_much",
        "8 frames together say 1.00 times as much as one",
    ),
    "no stamp": (
        replace(BEACON, encode=_unstamped),
        "messages_carry_the_stamp_and_frame_that_they_are_given",
        r"header of its message says \(0, 'kit_sensor'\): fill it by ros.header",
    ),
    "no frame": (
        replace(BEACON, encode=_unframed),
        "messages_carry_the_stamp_and_frame_that_they_are_given",
        r"encode was given .* says \(\d+, ''\)",
    ),
    "no stamp beside": (
        replace(BEACON, extra_messages=_info),
        "messages_carry_the_stamp_and_frame_that_they_are_given",
        "extra_messages 'info' was given",
    ),
    "sure of its geometry": (
        _reporting(1 / 9),
        "covariance_of_the_geometry_is_true",
        r"errors at the truth are [23]\.\d+ times as large as its covariance says",
    ),
    "sure of one axis": (
        _reporting([1, 1 / 3, 1]),
        "covariance_of_the_geometry_is_true",
        "times as large as its covariance says",
    ),
    "sure of its detection": (
        _reporting(1 / 9),
        "noise_of_frames_is_the_configured_one",
        "the geometry of detections: the errors",
    ),
    "unsure of its geometry": (
        _reporting(16),
        "covariance_of_the_geometry_is_true",
        "only .* times what its covariance says",
    ),
    "echo": (
        replace(BEACON, near=_echo),
        "second_look_shows_nothing_where_nothing_is",
        "it answers with the prediction, which is not there",
    ),
    "all-seeing": (
        replace(BEACON, sees=lambda p, _: np.ones(len(p), bool)),
        "board_out_of_view_leaves_no_trace",
        "`sees` says yes to everything around the sensor",
    ),
    "sightless": (
        replace(BEACON, sees=lambda p, _: np.zeros(len(p), bool)),
        "board_in_view_is_in_the_frame",
        "only 0 are wholly in view: override `poses`",
    ),
    "visibility": (
        replace(BEACON, sees=lambda p, _: p[:, 0] < 0),
        "board_out_of_view_leaves_no_trace",
        "the frame of a board out of view, T_s_t =",
    ),
    "extra keys": (
        replace(BEACON, config=OpenConfig),
        "config_is_in_the_schema",
        "OpenConfig takes keys that it does not know",
    ),
    "nan": (
        replace(BEACON, config=LooseConfig),
        "numbers_that_are_not_finite_are_refused",
        "sigma_m: nan is taken; rigcal",
    ),
    "trusting": (
        replace(BEACON, detect=_trusting),
        "empty_message_is_an_error_or_shows_nothing",
        "decode took it, and detect raised ZeroDivisionError; refuse it in decode with",
    ),
}
"""Sensor type, the check that it fails, and what that says of it."""


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_fails_its_check_which_says_what_is_wrong(fault: str, tmp_path: Path) -> None:
    kind, check, said = FAULTS[fault]
    with pytest.raises((AssertionError, ObservationError), match=said):
        getattr(stage_of(kind, tmp_path), f"test_{check}")()


def test_a_detector_may_state_what_it_does_not_measure_as_unknown(tmp_path: Path) -> None:
    stage_of(_reporting([1, 1e4, 1e4]), tmp_path).test_covariance_of_the_geometry_is_true()


def test_a_residual_that_raises_at_a_pose_is_told_what_to_raise(tmp_path: Path) -> None:
    stage = stage_of(_twisted(rows=_unready), tmp_path)
    message = r"measurement 'p' not finite: the residual raised FloatingPointError; raise rigcal"
    with pytest.raises(AssertionError, match=message):
        stage.test_damaged_measurement_is_an_error_or_a_whole_residual("not finite")


def _point_file(stage: Any, T_s_t: Array, config: Any, rng: np.random.Generator) -> Message:
    path = stage.folder / "point.xyz"
    path.write_text(" ".join(map(str, T_s_t[:3, 3])))
    return Message(".xyz", path, 0, "0", "point.xyz")


def _decode_file(message: Message, config: Any) -> Array:
    x, y, z = message.value.read_text().split()
    return np.array([x, y, z], float)


def _decode_file_or_refuse(message: Message, config: Any) -> Array:
    try:
        return _decode_file(message, config)
    except (OSError, ValueError) as error:
        raise RecordingError(f"{message.origin}: expected three numbers") from error


def test_a_decoder_that_raises_on_a_truncated_file_is_told_what_to_raise(tmp_path: Path) -> None:
    reader = replace(BEACON, simulate=None, encode=None, message_types=(".xyz",))
    careful, careless = (
        stage_of(replace(reader, decode=decode), tmp_path, message=_point_file)
        for decode in (_decode_file_or_refuse, _decode_file)
    )
    careful.test_truncated_file_is_an_error_or_a_whole_answer()
    message = r"point\.xyz: decode raised ValueError; raise rigcal\.errors\.RecordingError"
    with pytest.raises(AssertionError, match=message):
        careless.test_truncated_file_is_an_error_or_a_whole_answer()


def test_a_message_without_a_header_has_no_stamp_to_carry(tmp_path: Path) -> None:
    bare = "geometry_msgs/msg/Point"

    def encode(frame: Array, config: Any, stamp_ns: int, frame_id: str) -> Any:
        return ros.make(bare, **dict(zip("xyz", frame, strict=True)))

    kind = replace(BEACON, message_types=(bare,), message_type=bare, encode=encode)
    stage_of(kind, tmp_path).test_messages_carry_the_stamp_and_frame_that_they_are_given()


def test_a_class_without_a_config_is_told() -> None:
    with pytest.raises(TypeError, match="Bare: set `config` in the class"):

        class Bare(SensorConformance):
            sensor_type = BEACON


def test_what_is_not_offered_takes_the_place_of_its_check() -> None:
    class Silent(SensorConformance):
        sensor_type = replace(BEACON, sees=None, simulate=None, encode=None)
        config = BeaconConfig()

    marks = Silent.test_board_out_of_view_leaves_no_trace.pytestmark  # type: ignore[attr-defined]
    assert marks[0].kwargs["ids"] == ["not offered: simulate", "not offered: sees"]
    assert not hasattr(Silent.test_config_survives_a_round_trip, "pytestmark")

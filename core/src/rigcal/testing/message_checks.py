"""Checks of decoding: what comes back from a recording, and what happens to damaged data."""

from __future__ import annotations

import copy
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from rigcal.errors import RecordingError
from rigcal.plugin.answers import check_detection
from rigcal.recording import Message, Source, open_recording, ros
from rigcal.recording.writer import RecordingWriter
from rigcal.testing.capability import needs
from rigcal.testing.same import assert_same
from rigcal.testing.stage import Stage

_HEADER = (1_700_000_000_123_456_789, "kit_sensor")
_DELAY_NS = 40_000_000
"""A message is recorded later than it was measured: its log time is not its stamp."""

_SPOILT = ("empty", "truncated", "longer", "not finite", "huge")


class MessageChecks(Stage):
    """Messages come back from MCAP and .bag as they went in; damaged ones get a named error."""

    @needs("simulate", "encode")
    def test_frame_survives_its_message(self) -> None:
        rng = np.random.default_rng(0)
        (T_s_t,) = self.poses(rng, 1)
        frame = self.simulate(T_s_t, self.config, np.random.default_rng(1))
        message = self.message(T_s_t, self.config, np.random.default_rng(1))
        # Messages of ROS hold their numbers in single precision.
        assert_same(frame, self.sensor_type.decode(message, self.config), 1e-6)

    @needs("simulate", "encode")
    def test_message_survives_a_recording(self) -> None:
        assert self.sensor_type.message_type in self.sensor_type.message_types
        rng = np.random.default_rng(0)
        (T_s_t,) = self.poses(rng, 1)
        message = self.message(T_s_t, self.config, rng)
        frames = [self.sensor_type.decode(message, self.config)]
        for suffix in (".mcap", ".bag"):
            path = self.folder / f"recording{suffix}"
            with RecordingWriter(path) as writer:
                writer.write("/sensor", message.type, message.value, message.stamp_ns)
            with open_recording(path, self.sensor_type.message_definitions) as recording:
                (read,) = recording.read(Source(topic="/sensor"))
            assert (read.type, read.stamp_ns) == (message.type, message.stamp_ns)
            frames.append(self.sensor_type.decode(read, self.config))
        assert_same(frames[1], frames[2], where="the frame from an MCAP and from a .bag")
        # A message may hold more digits before it is written in single precision.
        assert_same(frames[0], frames[1], 1e-6)

    @needs("simulate", "encode")
    def test_messages_carry_the_stamp_and_frame_that_they_are_given(self) -> None:
        """In their header, where their type has one, as a recording gives them back."""
        kind, rng = self.sensor_type, np.random.default_rng(0)
        assert kind.encode is not None
        frame = self.simulate(self.poses(rng, 1)[0], self.config, rng)
        made = {"encode": (kind.message_type, kind.encode(frame, self.config, *_HEADER))}
        if kind.extra_messages is not None:
            extra = kind.extra_messages(self.config, *_HEADER).items()
            made |= {f"extra_messages '{suffix}'": message for suffix, message in extra}
        path = self.folder / "stamped.mcap"
        with RecordingWriter(path) as writer:
            for i, (name, value) in enumerate(made.values()):
                writer.write(f"/sensor/{i}", str(name), value, _HEADER[0] + _DELAY_NS)
        with open_recording(path, kind.message_definitions) as recording:
            for i, what in enumerate(made):
                (read,) = recording.read(Source(topic=f"/sensor/{i}"))
                header = getattr(read.value, "header", None)
                if header is not None:
                    stamp_ns = header.stamp.sec * 10**9 + header.stamp.nanosec
                    found = (stamp_ns, header.frame_id)
                    assert found == _HEADER, (
                        f"{what} was given stamp_ns and frame_id {_HEADER}, and the header of its "
                        f"message says {found}: fill it by ros.header(stamp_ns, frame_id)"
                    )

    @needs("messages")
    def test_decoding_is_deterministic_and_leaves_the_message_alone(self) -> None:
        rng = np.random.default_rng(0)
        message = self.message(self.poses(rng, 1)[0], self.config, rng)
        before = copy.deepcopy(message)
        first = self.sensor_type.decode(message, self.config)
        assert_same(first, self.sensor_type.decode(message, self.config))
        assert_same(before, message)

    def test_empty_message_is_an_error_or_shows_nothing(self) -> None:
        for kind in self.sensor_type.message_types:
            if "/" in kind:
                value = ros.make(kind, self.sensor_type.message_definitions)
                assert self._survives(Message(kind, value, 0, None, "an empty message")) is None

    @needs("simulate", "encode")
    def test_damaged_message_is_an_error_or_a_whole_answer(self) -> None:
        rng = np.random.default_rng(0)
        message = self.message(self.poses(rng, 1)[0], self.config, rng)
        for what, value in _spoilt_messages(message.value):
            origin = f"a message with {what}"
            self._survives(Message(message.type, value, message.stamp_ns, None, origin))

    def test_damaged_file_is_an_error_or_shows_nothing(self) -> None:
        for suffix in [kind for kind in self.sensor_type.message_types if "/" not in kind]:
            for name, content in {
                "empty": b"",
                "bytes": bytes(range(256)) * 3,
                "words": b"range,angle\nfar,left\n",
                "nans": b"nan,nan,nan,nan\n" * 3,
            }.items():
                path = self.folder / f"{name}{suffix}"
                path.write_bytes(content)
                found = self._survives(Message(suffix, path, 0, "0", path.name))
                assert not found, f"{path.name} shows the target: {found}"
            absent = self.folder / f"absent{suffix}"
            assert self._survives(Message(suffix, absent, 0, "0", absent.name)) is None

    @needs("messages")
    def test_truncated_file_is_an_error_or_a_whole_answer(self) -> None:
        rng = np.random.default_rng(0)
        message = self.message(self.poses(rng, 1)[0], self.config, rng)
        if isinstance(message.value, Path):
            content = message.value.read_bytes()
            for share in (0.1, 0.5, 0.9):
                message.value.write_bytes(content[: int(share * len(content))])
                self._survives(message)

    def _survives(self, message: Message) -> Any:
        """The candidates; None for a RecordingError or a detection that says why there are none."""
        with np.errstate(all="ignore"):  # damaged numbers may overflow
            return self._outcome(message)

    def _outcome(self, message: Message) -> Any:
        try:
            frame = self.sensor_type.decode(message, self.config)
        except RecordingError as error:
            assert message.origin in str(error), (
                f"the error does not say where: {error!r}; begin it with `message.origin`"
            )
            return None
        except Exception as error:
            raise AssertionError(
                f"{message.origin}: decode raised {type(error).__name__}; "
                "raise rigcal.errors.RecordingError that says what was found and expected"
            ) from error
        try:
            found = self.sensor_type.detect(frame, self.config, self.target)
            check_detection(found)
        except Exception as error:
            raise AssertionError(
                f"{message.origin}: decode took it, and detect raised {type(error).__name__}; "
                "refuse it in decode with RecordingError, or return Detection((), reason)"
            ) from error
        return found.candidates or None


def _spoilt_messages(value: Any) -> Iterator[tuple[str, Any]]:
    """Copies of a message, each with one field spoilt in one way."""
    for name, field in vars(value).items():
        if name.startswith("_") or name == "header":
            continue
        spoilt = [(f"{name} {how}", bad) for how in _SPOILT for bad in _spoil(field, how)]
        spoilt += [(f"{name}.{what}", bad) for what, bad in _spoilt_parts(field)]
        for what, bad in spoilt:
            damaged = copy.copy(value)
            setattr(damaged, name, bad)
            yield what, damaged


def _spoilt_parts(field: Any) -> Iterator[tuple[str, Any]]:
    """A message, or a list of them, within a message: the same in each."""
    if isinstance(field, list) and field and hasattr(field[0], "__dict__"):
        for what, item in _spoilt_messages(field[0]):
            yield what, [item] * len(field)
    elif hasattr(field, "__dict__"):
        yield from _spoilt_messages(field)


def _spoil(field: Any, how: str) -> Iterator[Any]:
    """The field in the damaged form; nothing if it has none."""
    if isinstance(field, np.ndarray | list) and how in ("empty", "truncated", "longer"):
        keep = {"empty": 0, "truncated": len(field) // 2 - 1, "longer": len(field)}[how]
        extra = field[:1] if how == "longer" else field[:0]
        part = field[: max(keep, 0)]
        yield np.concatenate([part, extra]) if isinstance(field, np.ndarray) else [*part, *extra]
    elif isinstance(field, np.ndarray) and how == "not finite" and field.dtype.kind == "f":
        yield np.full_like(field, np.nan)
    elif isinstance(field, float) and how in ("not finite", "huge"):
        yield np.nan if how == "not finite" else 1e30
    elif isinstance(field, int) and how in ("empty", "huge"):
        yield 0 if how == "empty" else 2**31 - 1

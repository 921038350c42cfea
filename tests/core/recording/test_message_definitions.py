"""Message types that a plugin defines: written, read, and read from bags that carry nothing."""

from __future__ import annotations

import pickle
import sqlite3
import struct
from pathlib import Path
from typing import Any

import pytest
from rosbags.interfaces import (
    Connection,
    ConnectionExtRosbag2,
    MessageDefinition,
    MessageDefinitionFormat,
)
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Writer2

from rigcal.errors import PluginError, RecordingError
from rigcal.recording import Source, open_recording, ros
from rigcal.recording.types import deserializer
from rigcal.recording.writer import RecordingWriter

SONAR, ECHO = "acme_msgs/msg/Sonar", "acme_msgs/msg/Echo"
DEFINITIONS = {
    SONAR: "std_msgs/Header header\nacme_msgs/Echo[] echoes\nacme_msgs/Echo best\nfloat32[] wave",
    ECHO: "float64 range\nstring note",
}


def _sonar() -> Any:
    echoes = [ros.make(ECHO, DEFINITIONS, range=1.5 + i, note=f"echo {i}") for i in range(3)]
    header = ros.header(5 * 10**9, "bow")
    return ros.make(SONAR, DEFINITIONS, header=header, echoes=echoes, wave=[0.5, 0.25])


def _check(value: Any) -> None:
    assert [echo.range for echo in value.echoes] == [1.5, 2.5, 3.5]
    assert value.echoes[2].note == "echo 2"
    assert value.best.range == 0.0
    assert value.wave.tolist() == [0.5, 0.25]
    assert value.header.frame_id == "bow"


@pytest.mark.parametrize("suffix", [".mcap", ".bag"])
def test_a_defined_type_is_written_and_read_back(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"r{suffix}"
    with RecordingWriter(path) as writer:
        writer.write("/sonar", SONAR, _sonar(), 7)
    with open_recording(path) as recording:
        (message,) = recording.read(Source("/sonar"))
    assert (message.type, message.stamp_ns) == (SONAR, 5 * 10**9)
    _check(message.value)


def test_a_defined_message_can_be_sent_to_another_process() -> None:
    _check(pickle.loads(pickle.dumps(_sonar())))


def test_a_bag_without_definitions_is_read_with_those_of_the_plugin(tmp_path: Path) -> None:
    store = ros.typestore(DEFINITIONS)
    with Writer2(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        connection = writer.add_connection("/sonar", SONAR, typestore=store)
        writer.write(connection, 7, store.serialize_cdr(_sonar(), SONAR))
    with sqlite3.connect(tmp_path / "bag" / "bag.db3") as database:
        database.execute("DELETE FROM message_definitions")
    database.close()
    with (
        open_recording(tmp_path / "bag") as recording,
        pytest.raises(RecordingError, match="is not defined in the recording"),
    ):
        list(recording.read(Source("/sonar")))
    with open_recording(tmp_path / "bag", DEFINITIONS) as recording:
        (message,) = recording.read(Source("/sonar"))
    _check(message.value)


def test_a_wrong_definition_or_type_is_named() -> None:
    with pytest.raises(PluginError, match="definition of message type 'acme_msgs/msg/Echo' cannot"):
        ros.make(ECHO, {ECHO: "float64 5range"})
    with pytest.raises(RecordingError, match=r"'acme_msgs/msg/Ping' is not .* nor of the plugin"):
        ros.make("acme_msgs/msg/Ping", DEFINITIONS)


IDL = "".join(
    f"{'=' * 80}\nIDL: acme_msgs/msg/{name}\nmodule acme_msgs {{ module msg {{ {text} }}; }};\n"
    for name, text in (
        ("Ping", "struct Ping { double range; acme_msgs::msg::Note note; };"),
        ("Note", "struct Note { string text; };"),
    )
)


def test_a_bag_may_carry_its_types_as_idl() -> None:
    """Some recorders write IDL in place of .msg text, several types one after the other."""
    definition = MessageDefinition(MessageDefinitionFormat.IDL, IDL)
    connection = Connection(
        1, "/ping", "acme_msgs/msg/Ping", definition, "", 1, ConnectionExtRosbag2("cdr", []), None
    )
    cdr = struct.pack("<4sdI6s", bytes([0, 1, 0, 0]), 2.5, 6, b"hello\0")
    message = deserializer([connection], 2, compressed=False)(cdr)
    assert (message.range, message.note.text) == (2.5, "hello")

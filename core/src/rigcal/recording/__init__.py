"""Messages of bags and folders, streamed; and the writer."""

from rigcal.recording.format import RecordingFormat
from rigcal.recording.message import Message, Recording, Source, TimedRecording
from rigcal.recording.nearest import nearest_message
from rigcal.recording.open import BUILTIN_FORMATS, open_recording

__all__ = [
    "BUILTIN_FORMATS",
    "Message",
    "Recording",
    "RecordingFormat",
    "Source",
    "TimedRecording",
    "nearest_message",
    "open_recording",
]

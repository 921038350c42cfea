"""Messages of bags and folders, streamed; and the writer."""

from rigcal.recording.message import Message, Recording, Source
from rigcal.recording.open import open_recording

__all__ = ["Message", "Recording", "Source", "open_recording"]

"""Messages of bags and folders, streamed; and the writer."""

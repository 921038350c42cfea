"""Which frames show the board in the same pose, and what they say together."""

"""Settings of all tests."""

from hypothesis import settings

# A test asserts behaviour, not time; and the same code gets the same answer on every run.
settings.register_profile("rigcal", deadline=None, derandomize=True)
settings.load_profile("rigcal")

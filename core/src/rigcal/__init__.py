"""Extrinsic calibration of any mix of cameras, laser range finders and other sensors."""

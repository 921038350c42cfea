"""SE(3), planes and polygons: plain functions on arrays (see docs/conventions.md)."""

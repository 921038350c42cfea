"""The simulated world that a sensor plugin's simulator looks at: shapes in frame w."""

from rigcal.scene.scene import Scene
from rigcal.scene.shapes import Cylinder, Shape, Sphere
from rigcal.scene.surface import Surface

__all__ = ["Cylinder", "Scene", "Shape", "Sphere", "Surface"]

"""Objects that tasks put into the scene, made of primitives: one file each."""

from __future__ import annotations

from aerial_il.suite.props.bowl import add_bowl
from aerial_il.suite.props.cube import CUBE_HALF_M, add_cube
from aerial_il.suite.props.table import FALLEN_M, TABLE_HEIGHT_M, add_table

__all__ = ["CUBE_HALF_M", "FALLEN_M", "TABLE_HEIGHT_M", "add_bowl", "add_cube", "add_table"]

"""Height fields: horizons, sky view, shadows and global illumination of terrain."""

from .field import HeightField
from .fields import FIELDS, example, make

__all__ = ["FIELDS", "HeightField", "example", "make"]

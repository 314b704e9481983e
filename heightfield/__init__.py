"""Height fields: horizons, sky view, shadows and global illumination of terrain."""

from .field import HeightField
from .fields import FIELDS, example, make
from .tiles import tiles

__all__ = ["FIELDS", "HeightField", "example", "make", "tiles"]

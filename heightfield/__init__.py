"""Height fields: horizons, sky view, shadows and global illumination of terrain."""

import os

# OpenMP's threads wait asleep between kernels: spinning, they take the cores from Dr.Jit's, and every other program's, work
# (five times the time on two cores). OpenMP reads this when numba loads it, at the first kernel.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")

from .field import HeightField
from .fields import FIELDS, example, make
from .tiles import tiles

__all__ = ["FIELDS", "HeightField", "example", "make", "tiles"]

"""Exact solutions of saturated porous media; NumPy and SciPy only, and nothing of the package: they judge it.

Depth z [m] is measured downward from the drained surface in the reference configuration, settlement is positive downward and
pressure in compression.  Sudden loads act from t = 0+.
"""

from .confined import UNIAXIAL, confined_ratio
from .consolidation import Terzaghi, XieLeo
from .dynamic import DynamicColumn
from .mandel import Mandel
from .selfweight import Selfweight
from .strip import StripFooting

__all__ = ["UNIAXIAL", "DynamicColumn", "Mandel", "Selfweight", "StripFooting", "Terzaghi", "XieLeo", "confined_ratio"]

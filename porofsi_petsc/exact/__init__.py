"""Exact solutions of porous media, of free flows, of a ring and of bodies in a fluid.

NumPy and SciPy only, and nothing of the package: they judge it.

In porous layers depth z [m] is measured downward from the drained surface in the reference
configuration, settlement is positive downward and pressure in compression.  Sudden loads act from t
= 0+.
"""

from .confined import confined_ratio
from .consolidation import Terzaghi, XieLeo
from .cryer import Cryer
from .dynamic import CompressibleColumn, DynamicColumn
from .elastica import HeavyElastica
from .falling import FallingCylinder
from .flows import EthierSteinman, Kovasznay, TaylorGreen
from .jeffery import JefferyOrbit
from .mandel import Mandel
from .ring import Ring
from .seabed import Seabed
from .selfweight import Selfweight
from .strip import StripFooting
from .unconfined import UnconfinedCylinder, UnconfinedStrip
from .womersley import TetheredTube, WomersleyChannel, WomersleyPipe

__all__ = [
    "CompressibleColumn",
    "Cryer",
    "DynamicColumn",
    "EthierSteinman",
    "FallingCylinder",
    "HeavyElastica",
    "JefferyOrbit",
    "Kovasznay",
    "Mandel",
    "Ring",
    "Seabed",
    "Selfweight",
    "StripFooting",
    "TaylorGreen",
    "Terzaghi",
    "TetheredTube",
    "UnconfinedCylinder",
    "UnconfinedStrip",
    "WomersleyChannel",
    "WomersleyPipe",
    "XieLeo",
    "confined_ratio",
]

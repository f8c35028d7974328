"""Conditions on surfaces by the names that [[boundary]] gives them: adding one is one file and one
line here, or `register` in a script.
"""

from ..registry import Registry
from .backflow import Backflow
from .condition import LowRank, Slope, State, Surface, SurfaceCondition
from .contract import check_condition
from .flux import Flux
from .impedance import Absorbing, Dashpot, Spring
from .pressure import DeadPressure, FollowerPressure
from .seepage import Seepage
from .traction import DeadLoad, Traction
from .windkessel import Windkessel

__all__ = [
    "CONDITIONS",
    "DeadLoad",
    "LowRank",
    "Slope",
    "State",
    "Surface",
    "SurfaceCondition",
]

CONDITIONS = Registry(
    "boundary condition",
    "porofsi_petsc.conditions",
    {
        "traction": Traction,
        "dead_pressure": DeadPressure,
        "follower_pressure": FollowerPressure,
        "spring": Spring,
        "dashpot": Dashpot,
        "absorbing": Absorbing,
        "flux": Flux,
        "seepage": Seepage,
        "backflow": Backflow,
        "windkessel": Windkessel,
    },
    reserved=("on", "displacement", "velocity", "inflow", "pressure", "no_slip", "priority"),
    taken=[name for name in dir(SurfaceCondition) if not name.startswith("_")] + ["surface"],
    check=check_condition,
)

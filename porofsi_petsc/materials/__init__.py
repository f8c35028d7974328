"""Constitutive laws by the names that scenes give them: registering a law is adding one line, or
`register` in a script.
"""

from ..registry import Registry, parameter
from .contract import check_elastic
from .elastic import (
    EhlersEipper,
    ElasticLaw,
    Harmonic,
    LinearElastic,
    NeoHookean,
    NeoHookeanJ2,
    SaintVenantKirchhoff,
    XieLeo,
)
from .from_energy import FromEnergy
from .mooney_rivlin import MooneyRivlin
from .permeability import PERMEABILITY, PermeabilityLaw

ELASTIC = Registry(
    "elastic law",
    "porofsi_petsc.elastic",
    {
        "linear_elastic": LinearElastic,
        "saint_venant_kirchhoff": SaintVenantKirchhoff,
        "neo_hookean": NeoHookean,
        "neo_hookean_j2": NeoHookeanJ2,
        "mooney_rivlin": MooneyRivlin,
        "xie_leo": XieLeo,
        "ehlers_eipper": EhlersEipper,
    },
    taken=("lambda", "lambda_", "lam", "mu", "n_s0", "young", "poisson", "density"),
    check=check_elastic,
)

MESH_MOTION = {"harmonic": Harmonic, "linear_elastic": LinearElastic, "neo_hookean": NeoHookean}

__all__ = [
    "ELASTIC",
    "MESH_MOTION",
    "PERMEABILITY",
    "ElasticLaw",
    "FromEnergy",
    "PermeabilityLaw",
    "parameter",
]

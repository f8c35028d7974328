"""Constitutive laws by the names that scenes give them: registering a law is adding one line, or
`register` in a script.
"""

from ..registry import Registry, parameter
from .contract import check_elastic
from .distortion import Distortion
from .drucker_prager import DruckerPrager
from .elastic import ElasticLaw
from .from_energy import FromEnergy
from .holmes_mow import HolmesMow
from .holzapfel import HolzapfelGasserOgden
from .linear import Harmonic, LinearElastic
from .mooney_rivlin import MooneyRivlin
from .neo_hookean import EhlersEipper, NeoHookean, NeoHookeanJ2, XieLeo
from .ogden import Ogden
from .permeability import PERMEABILITY, PermeabilityLaw
from .saint_venant_kirchhoff import SaintVenantKirchhoff
from .transversely_isotropic import TransverselyIsotropic

ELASTIC = Registry(
    "elastic law",
    "porofsi_petsc.elastic",
    {
        "linear_elastic": LinearElastic,
        "saint_venant_kirchhoff": SaintVenantKirchhoff,
        "neo_hookean": NeoHookean,
        "neo_hookean_j2": NeoHookeanJ2,
        "mooney_rivlin": MooneyRivlin,
        "ogden": Ogden,
        "holmes_mow": HolmesMow,
        "transversely_isotropic": TransverselyIsotropic,
        "holzapfel_gasser_ogden": HolzapfelGasserOgden,
        "drucker_prager": DruckerPrager,
        "xie_leo": XieLeo,
        "ehlers_eipper": EhlersEipper,
    },
    taken=("lambda", "lambda_", "lam", "mu", "n_s0", "prony", "young", "poisson", "density"),
    check=check_elastic,
)

MESH_MOTION = {
    "harmonic": Harmonic,
    "linear_elastic": LinearElastic,
    "neo_hookean": NeoHookean,
    "distortion": Distortion,
}

__all__ = [
    "ELASTIC",
    "MESH_MOTION",
    "PERMEABILITY",
    "ElasticLaw",
    "FromEnergy",
    "PermeabilityLaw",
    "parameter",
]

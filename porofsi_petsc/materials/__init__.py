"""Tables of the constitutive laws: registering a law is adding one line."""

from .elastic import EhlersEipper, Harmonic, LinearElastic, NeoHookean, NeoHookeanJ2, SaintVenantKirchhoff, XieLeo
from .permeability import constant, ehlers_eipper, kozeny_carman, markert, xie_leo

ELASTIC = {
    "linear_elastic": LinearElastic,
    "saint_venant_kirchhoff": SaintVenantKirchhoff,
    "neo_hookean": NeoHookean,
    "neo_hookean_j2": NeoHookeanJ2,
    "xie_leo": XieLeo,
    "ehlers_eipper": EhlersEipper,
}

MESH_MOTION = {"harmonic": Harmonic, "linear_elastic": LinearElastic, "neo_hookean": NeoHookean}

PERMEABILITY = {
    "constant": constant,
    "markert": markert,
    "ehlers_eipper": ehlers_eipper,
    "kozeny_carman": kozeny_carman,
    "xie_leo": xie_leo,
}

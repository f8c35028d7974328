"""Conditions on surfaces without a scene."""

import numpy as np

from porofsi_petsc.conditions import CONDITIONS, State
from porofsi_petsc.fem.surface import Surface
from porofsi_petsc.phases.surface_terms import OnSurface, SurfaceTerms


def on_surface(domain, tag, name, **given):
    """Return a condition on a tag of a domain whose material it does not ask for."""
    return OnSurface(CONDITIONS[name](**given), Surface(domain, tag, {}), f"{name}:{tag}")


def traction(domain, tag, formulas):
    """Return the traction of formulas, one for each component."""
    return on_surface(domain, tag, "traction", value=dict(enumerate(formulas)))


def flux(domain, tag, formula):
    """Return the seepage of a formula."""
    return on_surface(domain, tag, "flux", value=formula)


def residual(domain, k, place, t):
    """Return what a dead load adds to a residual of k components at a time, (n_owned, k)."""
    terms = SurfaceTerms(domain.n_owned, k, [place])
    nodal = np.zeros((domain.n_owned, k))
    for nodes, vectors in terms.given(State(t, None, None)):
        owned = nodes < domain.n_owned
        np.add.at(nodal, nodes[owned], vectors[owned])
    return nodal

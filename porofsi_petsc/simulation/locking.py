"""Elements that cannot keep their volume and bend: linear ones of a nearly incompressible solid,
and of one that flows, which lock.
"""

from pathlib import Path

import numpy as np

from ..config import Scene
from ..config.fields import Cells
from ..config.material import Solid
from ..errors import InputError, digits
from ..mesh.mesh import Mesh


def require_no_locking(scene: Scene, mesh: Mesh, where: str | Path) -> None:
    """Raise InputError where a solid without pores has linear elements and a larger Poisson ratio
    than [limits] locking, and where a plastic one, with or without pores, has linear elements.
    """
    bound = scene.limits.locking
    if mesh.element.order > 1 or bound == "report":
        return
    for i, material in enumerate(scene.material):
        if material.solid and material.elastic_law().plastic:
            raise InputError(
                f"{where} [material.{i}.solid.law]: received '{material.solid.law}' on linear"
                " elements, which lock in a plastic flow: loads come out too large; take quadratic"
                " elements (mesh.order = 2, a mesh file of second order), or set limits.locking to"
                ' "report"'
            )
        solid = material.solid if material.kind == "solid" else None
        if solid and (nu := _largest_poisson(solid, mesh, material.region)) > bound:
            raise InputError(
                f"{where} [material.{i}.solid]: received a Poisson ratio of {digits(nu)} on linear"
                f" elements, expected {digits(bound)} at most, because they lock: displacements"
                " come out too small (docs/locking.md); take quadratic elements (mesh.order = 2, a"
                " mesh file of second order), or set limits.locking to a larger bound or to"
                ' "report"'
            )


def _largest_poisson(solid, mesh, regions):
    """Return the largest Poisson ratio in the cells of some regions."""
    if not solid.is_graded:
        return poisson(solid)
    chosen = [i for i, name in enumerate(mesh.regions) if regions == ("all",) or name in regions]
    here = np.isin(mesh.cell_region, chosen)
    centres = mesh.points[mesh.cells[here]].mean(axis=1)
    values = {name: array[here] for name, array in mesh.values.items()}
    lam, mu = solid.lame(Cells(centres, values))
    return round(np.max(lam / (2 * (lam + mu))), 12)


def poisson(solid: Solid) -> float:
    """Return ν = λ/(2 (λ + μ)) of a `config.material.Solid` [-], without the round-off of a given
    one.
    """
    lam = solid.lambda_
    mu = solid.mu
    assert lam is not None and mu is not None  # `Solid` has made them of other parameters
    return round(lam / (2 * (lam + mu)), 12)

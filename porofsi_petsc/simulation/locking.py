"""Elements that cannot keep their volume and bend: linear ones of a nearly incompressible solid,
which lock.
"""

from ..errors import InputError, digits


def require_no_locking(scene, mesh, where):
    """Raise InputError where a solid without pores has linear elements and a larger Poisson ratio
    than [limits] locking.
    """
    bound = scene.limits.locking
    if mesh.element.order > 1 or bound == "report":
        return
    for i, material in enumerate(scene.material):
        if material.kind == "solid" and (nu := poisson(material.solid)) > bound:
            raise InputError(
                f"{where} [material.{i}.solid]: received a Poisson ratio of {digits(nu)} on linear"
                f" elements, expected {digits(bound)} at most, because they lock: displacements"
                " come out too small (docs/locking.md); take quadratic elements (mesh.order = 2, a"
                " mesh file of second order), or set limits.locking to a larger bound or to"
                ' "report"'
            )


def poisson(solid):
    """Return ν = λ/(2 (λ + μ)) of a `config.material.Solid` [-], without the round-off of a given
    one.
    """
    return round(solid.lambda_ / (2 * (solid.lambda_ + solid.mu)), 12)

"""Random states of a few elements and central differences for the tests of the kernels."""

from dataclasses import replace

import numpy as np

from porofsi_petsc.elements import ELEMENTS
from porofsi_petsc.fem.geometry import Rule, SecondDerivatives, geometry
from porofsi_petsc.kernels import flow
from porofsi_petsc.materials import ELASTIC
from porofsi_petsc.materials.drag import Anisotropy, Drag

# Central differences of step h lose h² of truncation and eps/h of round-off: about 1e-9 relative at
# h = 1e-6 of the scale.
FD_STEP = 1e-6
FD_TOLERANCE = 2e-7
RINGS = {f"ring of {name}": ELEMENTS[name].around_axis() for name in ("T3", "T6")}
SHAPES = ELEMENTS | RINGS
# A drag whose tensor has no zero entry: axes at 30° to those of the coordinates, in space to two.
TURNED = {
    2: Anisotropy((1.0, 0.2), ((0.75**0.5, 0.5), (-0.5, 0.75**0.5))),
    3: Anisotropy(
        (1.0, 0.2, 3.0),
        (
            (0.75**0.5, 0.5, 0.0),
            (-(0.125**0.5), 0.375**0.5, 0.5**0.5),
            (0.125**0.5, -(0.375**0.5), 0.5**0.5),
        ),
    ),
}
# Elements and laws: a loop asks the law for the stress at a point, whatever the element.
ON_ELEMENTS = [
    (name, law)
    for name in SHAPES
    for law in ELASTIC
    if name in ("T3", "T4") or law == "neo_hookean"
]


def central_difference(function, x):
    """Return d function / d x, (E, n_out, n_in), of a function on element vectors x (E, ...)."""
    flat = x.reshape(len(x), -1)
    columns = []
    for i in range(flat.shape[1]):
        step = np.zeros_like(flat)
        step[:, i] = FD_STEP
        plus = function((flat + step).reshape(x.shape))
        minus = function((flat - step).reshape(x.shape))
        columns.append((plus - minus).reshape(len(x), -1) / (2 * FD_STEP))
    return np.stack(columns, axis=-1)


def relative(a, b):
    """Return the largest difference over the largest entry."""
    return np.abs(a - b).max() / np.abs(b).max()


def distorted(element, rng, count=3):
    """Return coordinates (E, A, d) of elements a little away from the reference cell (curved for
    order 2); of rings a little away from the axis.
    """
    middle = element.node_coordinates + 0.3 * element.axisymmetric * np.eye(element.dim)[0]
    return middle + 0.06 * rng.standard_normal((count, element.nodes, element.dim))


def flow_chunk(element, rng, mu, convection, anisotropy=None):
    """Return elements and fields of a random state with every coefficient of order one."""
    X = distorted(element, rng)
    rule = Rule.of(element, 2 * element.order)
    E = len(X)
    Q = len(rule.weights)
    A = element.nodes
    d = element.dim

    def points():
        return 0.5 + rng.random((E, Q))

    def nodal(*shape):
        return rng.standard_normal((E, A, *shape))

    current = geometry(rule, X)
    second = None
    grad_n = None
    if mu and not element.has_constant_gradients:
        second = SecondDerivatives.at(rule, X, current, None)
        grad_n = rng.standard_normal((E, Q, d))
    symmetric = rng.standard_normal((E, Q, d, d))
    elements = flow.FlowElements(
        N=rule.N,
        geometry=current,
        n=points() / 2,
        rho=points(),
        drag=Drag(points(), anisotropy),
        mu=mu,
        tau=points(),
        tau_supg=points(),
        nu_lsic=points(),
        tau_u=symmetric @ np.swapaxes(symmetric, 2, 3),
        second=second,
        grad_n=grad_n,
        convection=convection,
        order=element.order,
    )
    fields = dict(
        v=nodal(d),
        a=nodal(d),
        v_m=nodal(d),
        v_s=nodal(d),
        p=nodal(),
        p_n=nodal(),
        b=rng.standard_normal((E, Q, d)),
    )
    return elements, fields


def free_chunk(element, rng, mu, convection):
    """Return elements and fields of `flow_chunk` for a free fluid; what it must not read is NaN or
    None.
    """
    elements, fields = flow_chunk(element, rng, mu, convection)
    free = dict(n=np.ones_like(elements.n), drag=None, tau_u=None, grad_n=None, free=True)
    return replace(elements, **free), {**fields, "v_s": None}

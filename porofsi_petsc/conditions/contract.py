"""What the rest of the package takes for granted of a condition, looked at on registration."""

import dataclasses
import itertools
import json
from dataclasses import dataclass

import numpy as np

from ..clock import first_order, second_order
from ..elements import FAMILIES
from ..kernels.surface import facet_normal, facet_normal_by_positions
from ..registry import examples, parameters
from .condition import Kind, Slope, State, SurfaceCondition

STEP = 1e-6  # of differences
# Errors of differences are of STEP² and 1e-16/STEP; a tangent that is wrong is off by parts of it.
SMALL = 1e-6
MATERIAL = {
    "rho_fR": 1.3,
    "rho_sR": 2.1,
    "viscosity": 0.2,
    "n_s0": 0.6,
    "rho_s": 1.26,
    "rho_f": 0.52,
    "is_compressible": 0.0,
    "drag0": 0.9,
    "undrained_modulus": 3.1,
    "shear_modulus": 1.7,
    "mobility": 1.1,
}
BY = {"fluid": Slope(0.0, 1.0), "solid": Slope(1.0, 3.0), "porous": Slope(1.0, 3.0)}


@dataclass(frozen=True)
class _Rule:
    N: np.ndarray
    dN: np.ndarray
    weights: np.ndarray


class SampleSurface:
    """Two facets beside each other, or the first of them, as `conditions.condition.Surface` wants
    them.
    """

    order = 1

    def __init__(self, dim: int, facets: int = 2) -> None:
        """Make two lines, or two triangles; with facets = 0 what a rank has that is elsewhere."""
        facet = FAMILIES[dim]["triangle" if dim == 2 else "tetrahedron"][0].facet
        assert facet is not None  # of a cell
        self._facet = facet
        points = [[0, 0], [1, 0.1], [1.9, 0.3]]
        if dim == 3:
            points = [[0, 0, 0], [1, 0.1, 0.2], [1.1, 1, 0.1], [0.1, 1, 0.3]]
        nodes = np.array([[0, 1], [1, 2]] if dim == 2 else [[0, 1, 2], [0, 2, 3]])
        self.nodes = nodes[:facets]
        self._points = np.array(points, dtype=float)
        self.n = len(points)

    @property
    def X(self) -> np.ndarray:
        """Return the reference positions of the nodes, (F, Af, d)."""
        return self._points[self.nodes]

    @property
    def depth(self) -> np.ndarray:
        """Return the volumes behind the facets over their areas, (F,)."""
        return np.full(len(self.nodes), 0.8)

    def rule(self, degree: int) -> _Rule:
        """Return the rule of a degree."""
        points, weights = self._facet.cell.quadrature(degree)
        return _Rule(self._facet.shape(points), self._facet.gradient(points), weights)

    def gather(self, field: np.ndarray) -> np.ndarray:
        """Return the values on the facets."""
        return field[self.nodes]

    def displacement(self, u: np.ndarray) -> np.ndarray:
        """Return the displacement on the facets, of cells that are there from the start."""
        return self.gather(u)

    def normal(self, rule: _Rule, u: np.ndarray | None = None) -> np.ndarray:
        """Return the normals times dA."""
        x = self.X if u is None else self.X + u[self.nodes]
        return facet_normal(rule.dN, rule.weights, x)

    def normal_by_positions(self, rule: _Rule, u: np.ndarray) -> np.ndarray:
        """Return the derivative of `normal` by the positions of the nodes, (F, Q, b, i, j)."""
        return facet_normal_by_positions(rule.dN, rule.weights, self.X + u[self.nodes])

    def of_material(self, name: str) -> np.ndarray:
        """Return an attribute of a material, (F, 1)."""
        return np.full((len(self.nodes), 1), MATERIAL[name])

    def sum(self, values: np.ndarray) -> float:
        """Return the sum of values (F,)."""
        return float(values.sum())


def sample(
    condition: type[SurfaceCondition], dim: int, kind: Kind, facets: int = 2
) -> SurfaceCondition:
    """Return a condition with its examples on a `SampleSurface` of a kind, in the first step."""
    found = condition(**{key: _value(condition, key) for key in examples(condition)})
    found.bind(SampleSurface(dim, facets))
    scheme = first_order if kind == "fluid" else second_order
    found.begin_step(scheme(0.5, 0.1), sample_state(dim)._replace(t=0.0))
    return found


def _value(condition, key):
    """Return an example; formulas are constant."""
    entry = parameters(condition)[key]

    def constant(number):
        return lambda t, X: np.full(len(X), float(number))

    if entry.kind == "number":
        return entry.example
    if entry.kind == "formula":
        return constant(entry.example)
    return {"xyz".index(axis): constant(number) for axis, number in entry.example.items()}


def check_condition(condition: type[SurfaceCondition]) -> None:
    """Raise ValueError where a condition breaks its contract in two or three dimensions.

    It says behind which materials it may be; its residual has a vector, or of the volume balance a
    number, for each node of a facet, and fails on no rank without facets; its tangent, local and of
    low rank, is the slope of the residual; it records what its columns name.
    """
    for other in condition.beside:
        check_condition(other)
    _check_class(condition)
    if "porous" in condition.behind:
        for dim in (2, 3):
            _check_exchange(condition, dim)
    for dim, kind in itertools.product((2, 3), condition.behind):
        body = sample(condition, dim, kind)
        _check_residual(body, dim)
        _check_elsewhere(condition, dim, kind)
        _check_memory(condition, dim, kind)
        if len(body.recorded()) != len(condition.columns):
            raise ValueError("`recorded` has not one value for each of `columns`")
        _check_tangent(condition, dim, kind)


def _check_class(condition):
    """Raise ValueError where the class itself is not what a registry wants."""
    if not dataclasses.is_dataclass(condition) or "__init__" not in vars(condition):
        raise ValueError("expected a dataclass; decorate the class with @dataclass")
    plain = {field.name for field in dataclasses.fields(condition)} - set(parameters(condition))
    if plain:
        raise ValueError(f"the field '{min(plain)}' is no parameter; give it by `parameter(...)`")
    behind = condition.behind
    if isinstance(behind, str) or not behind or set(behind) - set(BY):
        raise ValueError(f"received behind = {behind!r}, expected a tuple of {', '.join(BY)}")
    if condition.residual is SurfaceCondition.residual:
        raise ValueError("it has no `residual`")


def _check_residual(body, dim):
    residual = np.asarray(body.residual(sample_state(dim)))
    wanted = (*body.surface.nodes.shape, dim if body.balance == "momentum" else 1)
    if residual.shape != wanted:
        raise ValueError(f"received a residual of shape {residual.shape}, expected {wanted}")
    if not np.isfinite(residual).all():
        raise ValueError("received a residual that is not finite")


def _check_elsewhere(condition, dim, kind):
    """Raise ValueError where a condition fails on a rank that has none of its facets."""
    body = sample(condition, dim, kind, facets=0)
    state = sample_state(dim)
    try:
        _check_residual(body, dim)
        body.tangent(state, BY[kind])
        body.low_rank(state, BY[kind])
        if kind == "porous":
            body.exchange(state, BY[kind])
        body.accept(state)
    except (ValueError, IndexError, TypeError) as error:
        raise ValueError(f"a rank that has no facet of the surface: {error}") from error


def _check_memory(condition, dim, kind):
    """Raise ValueError where a condition that is loaded goes on otherwise than the one whose memory
    it has.
    """
    first, second = (sample(condition, dim, kind) for _ in range(2))
    first.accept(sample_state(dim))
    second.load(json.loads(json.dumps(first.memory())))
    scheme = first_order if kind == "fluid" else second_order
    state = sample_state(dim)
    for body in (first, second):
        body.begin_step(scheme(0.5, 0.1), state._replace(t=0.1))
    later = state._replace(t=0.17, u=1.1 * state.u, v=0.9 * state.v)
    same = np.array_equal(first.residual(later), second.residual(later))
    if not same or tuple(first.recorded()) != tuple(second.recorded()):
        raise ValueError("`memory` and `load` do not hold all that a restart needs")


def sample_state(dim: int) -> State:
    """Return a state in which fluid enters and leaves."""
    random = np.random.default_rng(dim)
    n = SampleSurface(dim).n
    u, v, c = (0.1 * random.standard_normal((n, dim)) for _ in range(3))
    return State(0.07, u, v - 0.3, c - 0.3, random.standard_normal(n), v_s=v)


def slopes(
    condition: type[SurfaceCondition], dim: int, kind: Kind
) -> tuple[np.ndarray, np.ndarray]:
    """Return the tangent of a condition, and the central differences of its residual by the unknown
    of its nodes, (n k, n k) each.
    """
    body = sample(condition, dim, kind)
    state = sample_state(dim)
    n = SampleSurface(dim).n
    k = _components(body, dim)
    moved = _moved if body.balance == "momentum" else _pressed
    differences = np.empty((n, k, n, k))
    for node, i in np.ndindex(n, k):
        ends = [
            _nodal(body, body.residual(moved(kind, state, node, i, sign * STEP)))
            for sign in (1, -1)
        ]
        differences[:, :, node, i] = (ends[0] - ends[1]) / (2 * STEP)
    return _tangent(body, state, BY[kind]), differences.reshape(n * k, n * k)


def _components(body, dim):
    """Return how many the balance of a condition has."""
    return dim if body.balance == "momentum" else 1


def _pressed(kind, state, node, component, step):
    """Return the state with another pressure."""
    p = state.p.copy()
    p[node] += step
    return state._replace(p=p)


def _moved(kind, state, node, component, step):
    """Return the state with another unknown."""
    change = np.zeros_like(state.v)
    change[node, component] = step
    slope = BY[kind]
    v = slope.v * change
    return state._replace(u=state.u + slope.u * change, v=state.v + v, c=state.c + v)


def _nodal(body, vectors):
    total = np.zeros((body.surface.n, vectors.shape[2]))
    np.add.at(total, body.surface.nodes, vectors)
    return total


def _tangent(body, state, slope):
    n = body.surface.n
    k = _components(body, state.u.shape[1])
    total = np.zeros((n, k, n, k))
    local = body.tangent(state, slope)
    if local is not None:
        i = np.arange(k)
        for nodes, K in zip(body.surface.nodes, local, strict=True):
            places = np.ix_(nodes, i, nodes, i)
            total[places] += K
    coupled = body.low_rank(state, slope)
    matrix = total.reshape(n * k, n * k)
    if coupled is not None:
        b = _nodal(body, coupled.vectors).ravel()
        matrix = matrix + coupled.factor * np.outer(b, b)
    return matrix


def _check_tangent(condition, dim, kind):
    tangent, expected = slopes(condition, dim, kind)
    if condition.dead and expected.any():
        raise ValueError("it is `dead`, but its residual depends on more than the time")
    free = kind == "fluid" or condition.follows or condition.unilateral
    if not free and not _is_linear(condition, dim, kind):
        raise ValueError(
            "its tangent is not symmetric or not constant, as that of a load that `follows` is"
        )
    if np.abs(tangent - expected).max() > SMALL * max(1.0, np.abs(expected).max()):
        raise ValueError("the tangent is not the slope of the residual")


def _is_linear(condition, dim, kind):
    """Return whether the tangent is symmetric and the same in another state."""
    body = sample(condition, dim, kind)
    state = sample_state(dim)
    first = _tangent(body, state, BY[kind])
    other = _tangent(body, state._replace(u=-state.u, v=2 * state.v), BY[kind])
    small = SMALL * np.abs(first).max(initial=1.0)
    return np.abs(first - first.T).max() < small and np.abs(first - other).max() < small


def exchanges(condition: type[SurfaceCondition], dim: int) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the `exchange` of a condition of a porous medium, and the central differences of its
    residual by p or by the motion of the skeleton, (n k, n l) each; None where it has none.
    """
    body = sample(condition, dim, "porous")
    state = sample_state(dim)
    given = body.exchange(state, BY["porous"])
    if given is None:
        return None
    k, m = given.shape[2], given.shape[4]
    n = SampleSurface(dim).n
    total = np.zeros((n, k, n, m))
    for nodes, K in zip(body.surface.nodes, given, strict=True):
        total[np.ix_(nodes, range(k), nodes, range(m))] += K
    differences = np.empty_like(total)
    for node, j in np.ndindex(n, m):
        ends = [
            _nodal(body, body.residual(_other_moved(condition, state, node, j, sign * STEP)))
            for sign in (1, -1)
        ]
        differences[:, :, node, j] = (ends[0] - ends[1]) / (2 * STEP)
    return total.reshape(n * k, n * m), differences.reshape(n * k, n * m)


def _other_moved(condition, state, node, component, step):
    """Return the state with another pressure, or with another motion of the skeleton."""
    if condition.balance == "momentum":
        p = state.p.copy()
        p[node] += step
        return state._replace(p=p)
    change = np.zeros_like(state.v)
    change[node, component] = step
    slope = BY["porous"]
    return state._replace(u=state.u + slope.u * change, v_s=state.v_s + slope.v * change)


def _check_exchange(condition, dim):
    found = exchanges(condition, dim)
    if found and np.abs(found[0] - found[1]).max() > SMALL * max(1.0, np.abs(found[1]).max()):
        raise ValueError("`exchange` is not the slope of the residual")

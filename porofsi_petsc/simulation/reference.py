"""The exact solution of a scene and the distance of the computed fields from it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ..config import Scene
from ..config.fields import Cells
from ..errors import InputError
from ..exact import (
    CompressibleColumn,
    Cryer,
    DynamicColumn,
    Mandel,
    Seabed,
    Selfweight,
    StripFooting,
    Terzaghi,
    UnconfinedCylinder,
    UnconfinedStrip,
    XieLeo,
    confined_ratio,
)
from ..fem.domain import Domain
from ..fem.geometry import Rule, geometry
from ..materials import ElasticLaw
from ..output.probes import Probes
from .builder import material_of

if TYPE_CHECKING:
    from .loop import Clock

PROFILE_POINTS = 41
STRIP_DEPTH = 4.0  # half widths of a strip load that its profile reaches down
ROUNDING = 1 + 1e-12  # a time that a step misses by rounding is reached


@dataclass(frozen=True)
class ExactFields:
    """Fields of an exact solution at points X (n, d) of the reference configuration and a time t.

    displacement : (t, X) -> (n, d) [m], or None where a half-space has none; pressure : (t, X) ->
    (n,) [Pa];
    pressure_scale : size of p under the sudden load [Pa]; line : first and last point of the
    profile, (2, d) [m];
    component : which displacement the profile shows
    """

    displacement: Callable | None
    pressure: Callable
    pressure_scale: float
    line: np.ndarray
    component: int


@dataclass(frozen=True)
class Soil:
    """What the solutions take of a scene's one material."""

    elastic: ElasticLaw
    rho_sR: float
    rho_fR: float
    mobility: float
    law: str
    biot: float = 1.0
    storage: float = 0.0

    @classmethod
    def of(cls, scene: Scene) -> Soil:
        """Return that of a scene."""
        entry = scene.material[0]
        solid = entry.solid
        fluid = entry.fluid
        assert solid and fluid  # `Scene` refuses these solutions without a porous material
        elastic = entry.elastic_law()
        material = material_of(entry, scene.model)
        S = float(material.storage(np.ones(())))
        densities = solid.density, fluid.density
        return cls(
            elastic,
            *densities,
            entry.mobility_at(Cells.none()),
            solid.law,
            material.biot,
            S,
        )

    @property
    def lam(self) -> float:
        """Return λ [Pa]."""
        return self.elastic.lam

    @property
    def mu(self) -> float:
        """Return μ [Pa]."""
        return self.elastic.mu

    @property
    def n_s(self) -> float:
        """Return the initial solid fraction [-]."""
        return self.elastic.n_s0

    @property
    def modulus(self) -> float:
        """Return E_c = λ + 2μ [Pa]."""
        return self.elastic.oedometer_modulus

    @property
    def diffusivity(self) -> float:
        """Return c_v = (k_f/γ_fR)/(S + α²/E_c) [m²/s]."""
        return self.mobility / (self.storage + self.biot**2 / self.modulus)

    @property
    def stores(self) -> dict[str, float]:
        """Return α and S by the names that the exact solutions have for them."""
        return {"biot": self.biot, "storage": self.storage}


def exact_fields(scene: Scene) -> ExactFields:
    """Return the `ExactFields` of the scene's [reference]; raise InputError where its parameters
    have no such solution.
    """
    section = scene.reference
    assert section is not None  # nobody asks for those of a scene without
    try:
        exact = SOLUTIONS[section.solution](scene, Soil.of(scene))
        _require_load(scene, exact)
    except (ArithmeticError, ValueError) as error:
        raise InputError(_refused(scene, error)) from error
    return exact


def _column(scene, settlement, pressure, scale):
    """Return the fields of a vertical column from w(z, t) and p(z, t), z the depth below the
    surface.
    """
    section = scene.reference
    dim = scene.dim
    surface = section.length if section.surface is None else section.surface

    def displacement(t, X):
        u = np.zeros(X.shape)
        u[:, -1] = -settlement(surface - X[:, -1], t)
        return u

    line = np.zeros((2, dim))
    line[:, -1] = surface, surface - section.length
    return ExactFields(
        displacement, lambda t, X: pressure(surface - X[:, -1], t), scale, line, dim - 1
    )


def _terzaghi(scene, soil):
    section = scene.reference
    layer = Terzaghi(section.load, section.length, soil.modulus, soil.diffusivity, **soil.stores)
    scale = section.load * layer.efficiency
    return _column(scene, layer.settlement, layer.pressure, scale)


def _xie_leo(scene, soil):
    section = scene.reference
    layer = XieLeo(section.load, section.length, soil.modulus, soil.diffusivity)
    return _column(scene, layer.settlement, layer.pressure, section.load)


def _dynamic(scene, soil, evaluate, scale):
    column = DynamicColumn(
        scene.reference.length,
        soil.lam,
        soil.mu,
        soil.n_s,
        soil.rho_sR,
        soil.rho_fR,
        1.0,
        1 / soil.mobility,
    )

    def field(index):
        return lambda z, t: evaluate(column, z, t)[index]

    return _column(scene, field(0), field(1), scale)


def _column_step(scene, soil):
    load = scene.reference.load
    return _dynamic(scene, soil, lambda column, z, t: column.step(load, z, t), load)


def _column_harmonic(scene, soil):
    load = scene.reference.load
    omega = scene.reference.frequency
    if soil.storage:
        n_f = 1 - soil.n_s
        compressible = CompressibleColumn(
            scene.reference.length,
            soil.modulus,
            soil.n_s * soil.rho_sR,
            n_f * soil.rho_fR,
            n_f,
            n_f**2 / soil.mobility,
            soil.biot,
            soil.storage,
        )

        def field(index):
            return lambda z, t: compressible.harmonic(load, omega, z, t)[index]

        return _column(scene, field(0), field(1), load)
    return _dynamic(scene, soil, lambda column, z, t: column.harmonic(load, omega, z, t), load)


def _selfweight(scene, soil):
    section = scene.reference
    gravity = -getattr(scene.body_force.solid, "xyz"[scene.dim - 1])(0.0, np.zeros((1, scene.dim)))[
        0
    ]
    weight = soil.n_s * soil.rho_sR * gravity  # b of a buoyant skeleton is (1 - ρ_fR/ρ_sR) g
    law = soil.elastic
    column = Selfweight(
        weight, section.length, soil.modulus, soil.diffusivity, law.confined, law.lowest_ratio
    )
    if soil.law == "linear_elastic":
        return _column(scene, column.settlement, column.pressure, weight * section.length)
    return _column(
        scene, lambda z, t: column.end_settlement(z), _no_pressure, weight * section.length
    )


def _drained(scene, soil):
    section = scene.reference
    J = confined_ratio(soil.elastic.confined, section.load, soil.elastic.lowest_ratio)
    return _column(scene, lambda z, t: (1 - J) * (section.length - z), _no_pressure, section.load)


def _no_pressure(z, t):
    return np.zeros(z.shape)


def _mandel(scene, soil):
    section = scene.reference
    force = section.load * section.length
    slab = Mandel(force, section.length, soil.lam, soil.mu, soil.diffusivity, **soil.stores)

    def displacement(t, X):
        return np.column_stack([slab.displacement_x(X[:, 0], t), slab.displacement_y(X[:, 1], t)])

    line = np.array([[0.0, 0.0], [section.length, 0.0]])
    return ExactFields(
        displacement, lambda t, X: slab.pressure(X[:, 0], t), slab.initial_pressure, line, 0
    )


def _unconfined(scene, soil):
    """Return the fields of a cylinder around the z-axis or the axis of symmetry, in two dimensions
    of a strip.
    """
    section = scene.reference
    dim = scene.dim
    round_body = dim == 3 or scene.axisymmetric
    kind, undrained = (
        (UnconfinedCylinder, soil.mu) if round_body else (UnconfinedStrip, 2 * soil.mu)
    )
    body = kind(section.strain, section.length, soil.lam, soil.mu, soil.diffusivity)

    def displacement(t, X):
        r = np.linalg.norm(X[:, : dim - 1], axis=1)
        outward = X[:, : dim - 1] * (body.displacement(r, t) / np.where(r > 0, r, 1.0))[:, None]
        return np.column_stack([outward, -section.strain * X[:, -1]])

    line = np.zeros((2, dim))
    line[1, 0] = section.length
    scale = undrained * section.strain
    return ExactFields(
        displacement,
        lambda t, X: body.pressure(np.linalg.norm(X[:, : dim - 1], axis=1), t),
        scale,
        line,
        0,
    )


def _strip_footing(scene, soil):
    section = scene.reference
    surface = section.length if section.surface is None else section.surface
    strip = StripFooting(section.load, section.length, soil.lam, soil.mu, soil.diffusivity)
    line = np.array([[0.0, surface], [0.0, surface - STRIP_DEPTH * section.length]])
    return ExactFields(
        None, lambda t, X: strip.pressure(X[:, 0], surface - X[:, 1], t), section.load, line, 1
    )


def _cryer(scene, soil):
    section = scene.reference
    sphere = Cryer(section.load, section.length, soil.lam, soil.mu, soil.diffusivity, **soil.stores)

    def displacement(t, X):
        r = np.linalg.norm(X, axis=1)
        return X * (sphere.displacement(r, t) / np.where(r > 0, r, 1.0))[:, None]

    def pressure(t, X):
        return sphere.pressure(np.linalg.norm(X, axis=1), t)

    line = np.zeros((2, scene.dim))
    line[1, 0] = section.length
    return ExactFields(displacement, pressure, sphere.initial_pressure, line, 0)


def _seabed(scene, soil):
    section = scene.reference
    surface = section.length if section.surface is None else section.surface
    bed = Seabed(section.load, section.length, section.frequency, soil.mu)

    def displacement(t, X):
        return np.column_stack(bed.displacement(X[:, 0], surface - X[:, 1], t))

    line = np.array([[0.0, surface], [0.0, surface - section.length]])
    return ExactFields(
        displacement,
        lambda t, X: bed.pressure(X[:, 0], surface - X[:, 1], t),
        section.load,
        line,
        1,
    )


def _require_load(scene, exact):
    """Raise InputError where the fields at the end are not finite or zero along the profile: errors
    are relative to them.

    At the other times they only have to be there.
    """
    end = scene.time.end
    with np.errstate(all="ignore"):
        for t in (*scene.reference.times, end):
            fields = [
                field(t, exact.line) for field in (exact.displacement, exact.pressure) if field
            ]
    if not all(np.isfinite(field).all() for field in fields):
        raise InputError(_refused(scene, f"its fields at t = {end:g} s are not finite"))
    if exact.pressure_scale == 0 or (exact.displacement and not fields[0].any()):
        raise InputError(_refused(scene, f"its fields at t = {end:g} s are zero"))


def _refused(scene, cause):
    """Return the sentence about a solution that the scene does not have."""
    text = (
        f"received '{scene.reference.solution}', which the scene's parameters and loads do not"
        f" have: {cause}"
    )
    return (
        f"{scene.source_path or 'scene'} [reference]: {text}; expected those of the solution,"
        " docs/scene.md"
    )


SOLUTIONS = {
    "column_step": _column_step,
    "column_harmonic": _column_harmonic,
    "terzaghi": _terzaghi,
    "mandel": _mandel,
    "unconfined": _unconfined,
    "strip_footing": _strip_footing,
    "cryer": _cryer,
    "seabed": _seabed,
    "xie_leo": _xie_leo,
    "selfweight": _selfweight,
    "drained": _drained,
}


class Comparison:
    """Errors of the accepted fields against the exact ones at the times of a scene; `records`
    belongs to checkpoints.

    A record: at (the time asked for), t (the end of the step that reached it), the relative errors
    u and p in L2, and the profile of s, u, u_exact, p, p_exact along a line.  The error of u is
    taken over the exact u, that of p over its scale and √volume, because p fades.
    """

    def __init__(self, scene: Scene, domain: Domain) -> None:
        """Prepare the quadrature over the owned elements and the points of the profile
        (collective).

        Raises InputError where the scene has no such solution or where its profile leaves the mesh.
        """
        self._exact: Any = exact_fields(scene)
        self._prepare(scene, domain)
        share = np.linspace(0, 1, PROFILE_POINTS)[:, None]
        self._line = (1 - share) * self._exact.line[0] + share * self._exact.line[1]
        self._distance = share[:, 0] * np.linalg.norm(self._exact.line[1] - self._exact.line[0])
        self._probes = self._profile_probes(scene)

    def _prepare(self, scene, domain):
        """Set the times and the quadrature over the owned elements (collective)."""
        self._domain = domain
        self._times = scene.reference.times
        self._reached = 0.0
        self.records = []
        rule = Rule.of(domain.element, 2 * domain.element.order + 2)
        self._cells = domain.cells[domain.owned]
        coordinates = domain.mesh.X[self._cells]
        self._N = rule.N
        self._dV = geometry(rule, coordinates).dV
        self._points = (rule.N @ coordinates).reshape(-1, domain.dim)

    def _profile_probes(self, scene):
        try:
            return Probes(
                self._domain.mesh, [(f"profile {i}", point) for i, point in enumerate(self._line)]
            )
        except InputError as outside:
            ends = " to ".join(
                "(" + ", ".join(f"{x:g}" for x in end) + ")" for end in self._exact.line
            )
            found = f"the profile of '{scene.reference.solution}' from {ends} m leaves the mesh"
            text = f"{found}, expected length and surface inside it"
            raise InputError(f"{scene.source_path or 'scene'} [reference]: {text}") from outside

    def after_step(self, clock: Clock, u: np.ndarray, p: np.ndarray) -> None:
        """Record what is due at the accepted u (n_local, d) and p (n_local,) (collective)."""
        before = self._reached
        self._reached = clock.t * ROUNDING
        due = [at for at in self._times if before < at <= self._reached]
        if clock.finished and clock.t not in due:
            due.append(clock.t)
        for at in due:
            self.records.append(
                {"at": at, "t": clock.t}
                | self._errors(clock.t, u, p)
                | {"profile": self._profile(clock.t, u, p)}
            )

    def resume(self, records: list[dict[str, Any]], t: float) -> None:
        """Go on at the time t [s] with the records of a checkpoint; what was not asked for then
        stays out.
        """
        self.records = records
        self._reached = t * ROUNDING

    def table(self) -> dict[str, np.ndarray]:
        """Return the errors as a history: t and error.u, error.p, each (records,)."""
        return self._columns({"t": "at", "error.u": "u", "error.p": "p"})

    def _columns(self, columns):
        return {
            name: np.array([record[key] for record in self.records], dtype=float)
            for name, key in columns.items()
        }

    def errors(self) -> list[dict[str, float | None]]:
        """Return at, t, u, v, p of every record for the summary."""
        return [
            {key: record.get(key) for key in ("at", "t", "u", "v", "p")} for record in self.records
        ]

    def _errors(self, t, u, p):
        found = {"u": None}
        if self._exact.displacement:
            exact = self._exact.displacement(t, self._points)
            found["u"] = self._norm(self._at_points(u) - exact) / self._norm(exact)
        difference = self._at_points(p[:, None])[:, 0] - self._exact.pressure(t, self._points)
        found["p"] = self._norm(difference) / self._norm(
            np.full(len(difference), self._exact.pressure_scale)
        )
        return found

    def _at_points(self, field):
        """Return the values of a nodal field at the quadrature points, (E Q, k)."""
        return (self._N @ field[self._cells]).reshape(len(self._points), -1)

    def _norm(self, values):
        """Return the L2 norm over all elements of all ranks (collective)."""
        squares = (values.reshape(len(self._points), -1) ** 2).sum(axis=1)
        return float(np.sqrt(self._domain.mesh.comm.allreduce(float(squares @ self._dV.ravel()))))

    def _profile(self, t, u, p):
        component = self._exact.component
        profile = {
            "s": self._distance,
            "u": self._probes.evaluate(u)[:, component],
            "p": self._probes.evaluate(p[:, None])[:, 0],
        }
        profile["p_exact"] = self._exact.pressure(t, self._line)
        exact = self._exact.displacement
        profile["u_exact"] = (
            exact(t, self._line)[:, component] if exact else np.full(len(self._line), np.nan)
        )
        return {name: values.tolist() for name, values in profile.items()}

"""The small sections of a scene: model, limits, time, solver choices, probes, output and
expectations.
"""

from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, PrivateAttr, Strict, model_validator

from ..accelerators import ACCELERATORS
from ..errors import digits, shown
from ..quantities import BUILT_IN, DERIVED_FIELDS, FIELDS, QUANTITIES, SURFACES
from .steps import MOST_STEPS, RESOLUTION, number_of_steps
from .types import (
    Coefficient,
    Count,
    Flag,
    Limit,
    ListOf,
    Name,
    Number,
    OneOf,
    Positive,
    Scaling,
    Switch,
    Table,
    Tags,
    Text,
    Vector,
    distinct,
    wrong,
)

# a local error below is that of rounding, a few 1e-16 of u and p, which no step makes smaller
FINEST_ERROR = 1e-12
LONGEST_LINE = 100_000  # points, each a row of a table
Quantity = Annotated[Text, OneOf(QUANTITIES, *BUILT_IN)]
Community = Literal[
    "consolidation",
    "soil dynamics",
    "biphasic tissue",
    "fluid-structure interaction",
    "haemodynamics",
    "viscous flow",
    "solid mechanics",
]  # of the public problems of docs/cases.md
OfSurface = Annotated[Text, OneOf(SURFACES)]


class Model(Table):
    """Which terms are solved; what is false is left out, costs nothing and is measured against
    [limits].

    "auto" : left out until it passes its bound, then solved to the end
    """

    solid_inertia: Switch = True
    fluid_inertia: Switch = True
    convection: Switch = False
    viscosity: Switch = False
    moving_mesh: Switch = False
    porosity: Literal["constant", "variable", "auto"] = "constant"

    def completed(self, materials: tuple, steady: bool) -> "Model":
        """Return the model with other defaults where they are not given.

        Of a free fluid: the equations of Navier and Stokes, on a mesh that follows a solid beside
        it; steady: no inertia.
        """
        free = [material.fluid for material in materials if material.kind == "fluid"]
        beside_solid = bool(free) and len(free) < len(materials)
        defaults = {
            "solid_inertia": not steady,
            "fluid_inertia": not steady,
            "convection": bool(free),
            "viscosity": any(fluid.viscosity for fluid in free),
            "moving_mesh": beside_solid,
        }
        given = self.model_fields_set
        return self.model_copy(
            update={name: value for name, value in defaults.items() if name not in given}
        )


class Limits(Table):
    """Bounds that stop the run when a term left out turns out large; "report" only reports it.

    strain: max |E| of a small-strain law; mesh_displacement: max |∇u|, strain and rotation, when
    the mesh is fixed (beside a free fluid also |u| over its width); reynolds: element Reynolds
    number without convection; inertia: lasting inertial over largest force;
    porosity_change: of n_f over n_f with constant porosity; viscosity: viscous over drag force
    without the Brinkman term; locking: Poisson ratio of a solid without pores on linear elements;
    stabilization: dissipation of the stabilization of a free fluid over the work of all loads;
    volume: that a free fluid makes over what flows through it;
    slip: that along a porous solid which the mesh does not resolve, over the largest speed.
    """

    strain: Limit = 0.05
    mesh_displacement: Limit = 0.1
    reynolds: Limit = 0.1
    inertia: Limit = 0.1
    porosity_change: Limit = 0.1
    viscosity: Limit = 0.1
    locking: Limit = 0.49
    stabilization: Limit = 0.15
    volume: Limit = 0.01
    slip: Limit = 0.02


# Bound in [limits] of every term of [model]; a term that is "auto" is switched on there.
LIMIT_OF = {
    "solid_inertia": "inertia",
    "fluid_inertia": "inertia",
    "convection": "reynolds",
    "viscosity": "viscosity",
    "moving_mesh": "mesh_displacement",
    "porosity": "porosity_change",
}


class Time(Table):
    """End time, first step and its growth per step up to max_step [s]; rho_inf is the spectral
    radius at infinity.

    consistent_start : accelerations and pressure at t = 0 from the balances instead of zero;
    error_tolerance : the step follows the local error, between min_step and max_step
    """

    end: Positive
    step: Positive
    rho_inf: Annotated[Number, Field(ge=0, le=1)] = 0.5
    scheme: Literal["generalized_alpha", "backward_euler", "steady"] = "generalized_alpha"
    growth: Annotated[Number, Field(ge=1, le=100)] = 1.0
    max_step: Positive | None = None
    consistent_start: Flag = False
    error_tolerance: Annotated[Number, Field(ge=FINEST_ERROR, lt=1)] | None = None
    min_step: Positive | None = None

    _begins: float = PrivateAttr(0.0)

    @property
    def begins(self) -> float:
        """Return the time at which the stage begins [s], 0 of the first one."""
        return self._begins

    @model_validator(mode="after")
    def _controlled(self) -> "Time":
        if self.error_tolerance is not None and self.growth != 1:
            raise wrong(
                f"received {digits(self.growth)} with time.error_tolerance, which chooses the step;"
                " leave it out",
                "growth",
            )
        if self.error_tolerance is None and self.min_step is not None:
            raise wrong(
                f"received {digits(self.min_step)} s without time.error_tolerance, which would need"
                " it; leave it out",
                "min_step",
            )
        if self.min_step is not None and self.min_step > self.step:
            raise wrong(
                f"received {digits(self.min_step)} s, expected at most time.step ="
                f" {digits(self.step)} s",
                "min_step",
            )
        return self

    @model_validator(mode="after")
    def _ordered(self) -> "Time":
        if self.step > self.end:
            raise wrong(
                f"received {digits(self.step)} s, expected at most time.end = {digits(self.end)} s",
                "step",
            )
        if self.max_step is not None and self.max_step < self.step:
            raise wrong(
                f"received {digits(self.max_step)} s, expected at least time.step ="
                f" {digits(self.step)} s",
                "max_step",
            )
        return self

    @model_validator(mode="after")
    def _ends(self) -> "Time":
        """Refuse steps that would be lost in the digits of the time, or so many that the run does
        not end.
        """
        if self.min_step is not None and self.min_step < RESOLUTION * self.end:
            text = (
                f"expected at least {RESOLUTION:g} of time.end = {digits(self.end)} s, the"
                " round-off of the time"
            )
            raise wrong(f"received {digits(self.min_step)} s, {text}", "min_step")
        if self.error_tolerance is None:
            steps = number_of_steps(self.end, self.step, self.growth, self.max_step)
            if steps > MOST_STEPS:
                text = (
                    f"which takes {steps:.1e} steps to time.end = {digits(self.end)} s, expected at"
                    f" most {MOST_STEPS:g}"
                )
                raise wrong(f"received {digits(self.step)} s, {text}", "step")
        return self


class Stabilization(Table):
    """Stabilization terms of the fluid block, of the undrained limit and of outlets."""

    pspg: Flag = True
    supg: Flag = True
    lsic: Flag = True
    undrained: Flag = True
    backflow: Flag = True


class Coupling(Table):
    """The partitioned iteration: split, accelerator and its factor, tolerance on the true
    residuals, and what ends it.
    """

    scheme: Literal["partitioned", "quasi_direct", "direct", "weak", "one_way"] = "partitioned"
    split: Literal["corrected", "plain"] = "corrected"
    accelerator: Annotated[Text, OneOf(ACCELERATORS)] = "iqn_ils"
    reuse_steps: Annotated[int, Strict(), Field(ge=0, le=1000)] = 4
    interface: Literal[
        "auto",
        "condensed",
        "dirichlet_neumann",
        "robin_neumann",
        "robin_robin",
        "neumann_dirichlet",
    ] = "auto"
    robin: Coefficient = "auto"
    mass_scaling: Scaling | None = None
    relaxation: Annotated[Number, Field(gt=0, le=2)] | None = None
    tolerance: Annotated[Positive, Field(le=1e-2)] = 1e-6
    max_iterations: Count = 60
    tangent: Literal["auto", "lagged", "newton"] = "auto"
    on_failure: Literal["fall_back", "cut_step", "stop"] = "fall_back"
    max_cuts: Annotated[Count, Field(le=30)] = 4

    @model_validator(mode="after")
    def _scaled_where_plain(self) -> "Coupling":
        if self.mass_scaling is not None and (self.split, self.scheme) != ("plain", "partitioned"):
            received = (
                f"received {shown(self.mass_scaling)} with split = '{self.split}', scheme ="
                f" '{self.scheme}'"
            )
            text = (
                "expected split = 'plain', scheme = 'partitioned': other tangents have their own"
                " corrections; leave it out"
            )
            raise wrong(f"{received}, {text}", "mass_scaling")
        return self


class MeshMotion(Table):
    """How the mesh of a free fluid follows the solid: an elastic law, stiffer on small elements by
    (V_mean/V)^stiffening.
    """

    law: Literal["linear_elastic", "harmonic", "neo_hookean", "distortion"] = "neo_hookean"
    poisson: Annotated[Number, Field(gt=-1, lt=0.5)] = 0.3
    stiffening: Annotated[Number, Field(ge=0, le=10)] = 1.0


class Petsc(Table):
    """PETSc's options as on a command line, prefixes fluid_, solid_, mesh_ and monolithic_."""

    options: Text = ""


def _each_once(table):
    """Return a table; refuse it where one of its quantities is there twice."""
    if len(set(table.quantities)) < len(table.quantities):
        raise wrong(f"received {list(table.quantities)}, expected each quantity once", "quantities")
    return table


class Probe(Table):
    """A reference point [m] and the quantities recorded there in every step."""

    name: Name
    at: Annotated[tuple[Number, ...], ListOf(shortest=2, longest=3)]
    quantities: Annotated[tuple[Quantity, ...], ListOf(shortest=1)]

    @model_validator(mode="after")
    def _distinct(self) -> "Probe":
        return _each_once(self)


Place = Annotated[tuple[Number, ...], ListOf(shortest=2, longest=3)]


class Line(Table):
    """Points at equal distances on a straight line of the reference configuration [m], the ends
    among them, and the quantities that are written of them.
    """

    name: Name
    start: Annotated[tuple[Number, ...], ListOf(shortest=2, longest=3)] = Field(alias="from")
    to: Annotated[tuple[Number, ...], ListOf(shortest=2, longest=3)]
    points: Annotated[Count, Field(ge=2, le=LONGEST_LINE)]
    quantities: Annotated[tuple[Quantity, ...], ListOf(shortest=1)]
    every: Count = 1

    @model_validator(mode="after")
    def _distinct(self) -> "Line":
        return _each_once(self)


class Load(Table):
    """A force [N] on a point of a solid, in 2-D per metre of thickness, around an axis on a whole
    ring; or one along a segment [N/m].
    """

    at: Place | None = None
    line: Annotated[tuple[Place, ...], ListOf(shortest=2, longest=2)] | None = None
    force: Vector

    @model_validator(mode="after")
    def _complete(self) -> "Load":
        if (self.at is None) == (self.line is None):
            raise wrong("expected exactly one of at = [x, y] and line = [[x, y, z], [x, y, z]]")
        if not any((self.force.x, self.force.y, self.force.z)):
            raise wrong("received no component, expected one at least", "force")
        return self


class Force(Table):
    """The force on tagged surfaces, in every step as name.f_x, name.f_y, name.f_z [N]: a
    [[surface]] with the quantity force.
    """

    name: Name
    on: Tags

    @property
    def quantities(self) -> tuple[str, ...]:
        """Return the quantities of the surface."""
        return ("force",)


class Surface(Table):
    """Tagged surfaces and the quantities that are recorded of all of them together."""

    name: Name
    on: Tags
    quantities: Annotated[tuple[OfSurface, ...], ListOf(shortest=1)]

    @model_validator(mode="after")
    def _distinct(self) -> "Surface":
        return _each_once(self)


class Interface(Table):
    """Two surfaces that lie on each other, of a free fluid and of a solid whose nodes are not the
    fluid's.
    """

    fluid: Tags
    solid: Tags


class Output(Table):
    """When what is written, and how; an interval or a list that is absent means never.

    fields : what is written, all that the scene has by default; fields_every [steps],
    fields_interval [s], fields_times [s] : when, at the first step that reaches the time, and at
    the start and the end; format, precision, compression : of the file, of a number, level of gzip
    (0: none); period_of : the column of the history whose last full period is analysed
    """

    fields: Annotated[
        tuple[Annotated[Text, OneOf(FIELDS | DERIVED_FIELDS)], ...],
        ListOf(),
        AfterValidator(distinct),
    ] = ()
    fields_every: Count | None = None
    fields_interval: Positive | None = None
    fields_times: Annotated[tuple[Annotated[Number, Field(ge=0)], ...], ListOf()] = ()
    format: Literal["xdmf", "vtkhdf"] = "xdmf"
    precision: Literal["float64", "float32"] = "float64"
    compression: Annotated[int, Strict(), Field(ge=0, le=9)] = 0
    checkpoint_every: Count | None = None
    checkpoint_minutes: Positive | None = None
    history_every: Count = 1
    period_of: Text | None = None

    @property
    def has_fields(self) -> bool:
        """Return whether fields are written."""
        return bool(self.fields_every or self.fields_interval or self.fields_times)

    @model_validator(mode="after")
    def _fields_have_times(self) -> "Output":
        for key in ("fields", "format", "precision", "compression"):
            if key in self.model_fields_set and not self.has_fields:
                value = getattr(self, key)
                default = type(self).model_fields[key].default
                if value != default:
                    text = "expected fields_every, fields_interval or fields_times beside it"
                    received = list(value) if isinstance(value, tuple) else value
                    raise wrong(f"received {shown(received)} without a time, {text}", key)
        return self


class Figures(Table):
    """Times [s] of the field figures, magnification of the displacement (absent: automatic), probes
    whose path is drawn.

    cut : a three-dimensional domain is drawn behind the plane y = cut [m] (absent: its middle).
    """

    times: Annotated[tuple[Annotated[Number, Field(ge=0)], ...], ListOf()] = ()
    deformation_scale: Annotated[Number, Field(ge=0)] | None = None
    paths: Annotated[tuple[Name, ...], ListOf()] = ()
    cut: Number | None = None


# Statistics of the last full period of output.period_of -> what they are of an
# `output.period.Oscillation`.
Statistic = Literal[
    "max", "min", "abs_max", "final", "period_mean", "period_amplitude", "period_max", "frequency"
]
PERIODIC = {
    "period_mean": "mean",
    "period_amplitude": "amplitude",
    "period_max": "largest",
    "frequency": "frequency",
}


class Expect(Table):
    """A value a run must reproduce: at a time [s] or as a statistic, within tolerance times |value|
    (or times scale).

    minus : a column that is taken away from the quantity;
    since : the value is the change from this time [s] to `at`; statistic : of the whole history,
    PERIODIC ones of its last period
    """

    quantity: Text
    minus: Text | None = None
    at: Annotated[Number, Field(ge=0)] | None = None
    since: Annotated[Number, Field(ge=0)] | None = None
    statistic: (
        Literal[
            "max",
            "min",
            "abs_max",
            "final",
            "period_mean",
            "period_amplitude",
            "period_max",
            "frequency",
        ]
        | None
    ) = None
    value: Number
    tolerance: Positive
    scale: Positive | None = None
    source: Text = ""

    @model_validator(mode="after")
    def _complete(self) -> "Expect":
        if (self.at is None) == (self.statistic is None):
            raise wrong(
                "expected exactly one of at = TIME and statistic = NAME, both are in docs/scene.md"
            )
        if self.since is not None and (self.at is None or self.since >= self.at):
            raise wrong(f"received {digits(self.since)}, expected a time before at = TIME", "since")
        if self.value == 0 and self.scale is None:
            raise wrong(
                "received nothing, expected a positive number, because the value 0 has no relative"
                " tolerance",
                "scale",
            )
        return self


Smoke = dict[str, Any]

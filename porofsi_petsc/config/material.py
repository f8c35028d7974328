"""Entries [[material]]: a saturated soil, a solid without pores or a free fluid per volume
group.
"""

from collections.abc import Sequence
from functools import reduce
from math import cos, hypot, radians, sin
from operator import or_
from typing import Annotated, Any, Literal

from pydantic import (
    Field,
    GetCoreSchemaHandler,
    create_model,
    model_validator,
)
from pydantic_core import CoreSchema

from ..errors import digits
from ..materials import ELASTIC, PERMEABILITY, ElasticLaw
from ..materials.viscoelastic import Branch
from ..registry import Parameter, Registry, parameters
from .fields import (
    AS_GIVEN,
    FIELD,
    OR_FORMULA,
    Cells,
    NumberField,
    PoissonField,
    PositiveField,
    require,
    require_within,
    values,
)
from .orientation import Direction, Orientation
from .types import ListOf, Number, Positive, Table, Tags, wrong

ROUND_OFF = 1 + 1e-12  # of λ/μ that is made of a Poisson ratio at its bound

PORE_LAWS = ("xie_leo", "ehlers_eipper")
RIGHT_ANGLE = 1e-6  # largest cosine between axes at right angles
THINNEST = 1e-6  # smallest porosity: n_f = 1 - n_s has ten digits left


class OfLaw(Table):
    """A table whose further keys are the parameters of its law."""

    law: str

    def of_law(self) -> dict[str, Any]:
        """Return the parameters of the law by name."""
        return {
            name: getattr(self, name) for name in type(self).model_fields if name not in self.common
        }

    @property
    def common(self) -> set[str]:
        """Return the keys that the table has with every law."""
        return {
            name
            for base in type(self).__mro__[1:]
            if issubclass(base, OfLaw)
            for name in base.model_fields
        }


class ByLaw:
    """The annotation of a field with such a table: a union over the laws of a registry, as it is
    when the schema is made.
    """

    def __init__(self, table: type[OfLaw], registry: Registry) -> None:
        """Take the keys of every law and the registry."""
        self._table = table
        self._registry = registry

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        """Return the schema of the union, or None."""
        tables = (_of_law(self._table, name, law) for name, law in self._registry.items())
        return handler.generate_schema(
            Annotated[reduce(or_, tables), Field(discriminator="law")] | None
        )


def _of_law(table, name, law):
    """Return the table of one law."""
    keys = {key: _key(entry) for key, entry in parameters(law).items()}
    return create_model(
        f"{table.__name__}Of{law.__name__}", __base__=table, law=(Literal[name], ...), **keys
    )


def _key(entry: Parameter) -> tuple:
    """Return type and default of a parameter."""
    if entry.kind == "word":
        return Literal[entry.words], ... if entry.default is None else entry.default
    kind: Any = Annotated[Number, Field(gt=entry.above, ge=entry.at_least, le=entry.at_most)]
    if entry.kind == "numbers":
        kind = Annotated[tuple[kind, ...], ListOf(0, 3)]
    return kind, ... if entry.default is None else entry.default


class MaxwellBranch(Table):
    """A branch of a generalized Maxwell body: modulus over that of the law [-] and relaxation time
    [s].
    """

    modulus: Positive
    time: Positive


class Solid(OfLaw):
    """The skeleton: law, Lamé parameters [Pa] (or young [Pa] and poisson) and true density rho_sR
    [kg/m^3]; branches of a generalized Maxwell body of a viscoelastic one; axes of the directions
    of an anisotropic one.
    """

    lambda_: NumberField | None = Field(None, alias="lambda")
    mu: PositiveField | None = None
    young: PositiveField | None = None
    poisson: PoissonField | None = None
    density: PositiveField
    prony: Annotated[tuple[MaxwellBranch, ...], ListOf(shortest=1)] | None = None
    orientation: Orientation | None = None

    @model_validator(mode="after")
    def _resolve_lame(self):
        """Set lambda = E nu / ((1 + nu)(1 - 2 nu)) and mu = E / (2 (1 + nu)); keep lambda and mu
        where these are given, and formulas.
        """
        given = {
            name
            for name in ("lambda_", "mu", "young", "poisson")
            if getattr(self, name) is not None
        }
        if given not in ({"lambda_", "mu"}, {"young", "poisson"}):
            names = ", ".join(sorted(name.rstrip("_") for name in given)) or "none of them"
            raise wrong(f"received {names}, expected either lambda and mu, or young and poisson")
        if self.is_graded:
            return self._require_law_of_fields()
        self._require_ratio(given == {"lambda_", "mu"})
        if given == {"lambda_", "mu"}:
            if 3 * self.lambda_ + 2 * self.mu <= 0:
                raise wrong(
                    f"received {self.lambda_}, expected more than -2/3 mu (a positive bulk"
                    " modulus)",
                    "lambda",
                )
            return self
        lame = dict(zip(("lambda_", "mu"), _lame(self.young, self.poisson), strict=True))
        return self.model_copy(update=lame | {"young": None, "poisson": None})

    @model_validator(mode="after")
    def _has_directions(self):
        if self.orientation and not ELASTIC[self.law].anisotropic:
            raise wrong(
                f"received one with the law '{self.law}', which has no directions; leave it out",
                "orientation",
            )
        return self

    def _require_ratio(self, by_lame):
        """Refuse numbers with a larger λ/μ than the law admits: an energy without a lower bound."""
        lam, mu = (self.lambda_, self.mu) if by_lame else _lame(self.young, self.poisson)
        most = ELASTIC[self.law].most_lame_ratio
        if lam > ROUND_OFF * most * mu:
            key, value = ("lambda", lam) if by_lame else ("poisson", self.poisson)
            bound = f"{most:g} mu" if by_lame else f"{most / (2 * (1 + most)):.6g}"
            text = f"received {digits(value)} with the law '{self.law}', expected at most {bound}"
            raise wrong(f"{text}, beyond which it has no stiffness in tension", key)

    @property
    def is_graded(self) -> bool:
        """Return whether a modulus is a field."""
        moduli = self.lambda_, self.mu, self.young, self.poisson
        return any(isinstance(entry, FIELD) for entry in moduli)

    def _require_law_of_fields(self):
        of_law = parameters(ELASTIC[self.law])
        stiff = next((name for name, entry in of_law.items() if entry.unit == "Pa"), None)
        if stiff:
            raise wrong(
                f"received a formula with the law '{self.law}', whose '{stiff}' is a number,"
                " expected numbers"
            )
        return self

    def lame(self, cells: Cells) -> tuple[Any, Any]:
        """Return λ and μ [Pa] in cells, (n, 1) of fields; raise InputError where the
        moduli are none.
        """
        if self.young is None:
            lam, mu = values(self.lambda_, cells), values(self.mu, cells)
        else:
            E, nu = values(self.young, cells), values(self.poisson, cells)
            require_within(self.young, E, cells, above=0.0)
            require_within(self.poisson, nu, cells, above=-1.0, below=0.5)
            lam, mu = _lame(E, nu)
        require_within(self.mu, mu, cells, above=0.0)
        place = getattr(self.lambda_, "place", getattr(self.mu, "place", ""))
        if self.is_graded:
            bulk = lam + 2 / 3 * mu
            require(bulk > 0, bulk, "a positive bulk modulus λ + 2/3 μ", place, cells)
            most = ELASTIC[self.law].most_lame_ratio
            expected = f"λ/μ of at most {most:g} with the law '{self.law}'"
            require(lam <= ROUND_OFF * most * mu, lam / mu, expected, place, cells)
        return lam, mu


def _lame(E: Any, nu: Any) -> tuple[Any, Any]:
    """Return λ and μ of Young's modulus and Poisson's ratio."""
    return E * nu / ((1 + nu) * (1 - 2 * nu)), E / (2 * (1 + nu))


class Fluid(Table):
    """The pore fluid: rho_fR [kg/m^3], specific weight gamma_fR [N/m^3], viscosity mu_f and that of
    the Brinkman term [Pa s], bulk modulus K_f [Pa].
    """

    density: Positive
    specific_weight: Positive | None = None
    viscosity: Positive | None = None
    effective_viscosity: Positive | None = None
    bulk_modulus: Positive | None = None

    @property
    def brinkman_viscosity(self) -> float:
        """Return the viscosity of the Brinkman term in pores, of the fluid where it is free [Pa s];
        0 without.
        """
        return self.effective_viscosity or self.viscosity or 0.0


class Permeability(OfLaw):
    """Darcy coefficient k [m/s] or intrinsic permeability [m^2] in the reference state, and how it
    follows the deformation.

    anisotropy : factors of it along the principal axes; angle [degrees] of the first one from x, in
    the plane; axes : directions of the first two, in space
    """

    k: PositiveField | None = None
    intrinsic: PositiveField | None = None
    anisotropy: Annotated[tuple[Positive, ...], ListOf(2, 3)] | None = None
    angle: Number | None = None
    axes: Annotated[tuple[Direction, ...], ListOf(2, 2)] | None = None

    @model_validator(mode="after")
    def _complete(self):
        if (self.k is None) == (self.intrinsic is None):
            raise wrong("expected exactly one of k [m/s] and intrinsic [m^2]")
        return self

    @model_validator(mode="after")
    def _axes_are_known(self):
        count = len(self.anisotropy or ())
        for name, needed in (("angle", 2), ("axes", 3)):
            if getattr(self, name) is not None and count != needed:
                raise wrong(
                    f"received it with {count or 'no'} factors, expected {needed} in anisotropy, or"
                    f" no {name}",
                    name,
                )
        if self.axes:
            lengths = [hypot(*axis) for axis in self.axes]
            if not all(lengths):
                raise wrong("received a direction of length 0, expected another", "axes")
            cosine = sum(a * b for a, b in zip(*self.axes, strict=True)) / lengths[0] / lengths[1]
            if abs(cosine) > RIGHT_ANGLE:
                raise wrong(
                    f"received directions whose angle has the cosine {cosine:.3g}, expected a right"
                    " angle",
                    "axes",
                )
        return self

    @property
    def principal_axes(self) -> tuple[tuple[float, ...], ...]:
        """Return the orthonormal axes of the factors of anisotropy; those of the coordinates if
        none are given.
        """
        if self.axes:
            return _orthonormal(*self.axes)
        d = len(self.anisotropy or ())
        if self.angle is None:
            return tuple(tuple(float(i == j) for j in range(d)) for i in range(d))
        c, s = cos(radians(self.angle)), sin(radians(self.angle))
        return (c, s), (-s, c)


def _orthonormal(first, second):
    """Return three orthonormal vectors: along the first, in the plane of both, and across it."""
    a, b = (tuple(x / hypot(*vector) for x in vector) for vector in (first, second))
    along = sum(x * y for x, y in zip(a, b, strict=True))
    b = tuple(y - along * x for x, y in zip(a, b, strict=True))
    b = tuple(x / hypot(*b) for x in b)
    return a, b, tuple(a[i - 2] * b[i - 1] - a[i - 1] * b[i - 2] for i in range(3))


PorosityField = Annotated[Number, Field(ge=THINNEST, lt=1), OR_FORMULA, AS_GIVEN]


class Material(Table):
    """A saturated porous material of solid, fluid, initial porosity n_f and permeability; or a
    solid alone, or a fluid alone.
    """

    region: Tags
    porosity: PorosityField | None = None
    solid: Annotated[Solid | None, ByLaw(Solid, ELASTIC)] = None
    fluid: Fluid | None = None
    permeability: Annotated[Permeability | None, ByLaw(Permeability, PERMEABILITY)] = None
    biot_coefficient: Annotated[Number, Field(gt=0, le=1)] = 1.0

    @property
    def kind(self) -> Literal["porous", "solid", "fluid"]:
        """Return "porous", "solid" or "fluid"."""
        if self.fluid is None:
            return "solid"
        return "porous" if self.solid else "fluid"

    @property
    def fields(self) -> dict[str, Any]:
        """Return key -> formula or array of the coefficients that are fields."""
        entries: dict[str, Any] = {"porosity": self.porosity}
        for name in ("solid", "permeability"):
            table = getattr(self, name)
            keys = type(table).model_fields if table else {}
            entries |= {f"{name}.{keys[key].alias or key}": getattr(table, key) for key in keys}
        if self.orientation:
            found = self.orientation.fields
            entries |= {f"solid.orientation.{key}": entry for key, entry in found.items()}
        return {key: entry for key, entry in entries.items() if isinstance(entry, FIELD)}

    @property
    def orientation(self) -> Orientation | None:
        """Return the axes of the solid's directions, None where they are the coordinates."""
        return self.solid.orientation if self.solid else None

    @property
    def is_uniform(self) -> bool:
        """Return whether it is the same in all cells."""
        return not self.fields and self.orientation is None

    def mobility_at(self, cells: Cells) -> Any:
        """Return k_f / gamma_fR = K / mu_f [m^4/(N s)] in the reference state in cells, so that the
        drag is S = n_f^2 / mobility; (n, 1) of a field.
        """
        law = self.permeability
        fluid = self.fluid
        assert law and fluid  # a solid or a fluid alone has no mobility
        # of each pair both are there, by `_mobility_known`
        given, over = (
            (law.k, fluid.specific_weight)
            if law.k is not None
            else (law.intrinsic, fluid.viscosity)
        )
        found = values(given, cells)
        require_within(given, found, cells, above=0.0)
        return found / over

    def porosity_at(self, cells: Cells) -> Any:
        """Return n_f in cells, (n, 1) of a field; 0 without pores."""
        found = values(self.porosity, cells)
        require_within(self.porosity, found, cells, at_least=THINNEST, below=1.0)
        if isinstance(self.porosity, FIELD):
            expected = f"less than the biot_coefficient {self.biot_coefficient:g}"
            admissible = (found < self.biot_coefficient) | (self.biot_coefficient == 1.0)
            require(admissible, found, expected, self.porosity.place, cells)
        return 0.0 if found is None else found

    def density_at(self, cells: Cells) -> Any:
        """Return ρ_sR [kg/m³] in cells, (n, 1) of a field."""
        assert self.solid  # nobody asks a fluid
        found = values(self.solid.density, cells)
        require_within(self.solid.density, found, cells, above=0.0)
        return found

    @model_validator(mode="after")
    def _complete(self):
        if self.solid is None and self.fluid is None:
            raise wrong(
                "received neither solid nor fluid, expected one of them, or both with porosity and"
                " permeability"
            )
        for name in ("porosity", "permeability"):
            given = getattr(self, name) is not None
            if self.kind == "porous" and not given:
                raise wrong("received nothing, which a material of solid and fluid needs", name)
            if self.kind != "porous" and given:
                raise wrong(
                    f"received one with a {self.kind} alone, expected solid and fluid, or no"
                    f" {name}",
                    name,
                )
        if self.kind == "solid" and self.solid.law in PORE_LAWS:
            raise wrong(
                f"received '{self.solid.law}', a law of soils, for a solid without pores; choose"
                " another",
                "solid.law",
            )
        return self

    @model_validator(mode="after")
    def _law_is_one(self):
        """Refuse parameters that the law refuses together."""
        if self.solid:
            try:
                compacts = self.elastic_law().compacts
            except ValueError as error:
                raise wrong(str(error), "solid") from error
            if compacts and isinstance(self.porosity, FIELD):
                text = f"received a formula with the law '{self.solid.law}', expected a number"
                raise wrong(f"{text}, with which the law has one compaction point", "porosity")
        return self

    def elastic_law(self, lam: float | None = None, mu: float | None = None) -> ElasticLaw:
        """Return the law of the solid with its parameters, and with other λ and μ [Pa] if they are
        given; without, a law with fields has those of unity.
        """
        solid = self.solid
        assert solid  # nobody asks a fluid
        prony = tuple(Branch(entry.modulus, entry.time) for entry in solid.prony or ())
        n_s0 = 0.0 if isinstance(self.porosity, FIELD) else 1 - (self.porosity or 0.0)
        if lam is None or mu is None:
            lam, mu = (1.0, 1.0) if solid.is_graded else (solid.lambda_, solid.mu)
        return ELASTIC[solid.law](lam, mu, n_s0, prony, **solid.of_law())

    @model_validator(mode="after")
    def _constituents_agree(self):
        if self.kind != "porous":
            if self.biot_coefficient != 1.0:
                raise wrong(
                    f"received one with a {self.kind} alone, expected solid and fluid; leave it"
                    " out",
                    "biot_coefficient",
                )
            if self.fluid and self.fluid.bulk_modulus:
                raise wrong(
                    "received one with a free fluid, which is incompressible; leave it out",
                    "fluid.bulk_modulus",
                )
            if self.fluid and self.fluid.effective_viscosity:
                raise wrong(
                    "received one with a free fluid, expected pores; leave it out",
                    "fluid.effective_viscosity",
                )
        elif self.fluid and self.fluid.effective_viscosity and not self.fluid.viscosity:
            raise wrong("received nothing beside an effective_viscosity", "fluid.viscosity")
        elif self.biot_coefficient != 1.0 and self.elastic_law().anisotropic:
            raise wrong(
                f"received {self.biot_coefficient:g} with the law '{self.solid.law}', expected an"
                " isotropic one beside compressible grains; leave it out",
                "biot_coefficient",
            )
        elif isinstance(self.porosity, float) and self.biot_coefficient <= self.porosity:
            raise wrong(
                f"received {self.biot_coefficient:g}, expected more than the porosity"
                f" {self.porosity:g}",
                "biot_coefficient",
            )
        return self

    @model_validator(mode="after")
    def _mobility_known(self):
        if self.kind != "porous":
            return self
        if self.permeability.k is not None and self.fluid.specific_weight is None:
            raise wrong(
                "received nothing, expected a number [N/m^3], which permeability.k needs",
                "fluid.specific_weight",
            )
        if self.permeability.intrinsic is not None and self.fluid.viscosity is None:
            raise wrong(
                "received nothing, expected a number [Pa s], which permeability.intrinsic needs",
                "fluid.viscosity",
            )
        return self


def check_materials(materials: Sequence[Material], brinkman: bool | Literal["auto"]) -> None:
    """Refuse a region with two materials, and a missing viscosity where the Brinkman term needs
    one.
    """
    owner: dict[str, int] = {}
    for i, material in enumerate(materials):
        for region in material.region:
            if region in owner:
                raise wrong(
                    f"region '{region}' has a material already, material.{owner[region]}",
                    f"material.{i}.region",
                )
            owner[region] = i
        if brinkman and material.fluid and material.fluid.viscosity is None:
            key = f"material.{i}.fluid.viscosity"
            raise wrong(
                "received nothing, expected a number [Pa s], which model.viscosity needs", key
            )
    if "all" in owner and len(owner) > 1:
        raise wrong(
            "received 'all' beside other regions, expected 'all' alone",
            f"material.{owner['all']}.region",
        )

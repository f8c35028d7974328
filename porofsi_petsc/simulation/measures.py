"""What is looked at after a step: nodal output fields, the size of what the model leaves out,
pressure oscillations.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
from mpi4py import MPI

from ..config import Scene
from ..config.sections import LIMIT_OF
from ..coupling.protocols import Fluid, Solid
from ..errors import LimitError
from ..fem.domain import Domain
from ..fem.essential import owned_nodes
from ..fem.geometry import Rule, geometry
from ..kernels.solid import displacement_gradient
from ..kernels.stabilization import convective_scale
from ..materials.porous import PorousMaterial
from ..materials.strain import deformation, green_strain
from ..mesh.topology import is_collapsed, times_in_cell
from ..phases.coupling_data import MeshState
from ..phases.residual import Residual
from ..tensors import det_minus_one, three_dimensional, transpose
from .auto import AnyMedium, at_start
from .builder import materials_of
from .flow_reference import FlowComparison
from .lasting import Lasting
from .reference import Comparison
from .slip import LostSlip
from .volume import VolumeBalance

if TYPE_CHECKING:
    from .loop import Clock

# Of the forces on the skeleton: a pore fluid that bears less than that is at rest relative to it,
# and its forces, with which its inertia would be compared, are round-off (a sealed body).
BEARING = 1e-3
# Where stresses of a collapsed cell are taken: this far from its nodes on the way to the centroid.
COLLAPSED = 1e-6
STRESS_DOUBLES = 60  # of work at a point of the stress: gradients, tensors of three dimensions


class NodalAverage:
    """Average over the elements of a node, weighted by their volume, of element values or of those
    that each element has at the node; exact for constants on any order.
    """

    def __init__(self, domain: Domain) -> None:
        """Prepare the weights."""
        self._domain = domain
        self._weight = domain.reference.dV.sum(axis=1)[:, None] / times_in_cell(domain.cells)
        self._total = domain.scatter_add(self._spread(np.ones((domain.n_cells, 1))))

    def _spread(self, values):
        A = self._domain.cells.shape[1]
        if values.ndim == 2:
            values = np.repeat(values[:, None], A, axis=1)
        return values * self._weight[..., None]

    def __call__(self, cell_values: np.ndarray) -> np.ndarray:
        """Return the nodal values (n_owned, k) of values (E, k) of the elements or (E, A, k) at
        their nodes; zero outside of the domain.
        """
        total = self._domain.scatter_add(self._spread(cell_values))
        return np.divide(total, self._total, out=np.zeros_like(total), where=self._total > 0)


@dataclass(frozen=True)
class Omission:
    """One term left out: what the number is, its bound (None: only reported) and its key in
    [limits], the term, how to have it.

    term : key in [model], "" where the material decides; lasts : the number is that of `Lasting`,
    not of single steps
    """

    name: str
    limit: str
    bound: float | None
    term: str
    remedy: str
    meaning: str
    lasts: bool = False


class TrialStep:
    """The end of a trial step: u [m], v_s, v_m, v_f [m/s] and the mean rates of these in the step
    [m/s²], all (n_local, d); mesh_u : that of the fluid's mesh on the collocation level [m].
    """

    def __init__(self, medium: AnyMedium, dt: float) -> None:
        """Take the trial states of a medium after a step of size dt (collective)."""
        solid = medium.solid
        fluid = medium.fluid
        extend = solid.mesh.halo.extend
        d = solid.mesh.dim
        self.u = extend(solid.unknowns)
        self.v_s = solid.mesh_state().end_velocity
        self.v_f = extend(fluid.unknowns[:, :d])
        self.v_m = medium.mesh_state().end_velocity
        self.mesh_u = medium.mesh_state().displacement
        self.solid_rate = (self.v_s - solid.v) / dt
        self.fluid_rate = (self.v_f - fluid.v) / dt
        self.solid_residual: Residual = medium.residuals[0]
        self.fluid_residual: Residual = medium.residuals[1][0]


class Measures:
    """Fields for output and sizes of neglected terms of the accepted state of a coupling.

    datum : the displacement from which those of the output are measured, (n_local, d) [m], None for
    the reference configuration
    """

    def __init__(
        self, scene: Scene, coupling: AnyMedium, materials: dict[str, PorousMaterial]
    ) -> None:
        """Prepare what the scene's model leaves out; `sizes` (name -> largest size) belongs to the
        run and its checkpoints.
        """
        self._scene = at_start(scene)
        self._materials = materials
        self._coupling = coupling
        self._solid = coupling.solid.domain
        self._fluid = coupling.fluid.domain
        self._mesh = self._solid.mesh
        self._in_solid = NodalAverage(self._solid)
        self._in_fluid = NodalAverage(self._fluid)
        self._lost_slip = self._slip_along_pores()
        self.omissions = list(_omissions(self._scene, materials, self._lost_slip))
        self.sizes = {omission.name: 0.0 for omission in self.omissions}
        self._lasting = {
            omission.name: Lasting(scene.time.end) for omission in self.omissions if omission.lasts
        }
        self.roughness = self.largest_pressure = 0.0
        self.datum: np.ndarray | None = None
        self._interior = self._interior_nodes()
        self.comparison = self._comparison(scene) if scene.reference else None
        flows = scene.phases[1] and not scene.is_porous
        self.volume = VolumeBalance(coupling, scene.limits.volume) if flows else None

    def _slip_along_pores(self):
        """Return the `LostSlip` of a viscous flow along porous solids, None without any
        (collective).
        """
        model = self._scene.model
        beside = self._scene.has_pores and not self._scene.is_porous
        if not (beside and model.viscosity is True):
            return None
        return LostSlip(self._mesh, self._materials, model.moving_mesh)

    def _comparison(self, scene):
        return (
            Comparison(scene, self._solid)
            if scene.is_porous
            else FlowComparison(scene, self._fluid)
        )

    # -- fields ------------------------------------------------------------------------------------

    def displacement(self) -> np.ndarray:
        """Return the displacement of solid and mesh from the datum, (n_local, d) [m]."""
        u = self._coupling.displacement()
        return u if self.datum is None else u - self.datum

    def porosity(self, mesh_state: MeshState) -> np.ndarray:
        """Return n_f at the nodes, (n_owned, 1)."""
        values = np.empty((self._fluid.n_cells, 1))
        for region, span in self._fluid.region_slices.items():
            if span.stop > span.start:
                values[span, 0] = (
                    self._at(self._fluid, region, span)
                    .fluid_fraction(mesh_state.configuration.J[span])
                    .mean(axis=1)
                )
        return self._in_fluid(values)

    def stress(self, u: np.ndarray, part: Domain | None = None) -> np.ndarray:
        """Return the effective Cauchy stress σ_E at the nodes, (n_owned, 6) [Pa]: xx, xy, xz, yy,
        yz, zz (2-D: plane strain, zz across the plane), around an axis rr, rz, 0, zz, 0, θθ.

        That of the displacement gradient which each element has at the node, averaged over the
        elements there, those of a part of the solid if one is given: of the order of the gradient,
        at a boundary too.
        """
        return self._averaged(u, _cauchy, part)

    def strain(self, u: np.ndarray, part: Domain | None = None) -> np.ndarray:
        """Return the strain at the nodes, (n_owned, 6) [-], in the order of `stress` and averaged
        as it is: Green's, of a law for small strain the symmetric displacement gradient.
        """
        return self._averaged(u, _strain, part)

    def plastic_strain(self) -> np.ndarray:
        """Return the accumulated plastic strain of the accepted state at the nodes, (n_owned, 1)
        [-]: linear between the points of an element, nowhere negative, averaged over elements.
        """
        domain = self._solid
        values = np.zeros((*domain.cells.shape, 1))
        for region, chunk in domain.chunks(STRESS_DOUBLES * domain.cells.shape[1]):
            law = self._materials[region].elastic
            if law is not None and law.plastic:
                at_nodes = self._coupling.solid.internal.at(law, chunk)
                values[chunk, :, 0] = np.maximum(law.plastic_strain(at_nodes), 0.0)
        return self._in_solid(values)

    def vorticity(self, v: np.ndarray, mesh_state: MeshState) -> np.ndarray:
        """Return ∇×v of the fluid's velocity (n_local, d) [m/s] at the nodes, [1/s]: in the plane
        ∂v_y/∂x - ∂v_x/∂y, (n_owned, 1), in space (n_owned, 3); averaged as the stress is.

        Derivatives are by the present positions, on a mesh at rest those of the reference.
        """
        domain = self._fluid
        values = np.empty((*domain.cells.shape, 3 if self._mesh.dim == 3 else 1))
        for _, chunk in domain.chunks(STRESS_DOUBLES * domain.cells.shape[1]):
            positions = domain.coordinates(chunk)
            if mesh_state.moving_mesh:
                positions = domain.gather(self._mesh.X + mesh_state.displacement, chunk)
            nodes = self._at_nodes(domain, positions, chunk)
            grad = displacement_gradient(nodes.G, domain.gather(v, chunk))
            spin = grad - transpose(grad)
            pairs = ((2, 1), (0, 2), (1, 0)) if self._mesh.dim == 3 else ((1, 0),)
            values[chunk] = np.stack([spin[..., i, j] for i, j in pairs], axis=-1)
        return self._in_fluid(values)

    def _averaged(self, u, tensor, part):
        """Return the averages, (n_owned, 6), of tensor(law, H) -> (..., 3, 3) at nodes."""
        domain = self._solid
        values = np.empty((*domain.cells.shape, 6))
        for region, chunk in domain.chunks(STRESS_DOUBLES * domain.cells.shape[1]):
            nodes = self._at_nodes(domain, domain.coordinates(chunk), chunk)
            H = three_dimensional(
                displacement_gradient(nodes.G, domain.displacement(u, chunk), nodes.hoop)
            )
            material = self._at(self._solid, region, chunk)
            law = self._coupling.solid.internal.law_at(material.elastic, chunk)
            found = tensor(law, H)
            pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
            values[chunk] = np.stack([found[..., i, j] for i, j in pairs], axis=-1)
        if part is None:
            return self._in_solid(values)
        return NodalAverage(part)(values[domain.rows_of(part)])

    def _at_nodes(self, domain, positions, chunk):
        """Return the `Geometry` of some elements of a domain at their nodes, which are at positions
        (E, A, d) [m].
        """
        element = domain.element
        nodes = element.node_coordinates
        rule = Rule.at(element, nodes, np.ones(len(nodes)))
        at_nodes = geometry(rule, positions)
        collapsed = is_collapsed(domain.cells[chunk], element)
        if collapsed.any():  # where a side is a point there is no gradient: that a little inside
            near = nodes + COLLAPSED * (element.cell.centroid - nodes)
            rule = Rule.at(element, near, np.ones(len(near)))
            at_nodes.G[collapsed] = geometry(rule, positions[collapsed]).G
        return at_nodes

    # -- oscillation -------------------------------------------------------------------------------

    def _interior_nodes(self):
        interior = self._fluid.holds[: self._mesh.n_owned].copy()
        for tag in self._mesh.facets:
            interior[owned_nodes(self._mesh, tag)] = False
        return interior

    def watch_pressure(self, p: np.ndarray) -> None:
        """Record |p - p̄| and |p| over interior nodes (Euclidean), p̄ the volume-weighted average
        over the elements of a node.
        """
        local = self._in_fluid(self._fluid.gather(p).mean(axis=1, keepdims=True))[:, 0]
        mine = p[: self._mesh.n_owned]
        rough = (mine - local)[self._interior]
        squares = self._mesh.comm.allreduce(np.array([np.vdot(rough, rough), np.vdot(mine, mine)]))
        self.roughness = max(self.roughness, float(np.sqrt(squares[0])))
        self.largest_pressure = max(self.largest_pressure, float(np.sqrt(squares[1])))

    @property
    def oscillation_indicator(self) -> float:
        """Return the largest |p - p̄| over the largest |p| of the run."""
        return self.roughness / self.largest_pressure if self.largest_pressure else 0.0

    def watch_volume(self, dt: float) -> None:
        """Record what the accepted step of size dt made of volume (collective)."""
        if self.volume:
            self.volume.add_step(dt)

    @property
    def volume_error(self) -> float:
        """Return the volume that a free fluid has made over what flowed through it [-]."""
        return self.volume.error if self.volume else 0.0

    def compare(self, clock: Clock, solid: Solid, fluid: Fluid) -> None:
        """Record the errors against the scene's exact solution where they are due (collective)."""
        if self.comparison:
            self.comparison.after_step(
                clock, solid.u if self._scene.is_porous else fluid.v, fluid.p
            )

    # -- neglected terms ---------------------------------------------------------------------------

    def remodel(self, scene: Scene) -> None:
        """Go on with another [model] of the scene; the sizes of what it does not leave out are
        dropped.
        """
        self._scene = scene
        self._materials = materials_of(scene, self._mesh)
        self.omissions = list(_omissions(scene, self._materials, self._lost_slip))
        self.sizes = {
            omission.name: self.sizes.get(omission.name, 0.0) for omission in self.omissions
        }
        self._lasting = {
            omission.name: self._lasting[omission.name]
            for omission in self.omissions
            if omission.lasts
        }

    def neglected_sizes(self, medium: AnyMedium, dt: float) -> dict[str, float]:
        """Return name -> size of every neglected term in the trial step of a medium
        (collective).
        """
        step = TrialStep(medium, dt)
        sizes = {
            "strain": lambda: self._largest_strain(step.u),
            "mesh_displacement": lambda: self._mesh_displacement(step.u),
            "reynolds": lambda: self._reynolds(step, medium.fluid.scheme),
            "solid_inertia": lambda: self._inertia(
                self._solid, step.solid_rate, step.solid_residual, lambda m: m.rho_s
            ),
            "fluid_inertia": lambda: self._inertia(
                self._fluid,
                step.fluid_rate,
                step.fluid_residual,
                lambda m: (1 - m.n_s0) * m.rho_fR,
                self._least_flow_force(step),
            ),
            "porosity_change": lambda: self._porosity_change(step.u),
            "viscosity": lambda: self._brinkman_ratio(step.u),
        }
        if (lost_slip := self._lost_slip) is not None:
            sizes["slip"] = lambda: lost_slip(step.mesh_u, step.v_f)
        return {omission.name: sizes[omission.name]() for omission in self.omissions}

    def watch_neglected(self, sizes: dict[str, float], dt: float, clock: Clock) -> None:
        """Record the sizes of an accepted step of size dt that ends at the present time of the
        `Clock`.
        """
        for name, size in sizes.items():
            found = self._lasting[name].add(size, dt, clock) if name in self._lasting else size
            self.sizes[name] = max(self.sizes[name], found)

    def require_limits(self, t: float) -> None:
        """Raise LimitError when a neglected term, or what a free fluid makes of volume, has passed
        its bound.
        """
        if self.volume:
            self.volume.require(t)
        for omission in self.omissions:
            size = self.sizes[omission.name]
            if omission.bound is not None and size > omission.bound:
                found = (
                    f"at t = {t:g} s the term left out reached {size:.3g} > {omission.bound:g}"
                    f" ({omission.meaning})"
                )
                advice = (
                    f"{omission.remedy}, or set limits.{omission.limit} to a larger bound or to"
                    ' "report"'
                )
                raise LimitError(f"[limits] {omission.limit}: {found}; {advice}")

    def neglected(self) -> dict[str, dict[str, Any]]:
        """Return name -> value, bound, meaning for the summary."""
        return {
            o.name: {"value": self.sizes[o.name], "bound": o.bound, "meaning": o.meaning}
            for o in self.omissions
        }

    def state(self) -> dict[str, Any]:
        """Return the numbers a restart needs."""
        errors = self.comparison.records if self.comparison else []
        return {
            "sizes": self.sizes,
            "lasting": {name: lasting.state() for name, lasting in self._lasting.items()},
            "roughness": self.roughness,
            "largest_pressure": self.largest_pressure,
            "errors": errors,
            "volume": self.volume.state() if self.volume else None,
        }

    def load(self, state: dict[str, Any], t: float) -> None:
        """Continue from `state` at the time t [s]; sizes of terms that are modelled now are
        dropped.
        """
        self.sizes.update(
            {name: size for name, size in state["sizes"].items() if name in self.sizes}
        )
        for name in self._lasting.keys() & state.get("lasting", {}).keys():
            self._lasting[name].load(state["lasting"][name])
        self.roughness = state["roughness"]
        self.largest_pressure = state["largest_pressure"]
        if self.comparison:
            self.comparison.resume(state["errors"], t)
        if self.volume and state.get("volume"):
            self.volume.load(state["volume"])

    def _maximum(self, cell_values):
        local = float(cell_values.max()) if cell_values.size else 0.0
        return self._mesh.comm.allreduce(local, MPI.MAX)

    def _gradients(self, u, domain):
        stiffness = domain.reference_stiffness
        return displacement_gradient(stiffness.G, domain.displacement(u), stiffness.hoop)

    def _largest_strain(self, u):
        E = green_strain(self._gradients(u, self._solid))
        return self._maximum(np.sqrt(np.einsum("...ij,...ij->...", E, E)))

    def _mesh_displacement(self, u):
        """Return the largest strain and rotation, |∇u|: to this part a mesh at rest has wrong
        lengths, areas and directions.

        Beside a free fluid, which has no ∇u on such a mesh, at least the part of its width by which
        its boundary moves.
        """
        H = self._gradients(u, self._solid)
        change = self._maximum(np.sqrt(np.einsum("...ij,...ij->...", H, H)))
        if self._scene.is_porous:
            return change
        return max(
            change, self._maximum(np.linalg.norm(self._solid.gather(u), axis=-1)) / self._width
        )

    @cached_property
    def _width(self):
        """Return the shortest side of the box around the fluid [m] (collective)."""
        X = self._mesh.X[self._fluid.holds]
        low = np.empty(self._mesh.dim)
        high = np.empty(self._mesh.dim)
        self._mesh.comm.Allreduce(X.min(axis=0, initial=np.inf), low, MPI.MIN)
        self._mesh.comm.Allreduce(X.max(axis=0, initial=-np.inf), high, MPI.MAX)
        return float((high - low).min())

    def _volume_ratio(self, u):
        """Return the mean J of every element of the fluid's mesh, (E, 1): 1 where it does not
        move.
        """
        if not self._scene.model.moving_mesh:
            return np.ones((self._fluid.n_cells, 1))
        return 1 + det_minus_one(self._gradients(u, self._fluid)).mean(axis=1, keepdims=True)

    def _reynolds(self, step, scheme):
        domain = self._fluid
        N = self._fluid.mass.N
        model = self._scene.model
        sizes = np.zeros(domain.n_cells)
        J = self._volume_ratio(step.u)
        c = domain.gather(step.v_f - step.v_m if model.moving_mesh else step.v_f)
        for region, span in domain.region_slices.items():
            material = self._at(self._fluid, region, span)
            n = material.fluid_fraction(J[span])
            rho = material.fluid_density(J[span])
            viscous = 4 * n * material.viscosity / domain.h[span, None] ** 2
            resistance = (
                material.drag(J[span]).smallest
                + viscous
                + (rho * scheme.c_v if model.fluid_inertia else 0.0)
            )
            convective = convective_scale(N, domain.reference.G[span], rho, c[span])
            sizes[span] = np.divide(convective, resistance).max(axis=1, initial=0.0)
        return self._maximum(sizes)

    def _least_flow_force(self, step):
        """Return the force [N] below which a pore fluid bears nothing (collective)."""
        return BEARING * step.solid_residual.largest_force() if self._scene.is_porous else 0.0

    def _inertia(self, domain, rate, residual, density, least=0.0):
        """Return the norm of lumped mass times the rate of the velocity over the largest force of
        the phase in the step, or over a least one.
        """
        force = self._lumped_mass(domain, density)[:, None] * rate[: self._mesh.n_owned]
        norm = np.sqrt(self._mesh.comm.allreduce(float(np.vdot(force, force))))
        largest = max(residual.largest_force(), least)
        return norm / largest if largest else 0.0

    def _at(self, domain, region, rows):
        """Return the material of some elements of a domain."""
        return self._materials[region].at(domain.cell_numbers[rows])

    def _lumped_mass(self, domain, density):
        weights = np.zeros(domain.n_cells)
        for region, span in domain.region_slices.items():
            rho = np.ravel(density(self._at(domain, region, span)))
            weights[span] = rho * domain.reference.dV[span].sum(axis=1)
        A = domain.cells.shape[1]
        return domain.scatter_add(np.repeat(weights[:, None] / A, A, axis=1)[..., None])[:, 0]

    def _porosity_change(self, u):
        J = 1 + det_minus_one(self._gradients(u, self._fluid))
        change = np.zeros(self._fluid.n_cells)
        for region, span in self._fluid.region_slices.items():
            n_s0 = self._at(self._fluid, region, span).n_s0
            largest = np.abs(n_s0 * (1 - 1 / J[span])).max(axis=1, initial=0.0)
            change[span] = largest / (1 - np.ravel(n_s0))
        return self._maximum(change)

    def _brinkman_ratio(self, u):
        ratio = np.zeros(self._fluid.n_cells)
        J = self._volume_ratio(u)
        for entry in self._scene.material:
            for region, span in self._fluid.region_slices.items():
                if (
                    entry.fluid
                    and entry.fluid.viscosity
                    and region
                    in (
                        *entry.region,
                        region if entry.region == ("all",) else None,
                    )
                ):
                    material = self._at(self._fluid, region, span)
                    h = self._fluid.h[span, None]
                    viscosity = entry.fluid.brinkman_viscosity
                    viscous = 4 * material.fluid_fraction(J[span]) * viscosity / h**2
                    ratio[span] = (viscous / material.drag(J[span]).smallest).max(
                        axis=1, initial=0.0
                    )
        return self._maximum(ratio)


def _cauchy(law, H):
    """Return the Cauchy stress of a law, (..., 3, 3) [Pa], for displacement gradients H."""
    P = law.stress(H)
    if law.small_strain:
        return P
    return (P @ transpose(deformation(H))) / (1 + det_minus_one(H))[..., None, None]


def _strain(law, H):
    """Return the strain that a law sees, (..., 3, 3), for displacement gradients H."""
    return 0.5 * (H + transpose(H)) if law.small_strain else green_strain(H)


def _omissions(scene, materials, lost_slip):
    """Yield what a scene without "auto" terms leaves out; lost_slip : `LostSlip` or None."""
    model = scene.model

    def left_out(name, term, remedy, meaning, lasts=False):
        limit = LIMIT_OF.get(term, name)
        bound = getattr(scene.limits, limit)
        return Omission(
            name, limit, None if bound == "report" else bound, term, remedy, meaning, lasts
        )

    if any(material.elastic and material.elastic.small_strain for material in materials.values()):
        meaning = "largest norm of the Green strain under a small-strain law"
        yield left_out("strain", "", "take a law for large strain in material.solid.law", meaning)
    solids, fluids = scene.phases
    if not model.moving_mesh and solids and fluids:
        width = "" if scene.is_porous else ", or displacement over the width of the fluid,"
        meaning = f"largest strain and rotation, |grad u|{width} on the fixed mesh"
        yield left_out("mesh_displacement", "moving_mesh", "set model.moving_mesh = true", meaning)
    if not model.convection and fluids:
        lasts = scene.is_porous and scene.time.scheme != "steady"
        meaning = "convection over transient, drag and viscous forces at element scale"
        meaning += ", where it lasts" if lasts else ""
        yield left_out("reynolds", "convection", "set model.convection = true", meaning, lasts)
    for phase, present in (("solid", solids), ("fluid", fluids)):
        term = f"{phase}_inertia"
        if not getattr(model, term) and present and scene.time.scheme != "steady":
            meaning = f"inertia of the {phase} over the largest force on it, where it lasts"
            yield left_out(term, term, f"set model.{term} = true", meaning, lasts=True)
    if lost_slip is not None:
        layer = lost_slip.thinnest_layer()
        remedy = (
            "make the cells of the porous solid at the free fluid as thin as its Brinkman layer,"
            f" sqrt(K mu_e/mu) = {layer:.2g} m (mesh: ratios)"
        )
        meaning = "slip along porous solids that the mesh does not resolve, over the largest speed"
        yield left_out("slip", "", remedy, meaning)
    if scene.has_pores:
        yield from _porous_omissions(scene, left_out)


def _pulls_fluid(scene):
    """Return whether a body force acts on a fluid."""
    return any(force.fluid != type(force.fluid)() for force in scene.body_forces)


def _porous_omissions(scene, left_out):
    """Yield what only a porous medium can leave out; beside a free fluid n_f is felt in the density
    of its fluid alone.
    """
    model = scene.model
    weighs = model.fluid_inertia or model.convection or _pulls_fluid(scene)
    if (scene.is_porous or weighs) and (model.porosity == "constant" or not model.moving_mesh):
        remedy = 'set model.porosity = "variable" and model.moving_mesh = true'
        meaning = "largest change of n_f that n_s = n_s0/J would give, over n_f"
        yield left_out("porosity_change", "porosity", remedy, meaning)
    if not model.viscosity and any(
        entry.kind == "porous" and entry.fluid.viscosity for entry in scene.material
    ):
        meaning = "viscous (Brinkman) over drag force at element scale"
        yield left_out("viscosity", "viscosity", "set model.viscosity = true", meaning)

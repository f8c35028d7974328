"""A free fluid: its level of pressure, its force on what bounds it, the operators of its solver."""

from collections.abc import Iterator
from functools import cached_property
from typing import Any

import numpy as np
from mpi4py import MPI

from ..kernels import exchange, shape
from ..kernels import flow as kernel
from ..linalg.constrained import BlockMatrix
from ..linalg.dense_block import DenselyCoupled
from ..linalg.solver import LinearSolver
from ..linalg.stopwatch import timed
from .coupling_data import MeshState, Rates
from .fluid import FluidPhase
from .pressure_operators import PressureOperators
from .residual import Residual
from .setup import FreeFluidSetup


class FreeFluid(FluidPhase):
    """An incompressible fluid between solids, which may flow through porous ones.

    `force` is that on its boundary at the end of the accepted step, (n_owned, d) [N], `_force0` the
    collocated one.
    """

    setup: FreeFluidSetup

    def __init__(self, setup: FreeFluidSetup) -> None:
        """Take the setup (collective)."""
        self.robin_coefficient = 0.0  # α of a Robin condition [Pa s/m]
        self._pressure: PressureOperators | None = None
        self._carrying: DenselyCoupled | None = None
        super().__init__(setup)
        self.force, self._force0 = (np.zeros((self.mesh.n_owned, self.mesh.dim)) for _ in range(2))

    def _new_solver(self, matrix: BlockMatrix) -> LinearSolver:
        """Return the KSP, with what preconditions the pressure where it has a place for it."""
        setup = self.setup
        pressure = PressureOperators(setup) if self._has_operators else None
        null = setup.constant_pressures(self.domain, self.components, self.mesh.dim)
        preconditioner = pressure and pressure.preconditioner
        solver = setup.linear_solver(matrix, self._has_operators, preconditioner, null)
        self._pressure = pressure if solver.preconditioned_by_object else None
        return solver

    @property
    def _has_operators(self):
        """Return whether the pressure of an iterative solver is preconditioned by operators of its
        own.
        """
        materials = self.setup.materials.values()
        return self.setup.pspg and any(material.is_free_fluid for material in materials)

    def _begin(self, t: float, mesh_state: MeshState) -> None:
        for part in self.setup.closed:
            part.begin_step(t, self._t_end)
            if not self.setup.moving_mesh:
                part.require_balanced_data(self._t_end)

    def _residual_fields(self, mesh_state):
        """Return the trial fields; without inertia nothing remembers the step before, and the
        parameters are those of the trial state.
        """
        fields = self._trial_fields(mesh_state)
        if not self.setup.inertia:
            self._parameters.update(self.scheme.dt, self._rates, mesh_state, fields.nodal.v)
        return fields

    def _add_volume_terms(self, terms: dict[str, np.ndarray]) -> None:
        if self.setup.closed:
            terms["source"] = self._balancing_source(terms)

    def _balancing_source(self, terms):
        """Return the source in closed parts that takes the net flux of their data, (n_owned, 1)
        [m³/s] (collective).
        """
        source = np.zeros((self.mesh.n_owned, 1))
        for part in self.setup.closed:
            source[:, 0] -= part.net(list(terms.values())) * part.weight
        return source

    def _levelled(self, p):
        """Return a pressure (n_local,) with zero mean in closed parts (collective)."""
        for part in self.setup.closed:
            p = np.where(part.nodes, p - part.mean(p), p)
        return p

    def _fields(self, mesh_state, v, a, p, b):
        """Return the fields of a state; in pores b is such that ρ_f b is the weight ρ_fR b of a
        fluid that fills the volume, by which the pressure of one at rest grows.
        """
        if self.setup.body_force and any(m.averaged for m in self.setup.materials.values()):
            b = b.copy()
            for region, span in self.domain.region_slices.items():
                J = mesh_state.configuration.J[span]
                b[span] /= self.setup.material(region, span).fluid_fraction(J)[..., None]
        return super()._fields(mesh_state, v, a, p, b)

    # -- forces ------------------------------------------------------------------------------------

    def boundary_force(self, momentum: Residual) -> np.ndarray:
        """Return the force of a free fluid on what bounds it, (n_owned, d) [N]: minus the residual
        without given tractions.

        Inside it is zero up to the solver's tolerance; on boundary nodes no stress is recovered
        (Gresho et al. 1987).
        """
        return -momentum.without("traction")

    @property
    def end_force(self) -> np.ndarray:
        """Return `boundary_force` at the end of the converged trial step, (n_owned, d) [N]."""
        return self._at_end(self._force0, self.boundary_force(self._momentum))

    @property
    def end_interface_force(self) -> np.ndarray:
        """Return `end_force` without the tractions that are given on other boundaries, which those
        of the step stand for, (n_owned, d) [N]: on nodes of an interface what it feels.
        """
        return self.end_force - self._momentum.terms["traction"]

    @timed("residual")
    def interface_force(self, mesh_state: MeshState) -> np.ndarray:
        """Return the force of the trial state on the interface, (n_owned, d) [N], from the elements
        that touch it: minus their residual, without what the last one has of given tractions on
        other boundaries of its rim.
        """
        domain = self.domain
        force = np.zeros((domain.n_local, domain.dim))
        for region, rows in self._beside_interface.items():
            elements = self._elements(region, rows, mesh_state.configuration)
            momentum, _ = kernel.flow_residual(elements, self._trial_fields(mesh_state).on(rows))
            np.subtract.at(force, domain.cells[rows], momentum.sum(axis=0))
        force = force[: domain.n_owned] - self._momentum.terms["traction"]
        return np.where(self.setup.no_slip[: domain.n_owned, None], force, 0.0)

    @cached_property
    def _beside_interface(self):
        """Return region -> rows of the elements that touch the interface."""
        touching = np.flatnonzero(self.setup.no_slip[self.domain.cells].any(axis=1))
        slices = self.domain.region_slices.items()
        return {
            region: touching[(touching >= span.start) & (touching < span.stop)]
            for region, span in slices
        }

    def cancelling(self, mesh_state: MeshState, rates: Rates) -> dict[str, np.ndarray]:
        """Return field -> what cancels inside the terms of a free fluid, (n_owned,); a uniform flow
        has nothing else.

        Per element of volume V, with g = Σ_a |∇N_a| and c = v_f - v_m: V g |v_f| in ∫ q div v and V
        |v_f| (ρ c_f + ρ |c| g + μ g²) in the momentum, each in equal parts to its nodes.
        """
        domain = self.domain
        v = self._level(self.v, self._v1)
        nodal = np.zeros((self.mesh.n_owned, 2))
        speed, relative = (
            np.linalg.norm(field, axis=-1) for field in (v, v - mesh_state.mesh_velocity)
        )
        for region, chunk in domain.chunks(self._doubles_per_cell):
            material = self.setup.material(region, chunk)
            geometry = mesh_state.configuration.geometry.part(chunk)
            g = np.linalg.norm(geometry.G, axis=-1).sum(axis=2).max(axis=1, initial=0.0)
            flux = (
                geometry.dV.sum(axis=1)
                * domain.gather(speed, chunk).max(axis=1)
                / domain.cells.shape[1]
            )
            convective = (
                domain.gather(relative, chunk).max(axis=1) * g if self.setup.convection else 0.0
            )
            force = flux * (material.rho_fR * (rates.c_f + convective) + material.viscosity * g**2)
            both = np.column_stack([force, flux * g])[:, None]
            domain.add(nodal, chunk, np.broadcast_to(both, (len(both), domain.cells.shape[1], 2)))
        return dict(zip(("fluid momentum", "volume"), nodal.T, strict=True))

    def force_per_rate(self, rates: Rates) -> float:
        """Return the least force of a free fluid over the volume flux it goes with, (ρ c_f + μ
        g²)/g [N s/m³] (collective).

        What is left of forces that cancel, as in a fluid at rest under its weight, is a velocity by
        their round-off; g = Σ_a |∇N_a|.
        """
        least = np.inf
        for region, span in self.domain.region_slices.items():
            material = self.setup.material(region, span)
            g = self._steepness[span]
            least = min(
                least,
                ((material.rho_fR * rates.c_f + material.viscosity * g**2) / g).min(initial=np.inf),
            )
        return self.mesh.comm.allreduce(least, MPI.MIN)

    @cached_property
    def _steepness(self):
        """Return Σ_a |∇N_a| of the elements in the reference configuration, (E,) [1/m]."""
        return np.linalg.norm(self.domain.reference.G, axis=-1).sum(axis=2).max(axis=1, initial=0.0)

    # -- tangents ----------------------------------------------------------------------------------

    def correct(
        self, residuals: tuple[Residual, Residual], on_interface: np.ndarray | None = None
    ) -> None:
        """Solve H δ = -residual and add δ to the trial state; see `FluidPhase.correct`."""
        momentum, volume = residuals
        force = momentum.total
        if self.setup.robin is not None:
            assert on_interface is not None
            force = force + np.where(self.setup.released[: len(force)], on_interface, 0.0)
        self.add(self.solve(-np.column_stack([force, volume.total])))

    @property
    def interface_unknowns(self) -> np.ndarray:
        """Return owned nodes and components, (N, 2), of the velocities of an interface that the
        solver finds.
        """
        return np.argwhere(self.setup.released[: self.mesh.n_owned])

    def carry(self, stiffness: np.ndarray) -> None:
        """Add a dense matrix of the interface's unknowns, rank by rank as in `interface_unknowns`,
        to the tangent (collective).

        stiffness : (N, N) force per velocity [N s/m], the same on every rank; to be given again
        after every assembly
        """
        assert self.block.matrix is not None  # after an assembly
        if self._carrying is None:
            node, component = self.interface_unknowns.T
            numbers = self.domain.numbering[node] * self.components + component
            self._carrying = DenselyCoupled(
                self.block.matrix.mat, np.concatenate(self.mesh.comm.allgather(numbers))
            )
        self._carrying.assemble(stiffness)
        self.block.use(self._carrying.mat)

    def _complete(self, K, elements, region, chunk, mesh_state, rates):
        """Add the Robin condition of an interface."""
        if self.setup.robin is not None:
            self.setup.robin.add_to(K, self.robin_coefficient, chunk, self.mesh.dim)

    def _prepare_solver(self, mesh_state, rates, fields):
        """Make the operators that precondition the pressure at the state of the tangent."""
        if self._pressure is None:
            return
        speed = np.linalg.norm(fields.nodal.c[self.domain.holds], axis=-1).max(initial=0.0)
        speed = self.mesh.comm.allreduce(float(speed), MPI.MAX)
        diagonal = self.block.matrix.mat.getDiagonal().getArray()
        diagonal = diagonal[self.mesh.dim :: self.components]

        def chunks():
            for region, chunk in self.domain.chunks(self._doubles_per_cell):
                yield (
                    chunk,
                    self._elements(region, chunk, mesh_state.configuration),
                    fields.on(chunk),
                )

        self._pressure.assemble(chunks, rates.c_f, speed, self.robin_coefficient, diagonal)

    def drag_tangents(
        self, rates: Rates, mesh_state: MeshState
    ) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (chunk, derivative (E, A, d + 1, A, d) of a free fluid's residuals by the skeleton
        it flows through).
        """
        fields = self._trial_fields(mesh_state)
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            if self.setup.material(region, chunk).resists:
                elements = self._elements(region, chunk, mesh_state.configuration)
                yield chunk, exchange.flow_by_drag(elements, fields.on(chunk), rates.c_v)

    def mesh_tangents(
        self, rates: Rates, mesh_state: MeshState
    ) -> Iterator[tuple[slice, np.ndarray]]:
        """Yield (chunk, derivative (E, A, d + 1, A, d) of a free fluid's residuals by its mesh) of
        the trial state.
        """
        fields = self._trial_fields(mesh_state)
        for region, chunk in self.domain.chunks(self._doubles_per_cell):
            elements = self._elements(region, chunk, mesh_state.configuration)
            part = fields.on(chunk)
            derivatives = self._volume_derivatives(region, chunk, mesh_state.configuration)
            yield (
                chunk,
                shape.flow_by_geometry(elements, part, derivatives)
                + exchange.flow_by_mesh_velocity(elements, part, rates.c_v),
            )

    def _volume_derivatives(self, region, chunk, configuration):
        """Return how density and drag of the elements of a region follow the volume, None outside
        of pores.
        """
        material = self.setup.material(region, chunk)
        if not material.resists:
            return None
        return shape.VolumeDerivatives(*material.volume_derivatives(configuration.J[chunk]))

    # -- end of a step -----------------------------------------------------------------------------

    def accept(self) -> None:
        """Make the trial state the accepted one (collective)."""
        self.force = self.end_force
        self._force0 = self.boundary_force(self._momentum)
        super().accept()

    def state(self) -> dict[str, np.ndarray]:
        """Return every array a restart needs, name -> (n_owned, ...)."""
        return {"force": self.force, "force_collocated": self._force0} | super().state()

    def load_state(self, arrays: dict[str, np.ndarray], *args: Any) -> None:
        """Continue from `state` and `memory`; see `FluidPhase.load_state`."""
        self.force = arrays["force"]
        self._force0 = arrays["force_collocated"]
        super().load_state(arrays, *args)

"""The change from one stage of a run to the next: the state goes over as it is.

Positions, velocities, accelerations and pressure are those at the end of the stage before, so that
what a stage changes at once acts as a formula that jumps at that time does in a run of one stage.
Tangents and what an accelerator has learnt belong to the stage before and are made anew.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..coupling.protocols import Arrays
from ..output.checkpoint import is_of_cells
from ..phases.coupling_data import Rates
from ..phases.internal import ARRAY
from ..phases.surface_terms import SurfaceTerms
from .auto import AnyMedium, without_tangents
from .placement import Placed

if TYPE_CHECKING:
    from .simulation import Simulation

SURFACES = ("solid", "fluid")
INTERNAL = f"solid.{ARRAY}"
FADING = "solid.fading"


class Left:
    """What a stage leaves to the next one."""

    def __init__(self, simulation: Simulation) -> None:
        """Take it from the accepted state (collective)."""
        coupling = simulation.coupling
        loop = simulation.loop
        self._arrays = {
            name: array for name, array in coupling.state().items() if ".tangent_" not in name
        }
        self._memory = without_tangents(coupling.memory())
        self._surfaces = {name: _memories(getattr(coupling, name).surfaces) for name in SURFACES}
        self._clock = loop.clock.state()
        self._iterations = loop.iterations
        self._measures = simulation.measures.state()
        self._datum = simulation.measures.datum
        self._volumes = simulation.quantities.memory()

    def take(self, placed: Placed) -> None:
        """Add the nodes of regions that are placed, at rest where they are; reported displacements
        of them are measured from there.
        """
        n = len(self._arrays["solid.u"])
        nodes = placed.nodes[:n]
        values = {"solid.u": placed.u, "fluid.p": placed.p, "fluid.p_collocated": placed.p}
        for name in values.keys() & self._arrays.keys():
            array = self._arrays[name].copy()
            array[nodes] = values[name][:n][nodes]
            self._arrays[name] = array
        datum = np.zeros_like(placed.u) if self._datum is None else self._datum
        self._datum = np.where(placed.nodes[:, None], placed.u, datum)

    def continue_in(self, simulation: Simulation) -> None:
        """Give it to the parts of the stage that begins (collective).

        The energy that other moduli or densities give the same state counts as given at the start.
        """
        coupling = simulation.coupling
        loop = simulation.loop
        loop.clock.load(self._clock | {"nominal": loop.clock.nominal})
        loop.iterations.extend(self._iterations)
        if loop.auto:
            loop.auto.resume(self._memory)
            simulation.measures.remodel(loop.auto.scene)
        schemes, rates = loop.clock.next_schemes(loop.model)
        arrays = self._within(coupling)
        memory = self._with_linear(coupling, rates)
        coupling.load_state(arrays, memory, schemes, rates)
        if coupling.solid.fading:  # the tangents are made again, as a restart does
            arrays[FADING] = _unbalanced(coupling, schemes, rates, loop.clock.t)
            coupling.load_state(arrays, memory, schemes, rates)
        for name, memories in self._surfaces.items():
            surfaces = getattr(coupling, name).surfaces
            keys = [key for key in surfaces.memory() if _kind(key) in memories]
            surfaces.load({key: memories[_kind(key)] for key in keys})
        simulation.measures.load(self._measures, loop.clock.t)
        resets = simulation.scene.stage[simulation.stage - 1].reset_displacement
        simulation.measures.datum = coupling.displacement().copy() if resets else self._datum
        simulation.quantities.load(simulation.scene.source_path, self._volumes)
        simulation.energy.remodel(*coupling.energies())

    def _within(self, coupling: AnyMedium) -> Arrays:
        """Return the arrays, where the phases have no nodes any more at rest, displaced as at the
        end of the stage before.
        """
        found = self._arrays | self._remembered(coupling)
        if "mesh.u" in found and not coupling.fluid.domain.n_nodes:
            found["mesh.u"] = found["solid.u"]  # which is reported where there is no solid
        for phase in SURFACES:
            domain = getattr(coupling, phase).domain
            gone = ~domain.holds[: domain.n_owned]
            for name, array in self._arrays.items():
                kind, _, key = name.partition(".")
                if kind == phase and key != "u" and not is_of_cells(name):
                    found[name] = np.where(gone.reshape(-1, *(1,) * (array.ndim - 1)), 0.0, array)
        if coupling.solid.fading:  # of this stage, which is found from the others
            found[FADING] = coupling.solid.fading.at_start
        return found

    def _remembered(self, coupling):
        """Return the internal variables of a stage whose laws may have other ones than those of the
        stage before: zero where there were none.
        """
        state = coupling.state()
        if INTERNAL not in state:
            return {}
        values = np.zeros_like(state[INTERNAL])
        before = self._arrays.get(INTERNAL, values[..., :0])
        both = min(before.shape[-1], values.shape[-1])
        values[..., :both] = before[..., :both]
        return {INTERNAL: values}

    def _with_linear(self, coupling: AnyMedium, rates: Rates) -> dict:
        """Return the memory with the rates of the linear phases, whose tangent is then made where a
        restart makes it, the same to the last digit.
        """
        made = {"rates": [rates.c_f, rates.c_v, rates.c_a], "built_with": None}
        linear = [name for name in SURFACES if getattr(coupling, name).is_linear]
        return self._memory | {name: self._memory[name] | made for name in linear}


def _unbalanced(coupling, schemes, rates, t):
    """Return what balances the accepted state under what acts in the first step, (n_owned, d) [N]:
    minus the residual of solid and fluid together, in which the drag cancels (collective).
    """
    solid, fluid = coupling.solid, coupling.fluid
    n = solid.mesh.n_owned
    coupling.begin_phases(schemes, rates, t)
    solid.unknowns = solid.u[:n]
    fluid.unknowns = np.column_stack([fluid.v[:n], fluid.p[:n]])
    flows = fluid.residual(coupling.mesh_state())
    residual = solid.residual(coupling.flow(flows)).total + flows[0].total
    coupling.reset()
    return solid.setup.dirichlet.free(residual)


def _memories(surfaces: SurfaceTerms) -> dict:
    """Return kind and tag of a condition -> its memory."""
    return {_kind(key): memory for key, memory in surfaces.memory().items()}


def _kind(key: str) -> str:
    """Return kind and tag of the key of a condition, without the number of its entry."""
    return key.split(".", 2)[-1]

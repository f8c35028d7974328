"""The state at t = 0 is that of [initial], and what this may not contradict.

What [initial] gives has to agree with what is prescribed at 0+.  What it does not give is at rest,
and a boundary that is prescribed something else goes there in the first step: a jump at 0+ is a
load like any other, of which the balances see all.
"""

import collections
import itertools

import numpy as np

from ..config import Scene
from ..errors import InputError
from ..fem.boundary import facet_normals, interface_facets
from ..fem.essential import first_node
from ..fem.transfer import InterfaceTransfer
from ..phases.fluid import FluidPhase
from ..phases.mesh_motion import MeshMotion
from ..phases.solid import SolidPhase
from .conditions import (
    AXES,
    at_once,
    components,
    linear_constraints,
    nodal_field,
    rate_after,
    sample_times,
)

# of the largest value: below errors of discretization, above the digits of numbers that were
# written by hand
AGREE = 1e-3
# of the largest speed: on coarse facets of a curved wall a flow along it has that much to flow
# through them
THROUGH = 0.1


def put_at_start(
    scene: Scene,
    solid: SolidPhase,
    fluid: FluidPhase,
    motion: MeshMotion | None = None,
    transfer: InterfaceTransfer | None = None,
) -> None:
    """Give the phases the state at t = 0; raise InputError where it contradicts what is prescribed
    at 0+ (collective).

    motion, transfer : of the mesh of a free fluid, and of the solid's velocity to the interface, to
    which the fluid sticks
    """
    if scene.time.begins:  # with the state of the stage before
        return
    start = _Start(scene, solid, fluid, transfer)
    if scene.time.scheme != "steady":  # whose initial state is but a first guess
        start.require_displacement()
        start.require_solid_velocity()
        start.require_fluid_velocity()
    solid.set_initial(start.u, start.v_s)
    if motion is not None:
        motion.set_initial(start.u, start.v_s)
    fluid.set_initial(start.flow(), start.pressure(), start.is_balanced())


class _Start:
    """The fields of [initial], (n_local, d), beside what is prescribed."""

    def __init__(self, scene, solid, fluid, transfer):
        self._scene = scene
        self._mesh = solid.mesh
        self._initial = scene.initial
        self._solid = solid.setup
        self._fluid = fluid.setup
        self._now = at_once(scene.time)
        names = "displacement", "solid_velocity", "fluid_velocity"
        self.u, self.v_s, self._v_f = (
            nodal_field(self._mesh, getattr(self._initial, name)) for name in names
        )
        self._sticking = self.v_s if transfer is None else transfer.to_fluid(self.v_s)
        self._transfer = transfer

    def flow(self):
        """Return v_f, on an interface that of the solid."""
        if self._transfer is None:
            return self._v_f
        return np.where(self._fluid.no_slip[:, None], self._sticking, self._v_f)

    def pressure(self):
        """Return p, (n_local,)."""
        given = self._initial.pressure
        return np.zeros(self._mesh.n_local) if given is None else given(0.0, self._mesh.X)

    def is_balanced(self):
        """Return whether p is given and that of all drained surfaces at 0+ (collective)."""
        if self._initial.pressure is None:
            return False
        conditions = self._fluid.pressures
        p = self.pressure()[:, None]
        values = self._values(conditions, self._now)
        scale = self._largest(p, *values, *self._values(conditions, self._scene.time.step))
        return self._first_apart(conditions, p, values, AGREE * scale) is None

    # -- what is given against what is prescribed --------------------------------------------------

    def require_displacement(self):
        """Refuse a given displacement that is another one at 0+, and with inertia a jump of what is
        not given.
        """
        conditions = self._solid.dirichlet.conditions
        values = self._values(conditions, self._now)
        moved = self._scene.time.step * self._speed(
            conditions
        )  # in a step: a jump of AGREE of it is lost in the motion
        agree = AGREE * max(self._largest(self.u, *values), moved)
        given = components(self._initial.displacement)
        counts = [condition.given.component in given for condition in conditions]
        some, wanted = (list(itertools.compress(whole, counts)) for whole in (conditions, values))
        apart = self._first_apart(some, self.u, wanted, agree)
        if apart is not None:
            self._refuse(
                "displacement", apart, "m", "then the boundary moves there in the first step"
            )
        apart = self._first_apart(conditions, self.u, values, agree)
        if apart is not None and self._has_inertia:
            self._refuse_jump(*apart)
        if self._solid.dirichlet.constraints is not None and (self._has_inertia or given):
            self._require_constraints()

    def _require_constraints(self):
        """Refuse a start at which a linear constraint of the displacement does not hold."""
        dirichlet = self._solid.dirichlet
        nodes = dirichlet.constraints.nodes
        gap, moved = (self._gap(t)[nodes] for t in (self._now, self._scene.time.step))
        agree = AGREE * self._largest(self.u, moved)
        found = zip(nodes[gap > agree], gap[gap > agree], strict=True)
        apart = first_node(self._mesh, found)
        if apart is not None:
            place, size = apart
            name = linear_constraints(self._scene)[0].name
            raise InputError(
                f"{self._where} [{name}]: received a displacement at 0+ at the node ({place}) m"
                f" that is {size:g} m from that of [initial]; expected the same, let it grow from"
                " there over some steps"
            )

    def _gap(self, t):
        """Return how far each owned node is at the start from what holds at a time, (n_owned,)
        (collective).
        """
        wanted = self.u.copy()
        self._solid.dirichlet.apply(wanted, t)
        return np.abs(wanted - self.u)[: self._mesh.n_owned].max(axis=1, initial=0.0)

    @property
    def _has_inertia(self):
        model, (solid, fluid) = self._scene.model, self._scene.phases
        return (solid and model.solid_inertia is True) or (fluid and model.fluid_inertia is True)

    def require_solid_velocity(self):
        """Refuse a given velocity of the solid that is not the rate of the prescribed displacement
        at 0+.
        """
        conditions = self._solid.dirichlet.conditions
        time = self._scene.time
        found = [rate_after(lambda t, c=c: c.values(self._mesh, t), 0.0, time) for c in conditions]
        given = components(self._initial.solid_velocity)
        counts = [time.consistent_start or c.given.component in given for c in conditions]
        chosen, found = (list(itertools.compress(whole, counts)) for whole in (conditions, found))
        wanted, uncertain = ([pair[i] for pair in found] for i in (0, 1))
        scale = max(self._largest(self.v_s, *wanted), self._speed(conditions))
        agree = [AGREE * scale + error for error in uncertain]
        apart = self._first_apart(chosen, self.v_s, wanted, agree)
        if apart is not None:
            self._refuse(
                "solid_velocity", apart, "m/s", "then the boundary jumps in the first step"
            )

    def require_fluid_velocity(self):
        """Refuse a given velocity of the fluid that flows through its boundary otherwise than what
        is prescribed at 0+.

        Only the normal component counts, in the mean of a facet: a flow that slips along a wall at
        t = 0 is a good start.
        """
        given = set(components(self._initial.fluid_velocity))
        counts = set(range(self._mesh.dim)) if self._scene.time.consistent_start else given
        surfaces = [surface for surface in self._surfaces(counts) if counts]
        largest = self._largest(self._v_f, *(np.nan_to_num(wanted) for *_, wanted in surfaces))
        agree = max(THROUGH * largest, AGREE * self._fastest_flow())
        found = []
        for number, (_, nodes, normal, wanted) in enumerate(surfaces):
            difference = np.where(np.isfinite(wanted), self._v_f[nodes] - wanted, 0.0).mean(axis=1)
            through = (difference * normal).sum(axis=1)
            here = np.abs(through) > agree
            first = nodes[here, self._mesh.natural[nodes[here]].argmin(axis=1)]
            found += [(node, number, size) for node, size in zip(first, through[here], strict=True)]
        first = first_node(self._mesh, found)
        if first is not None:
            place, number, size = first
            self._refuse_flow(surfaces[number][0], place, size)

    def _fastest_flow(self):
        """Return the largest velocity that is prescribed to the fluid in the run (collective)."""
        conditions = self._fluid.velocity.conditions
        times = sample_times(self._scene.time)
        return self._largest(*(c.values(self._mesh, t) for c in conditions for t in times))

    def _surfaces(self, counts):
        """Return (name, nodes (F, Af), normals (F, d), wanted velocity (F, Af, d), nan where free)
        around the fluid.
        """
        prescribed = collections.defaultdict(list)
        for condition in self._fluid.velocity.conditions:
            if condition.given.component in counts:
                prescribed[condition.given.tag].append(condition.given)
        surfaces = [
            (f"'{tag}'", *self._facets(tag), entries) for tag, entries in sorted(prescribed.items())
        ]
        found = [
            (name, nodes, normal, self._wanted(nodes, entries))
            for name, nodes, normal, entries in surfaces
        ]
        walls = sorted(tag for b in self._scene.boundary if b.no_slip for tag in b.on)
        sticking = [(f"'{tag}'", *self._facets(tag)) for tag in walls]
        if self._transfer is not None:
            sticking.append(("the interface", *self._interface()))
        return found + [
            (name, nodes, normal, self._sticking[nodes]) for name, nodes, normal in sticking
        ]

    def _wanted(self, nodes, entries):
        """Return the prescribed velocity on the nodes of facets, nan where none is, (F, Af, d)."""
        points = self._mesh.X[nodes.ravel()]
        wanted = np.full((*nodes.shape, self._mesh.dim), np.nan)
        for entry in entries:
            wanted[..., entry.component] = entry.expression(self._now, points).reshape(nodes.shape)
        return wanted

    def _facets(self, tag):
        """Return nodes (F, Af) and normals (F, d) of the facets of a tag on the fluid, each on one
        rank.
        """
        facets = self._mesh.facets[tag]
        here = facets.owned & (self._fluid.domain.row_of_cell[facets.cells] >= 0)
        return facets.nodes[here], facet_normals(self._mesh, facets.nodes[here])

    def _interface(self):
        """Return the same of the facets on which the fluid sticks to the solid."""
        fluid = self._fluid.domain
        tags = [tag for pair in self._scene.interface for tag in pair.fluid]
        rows, local = interface_facets(fluid, self._solid.domain, tags)
        nodes = fluid.cells[rows[:, None], np.array(fluid.element.facets)[local]][fluid.owned[rows]]
        return nodes, facet_normals(self._mesh, nodes)

    # -- sentences ---------------------------------------------------------------------------------

    @property
    def _where(self):
        return self._scene.source_path or "scene"

    def _refuse(self, name, apart, unit, otherwise):
        entry, place, given, wanted = apart
        where = f"at the node ({place}) m of '{entry.tag}'"
        received = (
            f"received {given:g} {unit} {where}, while {entry.name} starts with {wanted:g} {unit}"
            " there"
        )
        key = f"{self._where} [initial.{name}.{AXES[entry.component]}]"
        raise InputError(f"{key}: {received}, expected the same; {self._advice(otherwise)}")

    def _refuse_flow(self, name, place, size):
        received = (
            f"received a flow of {size:g} m/s through {name} at the node ({place}) m beside what is"
            " prescribed there at 0+"
        )
        advice = self._advice("then the flow starts with the first step")
        raise InputError(
            f"{self._where} [initial.fluid_velocity]: {received}, expected none; {advice}"
        )

    def _advice(self, otherwise):
        if self._scene.time.consistent_start:
            return (
                "change one: a consistent start (time.consistent_start) begins with the prescribed"
                " velocities"
            )
        return f"change one, or leave out the initial value: {otherwise}"

    def _refuse_jump(self, entry, place, given, wanted):
        axis = AXES[entry.component]
        received = (
            f"received {wanted:g} m at 0+ at the node ({place}) m of '{entry.tag}', which is at"
            f" {given:g} m"
        )
        advice = (
            f"let it grow from there, as in '{wanted:g}*minimum(t/{10 * self._scene.time.step:g},"
            f" 1)', give initial.displacement.{axis}, or leave the inertia out (model.solid_inertia"
            " and fluid_inertia = false)"
        )
        raise InputError(
            f"{self._where} [{entry.name}]: {received}, a jump, which with inertia has no velocity;"
            f" {advice}"
        )

    # -- comparison --------------------------------------------------------------------------------

    def _values(self, conditions, t):
        return [condition.values(self._mesh, t) for condition in conditions]

    def _largest(self, *arrays):
        """Return the largest absolute value on all ranks (collective)."""
        mine = max((float(np.abs(array).max(initial=0.0)) for array in arrays), default=0.0)
        return max(self._mesh.comm.allgather(mine))

    def _speed(self, conditions):
        """Return the largest mean rate from 0+ to a time of the run, the first step among them
        (collective).
        """
        start = self._values(conditions, self._now)
        times = sample_times(self._scene.time)[1:]
        ends = ((self._values(conditions, t), t) for t in times)
        return self._largest(
            *((b - a) / t for end, t in ends for a, b in zip(start, end, strict=True))
        )

    def _first_apart(self, conditions, field, values, agree):
        """Return `Essential`, place, present and wanted value of the first node with a difference,
        or None (collective).

        agree : the difference that is none, one number or a list of (n,) as values
        """
        found = []
        bounds = agree if isinstance(agree, list) else itertools.repeat(agree, len(conditions))
        for number, (condition, wanted, bound) in enumerate(
            zip(conditions, values, bounds, strict=True)
        ):
            has = field[condition.nodes, condition.given.component]
            apart = np.abs(has - wanted) > bound
            found += [
                (node, number, a, b)
                for node, a, b in zip(
                    condition.nodes[apart], has[apart], wanted[apart], strict=True
                )
            ]
        first = first_node(self._mesh, found)
        if first is None:
            return None
        place, number, has, wanted = first
        return conditions[number].given, place, has, wanted

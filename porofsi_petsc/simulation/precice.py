"""A run as a participant of preCICE, the library that couples programs by files of configuration
(Chourdakis et al., Open Research Europe 2 (2022) 51).
"""

import importlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ..clock import Scheme
from ..config.precice import Precice
from ..coupling.participant import Participant
from ..errors import ConvergenceError, InputError, digits
from ..fem.distribute import LocalMesh
from ..fem.surface_nodes import SurfaceNodes, surface_facets
from ..output.surface import split, triangles_of
from ..phases.coupling_data import Rates
from .precice_config import Configuration, Iterations

SAME = 1e-9  # of a time window: steps that differ by less are of one size


class Partner:
    """What the other program and this one tell each other in a time window.

    preCICE repeats a window of implicit coupling until its data agree: the step is solved again
    from the accepted state, which no trial touches. The programs meet in the first step, so that
    a scene is looked at without the other one.
    """

    def __init__(self, section: Precice, medium: Participant, where: str) -> None:
        """Take the [precice] section and the medium; where : the scene, for messages."""
        self._section = section
        self._medium = medium
        self._where = f"{where} [precice]"
        self._link: Any = None
        self._vertices: _Vertices
        self._allowed: Iterations

    def solving(self, solve: Callable[..., None]) -> Callable[[tuple[Scheme, Scheme], Rates], None]:
        """Return a function that solves a step together with the other program (collective).

        solve : (schemes, rates) -> None, which solves it alone
        """

        def together(schemes: tuple[Scheme, Scheme], rates: Rates) -> None:
            dt = schemes[0].dt
            with self._told():
                self._require_window(dt)
            iterations = 0
            agreed = False
            while not agreed:
                with self._told():
                    self._link.requires_writing_checkpoint()  # which the accepted state is
                    self._read(schemes[0])
                self._alone(solve, schemes, rates)
                iterations += 1
                agreed = self._advance(dt, iterations)
            if not self._allowed.end_agrees(iterations):
                raise self._unconverged(iterations)

        return together

    def finish(self) -> None:
        """End the coupling at the end of the run; raise InputError where the other program goes on
        (collective).
        """
        if self._link is None:
            return
        with self._told():
            ongoing = self._link.is_coupling_ongoing()
            self.close()
        if ongoing:
            raise InputError(
                f"{self._where}: the coupling goes on after time.end, expected its end there; let"
                " max-time of the preCICE configuration be time.end"
            )

    def close(self) -> None:
        """Leave the coupling."""
        if self._link is not None:
            self._link.finalize()
            self._link = None

    # -- a window ----------------------------------------------------------------------------------

    def _require_window(self, dt):
        """Raise InputError unless the next time window is a step of size dt."""
        if self._link is None:
            self._connect()
        if not self._link.is_coupling_ongoing():
            raise InputError(
                f"{self._where}: the coupling has ended before time.end, expected its end there;"
                " let max-time of the preCICE configuration be time.end"
            )
        window = self._link.get_max_time_step_size()
        if abs(dt - window) > SAME * window:
            raise InputError(
                f"{self._where}: received time windows of {digits(window)} s, expected steps of"
                f" this program, {digits(dt)} s; let time-window-size be time.step"
            )

    def _alone(self, solve, schemes, rates):
        """Solve the step; another size would leave the time window."""
        try:
            solve(schemes, rates)
        except ConvergenceError as error:
            text = "take smaller time windows (time.step and time-window-size), or relax the data"
            raise ConvergenceError(error.what, f"{text} (acceleration)") from error

    def _advance(self, dt, iterations):
        """Tell this program's values; return whether the window is at its end."""
        with self._told():
            self._write(self._medium.answer())
        try:
            self._link.advance(dt)
        except RuntimeError as error:
            if self._allowed.has_last(iterations):  # of a strict measure
                raise self._unconverged(iterations) from error
            raise self._refused(error) from error
        return not self._link.requires_reading_checkpoint()

    def _unconverged(self, iterations):
        """Return the error of a window that took all iterations it may have."""
        return ConvergenceError(
            f"{self._where}: a time window took all {iterations} iterations that max-iterations of"
            " the preCICE configuration allows, at which preCICE goes on whether its data agree or"
            " not",
            "allow more of them, take smaller time windows or another acceleration",
        )

    def _read(self, scheme):
        section = self._section
        t = self._medium.told_at(scheme)
        values = self._link.read_data(section.mesh, section.read, self._vertices.numbers, t)
        self._medium.take(*self._vertices.scatter(values))

    def _write(self, field):
        section = self._section
        values = self._vertices.gather(field)
        self._link.write_data(section.mesh, section.write, self._vertices.numbers, values)

    # -- the other program -------------------------------------------------------------------------

    def _connect(self):
        """Find the other program, with the nodes on the interface (collective)."""
        section = self._section
        mesh = self._medium.solid.mesh
        try:
            library = importlib.import_module("precice")
        except ImportError as error:
            raise InputError(
                f"{self._where}: the Python bindings of preCICE cannot be imported ({error});"
                " install the library and pyprecice"
            ) from error
        link = library.Participant(
            section.participant, section.config, mesh.comm.rank, mesh.comm.size
        )
        configuration = Configuration(section.config)
        self._allowed = configuration.iterations(section.participant)
        self._require_constraints(configuration)
        self._require_dimension(section.mesh, link.get_mesh_dimensions(section.mesh), "mesh")
        for data in (section.read, section.write):
            found = link.get_data_dimensions(section.mesh, data)
            self._require_dimension(data, found, "vector")
        self._vertices = _Vertices(link, section.mesh, mesh, section.on)
        self._link = link
        if link.requires_initial_data():
            self._write(self._medium.start_values())
        link.initialize()

    def _require_dimension(self, name, found, kind):
        """Raise InputError unless a mesh or data of preCICE has the dimension of the scene."""
        dim = self._medium.solid.mesh.dim
        if found != dim:
            raise InputError(
                f"{self._where}: received '{name}' of dimension {found}, expected a {kind} of"
                f" dimension {dim}, that of the scene"
            )

    def _require_constraints(self, configuration):
        """Raise InputError where forces are mapped like stresses, or displacements like forces."""
        mesh = self._section.mesh
        for mapping in configuration.mappings:
            if mesh not in (mapping.source, mapping.target):
                continue
            of_forces = (mapping.source == mesh) == self._medium.tells_forces
            if mapping.keeps_sums == of_forces:
                continue
            what, wanted = (
                ("forces", "'conservative': they are those of nodes [N], not stresses [Pa]")
                if of_forces
                else ("displacements", "'consistent'")
            )
            raise InputError(
                f"{self._where}: received the constraint '{mapping.constraint}' in the mapping of"
                f" {what} from '{mapping.source}' to '{mapping.target}', expected {wanted}"
            )

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Tell what preCICE refuses as an InputError."""
        try:
            yield
        except RuntimeError as error:
            raise self._refused(error) from error

    def _refused(self, error):
        return InputError(f"{self._where}: preCICE says: {error}")


class _Vertices:
    """The nodes of the interface as vertices of a mesh of preCICE, which rank 0 provides: between
    them no rank cuts the facets that nearest-projection mapping needs, and each is there once.

    numbers : those of preCICE, (N,), of rank 0, none elsewhere
    """

    def __init__(self, link: Any, name: str, mesh: LocalMesh, tags: tuple[str, ...]) -> None:
        """Make the mesh of preCICE, with facets where a mapping asks for them (collective)."""
        facets, _ = surface_facets(mesh, tags)
        self._comm = mesh.comm
        self._nodes = SurfaceNodes(mesh, np.unique(facets))
        self.numbers = np.asarray(link.set_mesh_vertices(name, self.gather(mesh.X)))
        if link.requires_mesh_connectivity_for(name) and self._comm.rank == 0:
            pieces = split(np.searchsorted(self._nodes.natural, facets), mesh.element.facet)
            if mesh.dim == 2:
                link.set_mesh_edges(name, self.numbers[pieces])
            else:
                link.set_mesh_triangles(name, self.numbers[triangles_of(pieces)])

    def gather(self, field: np.ndarray) -> np.ndarray:
        """Return the values of a field, (n_owned, d) or longer, on the vertices, (N, d) on rank 0
        (collective).
        """
        values = self._nodes.gather(field)
        return values if self._comm.rank == 0 else values[:0]

    def scatter(self, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return owned nodes and their values of those of the vertices, (N, d) on rank 0
        (collective).
        """
        owned = self._nodes.owned
        return owned, self._comm.bcast(values)[self._nodes.rows[: len(owned)]]

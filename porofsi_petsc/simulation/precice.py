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
from ..phases.coupling_data import Rates

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
        self._vertices: Any = None

    def solving(self, solve: Callable[..., None]) -> Callable[[tuple[Scheme, Scheme], Rates], None]:
        """Return a function that solves a step together with the other program (collective).

        solve : (schemes, rates) -> None, which solves it alone
        """

        def together(schemes: tuple[Scheme, Scheme], rates: Rates) -> None:
            dt = schemes[0].dt
            with self._told():
                self._require_window(dt)
            agreed = False
            while not agreed:
                with self._told():
                    self._link.requires_writing_checkpoint()  # which the accepted state is
                    self._medium.take(self._read(dt))
                self._alone(solve, schemes, rates)
                with self._told():
                    self._write()
                    self._link.advance(dt)
                    agreed = not self._link.requires_reading_checkpoint()

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

    def _read(self, dt):
        section = self._section
        values = self._link.read_data(section.mesh, section.read, self._vertices, dt)
        return np.reshape(values, (len(self._medium.nodes), self._medium.solid.mesh.dim))

    def _write(self):
        section = self._section
        values = self._medium.answer()
        self._link.write_data(section.mesh, section.write, self._vertices, values)

    # -- the other program -------------------------------------------------------------------------

    def _connect(self):
        """Find the other program, with this one's nodes on the interface (collective)."""
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
        self._require_dimension(section.mesh, link.get_mesh_dimensions(section.mesh), "mesh")
        for data in (section.read, section.write):
            found = link.get_data_dimensions(section.mesh, data)
            self._require_dimension(data, found, "vector")
        self._vertices = link.set_mesh_vertices(section.mesh, mesh.X[self._medium.nodes])
        if link.requires_initial_data():
            nothing = np.zeros((len(self._medium.nodes), mesh.dim))
            link.write_data(section.mesh, section.write, self._vertices, nothing)
        link.initialize()
        self._link = link

    def _require_dimension(self, name, found, kind):
        """Raise InputError unless a mesh or data of preCICE has the dimension of the scene."""
        dim = self._medium.solid.mesh.dim
        if found != dim:
            raise InputError(
                f"{self._where}: received '{name}' of dimension {found}, expected a {kind} of"
                f" dimension {dim}, that of the scene"
            )

    @contextmanager
    def _told(self) -> Iterator[None]:
        """Tell what preCICE refuses as an InputError."""
        try:
            yield
        except RuntimeError as error:
            raise InputError(f"{self._where}: preCICE says: {error}") from error

"""One run from a scene to its results, and the check of a scene without a run."""

from contextlib import ExitStack, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mpi4py import MPI

from ..compiled import compilation_notice
from ..config import Scene, scene_to_toml
from ..errors import ExpectationError, InputError, Stopped
from ..linalg.agreement import Agreement
from ..linalg.stopwatch import Stopwatch
from ..log import logger, start_log, stop_log
from ..output.checkpoint import open_checkpoint
from ..output.directory import Claim, written_files
from ..output.expectations import evaluate, failed
from ..output.figures import make_curves, make_figures, save_figure
from ..output.files import on_root, write_text
from ..output.history import read_history
from ..output.mesh_plot import draw_mesh
from ..output.period import period_analysis
from ..output.profiles import write_profiles
from ..output.progress import Progress
from ..output.summary import read_summary, write_summary
from ..signals import Interrupted, answered_by, interrupt, note, noted
from .build import tagged_mesh
from .loop import StopRequest
from .preview import preview
from .records import Records
from .report import summarize
from .simulation import Simulation

# above, one rank does not read whole fields; `porofsi plot` still draws them
FIGURE_ELEMENTS = 2_000_000


def run(
    scene: Scene,
    directory: Path,
    restart: Path | None = None,
    force: bool = False,
    quiet: bool = False,
    max_time: float | None = None,
) -> dict[str, Any]:
    """Solve a scene and return its summary (the content of summary.json); PETSc has been started
    (collective).

    directory : results (pathlib.Path); restart : checkpoint file or None; max_time : wall time [s]
    or None. Raises a PorofsiError: InputError, ConvergenceError, Stopped or ExpectationError;
    whatever was accepted before is on disk.
    """
    with Agreement(MPI.COMM_WORLD).required():
        return _run(scene, directory, restart, force, quiet, max_time)


def _run(scene, directory, restart, force, quiet, max_time):
    comm = MPI.COMM_WORLD
    stopwatch = Stopwatch()
    notice = compilation_notice()
    start_log(None, comm.rank, quiet)
    try:
        with Claim(directory, force, restart, comm) as claim:
            header = open_checkpoint(restart, comm) if restart is not None else None
            with Simulation(scene, comm, stopwatch) as simulation:
                claim.put_aside()
                start_log(directory, comm.rank, quiet)
                for said in filter(
                    None, (notice, *_notes(simulation), *simulation.coupling.notices)
                ):
                    logger.info(said)
                return _Run(simulation, directory, quiet, claim).go(restart, header, max_time)
    finally:
        stop_log()


def _notes(simulation):
    return (f"mesh: {note}" for note in simulation.coupling.solid.mesh.notes)


class _Run:
    """The files and the words of one run, and their order."""

    def __init__(self, simulation, directory, quiet, claim):
        self.simulation = simulation
        self.scene = simulation.scene
        self.comm = simulation.comm
        self.directory = directory
        self.quiet = quiet
        self.claim = claim
        self._signals = ExitStack()
        self.former = None
        self._good = False
        self.records = Records(simulation, directory)

    def go(self, restart, header, max_time):
        """Run to the end and return the summary; it is written before an error that all ranks share
        ends the run.
        """
        text = scene_to_toml(self.scene)
        simulation = self.simulation
        self._start(restart, header)
        on_root(self.comm, write_text, self.directory / "scene.toml", text)
        stop = StopRequest(self.comm, max_time, f"restart from {self.records.checkpoint_path}")
        summary = None
        terminal = (
            None if self.comm.size == 1 else False
        )  # mpirun shows its ranks a terminal, also where it writes to a file
        progress = Progress(
            self.scene.end,
            self.quiet,
            terminal,
            start_time=simulation.time,
            rank=self.comm.rank,
        )
        try:
            self.records.progress = progress
            self._advance(
                [
                    self.records.after_step,
                    self._begin,
                    lambda simulation: stop(simulation.loop.clock, simulation.finished),
                ]
            )
            self._begin(simulation)  # also where a restart had nothing left to do
            summary = self._finish(progress, 0)
        except self.simulation.loop.shared_errors as error:
            if summary is None:
                self._finish(progress, error.exit_code)
            raise
        finally:
            progress.close()
            self._signals.close()
        self._judge(summary)
        return summary

    def _advance(self, callbacks):
        """Do the steps; an error that all ranks share leaves a checkpoint behind."""
        try:
            self.simulation.run(callbacks=callbacks)
        except self.simulation.loop.shared_errors:
            self.records.checkpoint()
            raise

    def _begin(self, simulation):
        """Take the run for a good one: earlier results may go, and a signal waits for the end of a
        step, to save it.
        """
        if not self._good:
            self._good = True
            self.claim.accept()
            self._signals.enter_context(answered_by(note))

    def _start(self, restart, header):
        simulation = self.simulation
        mesh = self.simulation.coupling.solid.mesh
        ranks = "1 rank" if self.comm.size == 1 else f"{self.comm.size} ranks"
        logger.info(
            "%s: %d elements, %d nodes, %s",
            self.scene.name,
            mesh.n_cells_global,
            mesh.n_global,
            ranks,
        )
        if restart is None:
            self.records.open()
            self.records.start()
            return
        simulation.resume(restart, header)
        self.records.open(resumed_at=simulation.time)
        logger.info(
            "continued from %s at t = %g s (step %d)", restart, simulation.time, simulation.steps
        )
        if simulation.finished:
            self._complete()

    def _complete(self):
        """Take over what a run has left that reached its end; its figures, verdict and summary are
        still to be made.
        """
        logger.info(
            "that is the end of the run: no step is left, its figures and its summary are made"
            " again"
        )
        self.records.complete()
        self.former = on_root(self.comm, self._read_former)

    def _read_former(self):
        """Return the summary of the run that did the steps, None where it was killed before it
        wrote one.
        """
        summary = read_summary(self.directory)
        clock = self.simulation.loop.clock
        ends = (0, ExpectationError.exit_code)
        same = (
            summary
            and (summary["steps"], summary["time_end"]) == (clock.step, clock.t)
            and summary["exit_code"] in ends
        )
        return summary if same else None

    def _finish(self, progress, exit_code):
        """Close the files, write figures and summary; return the summary (collective)."""
        progress.close()
        self.records.close()
        judgement = on_root(self.comm, self._judgement, exit_code == 0)
        if exit_code == 0 and failed(judgement["expectations"]):
            exit_code = ExpectationError.exit_code
        self._summarize(
            judgement, exit_code
        )  # a figure that cannot be drawn must not cost the numbers
        with self.simulation.stopwatch.measure("output"):
            on_root(self.comm, self._draw, exit_code == Stopped.exit_code)
        summary = self._summarize(judgement, exit_code)
        self._say(summary)
        return summary

    def _draw(self, stopped):
        """Draw the figures, or none where the end was asked for: who kills a run after a second
        shall not lose its summary.
        """
        large = self.simulation.coupling.solid.mesh.n_cells_global > FIGURE_ELEMENTS
        with suppress(Interrupted), answered_by(interrupt):
            if not stopped and not noted():
                (make_curves if large else make_figures)(self.directory)
                return
        logger.info("the figures are left out; porofsi plot %s draws them", self.directory)

    def _summarize(self, judgement, exit_code):
        folder = self.directory
        files = on_root(
            self.comm, lambda: [str(path.relative_to(folder)) for path in written_files(folder)]
        )
        summary = summarize(self.simulation, judgement, files, exit_code)
        if self.former:  # what the steps took is known there
            summary = self.former | judgement | {"files": files, "exit_code": exit_code}
        on_root(self.comm, write_summary, self.directory, summary)
        return summary

    def _judgement(self, complete):
        """Return the last full period of the history and the records of [[expect]]; write the
        profiles.
        """
        histories = [read_history(self.directory / "history.csv")]
        comparison = self.simulation.measures.comparison
        if comparison:
            histories.append(comparison.table())
        if comparison and comparison.records and comparison.records[0]["profile"]:
            write_profiles(self.directory, comparison.records)
        period = self._period(histories[0])
        expectations = evaluate(self.scene.expect, histories, complete, period)
        return {"period": asdict(period) if period else None, "expectations": expectations}

    def _period(self, history):
        of = self.scene.output.period_of
        return (
            period_analysis(history["t"], {name: history[name] for name in self.scene.columns}, of)
            if of
            else None
        )

    def _say(self, summary):
        iterations = summary["coupling_iterations"]
        energy = summary["energy"]
        logger.info(
            "t = %g s, %d steps, coupling iterations %.1f mean, %d largest, energy error %.1e of"
            " the largest work, %.1f s",
            summary["time_end"],
            summary["steps"],
            iterations["mean"],
            iterations["max"],
            energy["balance_error_relative"],
            summary["wall_time"]["total"],
        )
        for record in summary["errors"]:
            u = "".join(f"{name} {record[name]:.2g}, " for name in "uv" if record[name] is not None)
            logger.info(
                "error against the exact solution at %g s: %sp %.2g", record["t"], u, record["p"]
            )
        self._say_period(summary["period"])
        for record in summary["expectations"]:
            where = f"at {record['at']:g} s" if record["at"] is not None else record["statistic"]
            if record["passed"] is None:
                logger.info(
                    "expect %s %s: skipped, %s", record["quantity"], where, record["reason"]
                )
                continue
            logger.info(
                "expect %s %s: computed %.6g, reference %.6g, error %.2g (bound %.2g): %s",
                record["quantity"],
                where,
                record["value"],
                record["reference"],
                record["error"],
                record["tolerance"],
                "passed" if record["passed"] else "FAILED",
            )
        logger.info("results in %s", self.directory)

    def _say_period(self, period):
        of = self.scene.output.period_of
        if of is None:
            return
        if period is None:
            logger.info("%s has no full period", of)
            return
        change = (
            ""
            if period["change"] is None
            else f", its amplitude {period['change']:.2g} from the one before"
        )
        logger.info(
            "last period of %s: %.6g s to %.6g s%s", of, period["start"], period["end"], change
        )
        for name, signal in period["columns"].items():
            frequency = "steady" if signal["frequency"] is None else f"{signal['frequency']:.5g} Hz"
            logger.info(
                "%s: %.6g +- %.6g, %s", name, signal["mean"], signal["amplitude"], frequency
            )

    def _judge(self, summary):
        misses = failed(summary["expectations"])
        if misses:
            first = misses[0]
            count = f"{len(misses)} of {len(summary['expectations'])} expectations failed"
            raise ExpectationError(
                f"{count}, the first: {first['quantity']} computed {first['value']:.6g}, reference"
                f" {first['reference']:.6g}, error {first['error']:.2g} > {first['tolerance']:.2g}"
            )


def check(scene: Scene, figure: Path | None = None) -> str:
    """Return a description of what a scene would solve; raises InputError as a run would
    (collective).

    figure : where a picture of the mesh is written (PNG), None for none; before the boundary
    conditions are looked at, whose tags it shows
    """
    if figure is not None:
        on_root(MPI.COMM_WORLD, _draw, scene, figure)
    simulation = Simulation(scene)
    return preview(simulation.present, simulation.coupling, simulation.measures)


def _draw(scene, figure):
    if not figure.parent.is_dir():
        raise InputError(
            f"--figure {figure}: there is no folder '{figure.parent}'; make it, or give another one"
        )
    save_figure(figure, draw_mesh, tagged_mesh(scene))

"""Commands: start of MPI and PETSc, exit codes, and the end of the whole job when one rank fails.

Nothing heavy is imported before a command needs it, so that --help answers at once.
"""

import math
import sys
import traceback
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, NoReturn, TypeVar

import click

from . import __version__
from .errors import InputError, PorofsiError

T = TypeVar("T")


class Job:
    """The ranks of this run and their common end."""

    def __init__(self) -> None:
        try:
            from mpi4py import MPI
        except (ImportError, RuntimeError) as error:  # not installed; no library of MPI
            text = (
                "install it, load the modules it was built with, or name the folder of the library"
                " in LD_LIBRARY_PATH"
            )
            raise InputError(
                f"mpi4py cannot load MPI ({' '.join(str(error).split())}); {text}"
            ) from error
        from .linalg.agreement import Agreement

        self._agreement = Agreement(MPI.COMM_WORLD)
        self.comm = MPI.COMM_WORLD.Dup()
        if self.comm.size > 1:
            sys.excepthook = self.abort

    def abort(
        self, kind: type[BaseException], error: BaseException, trace: TracebackType | None
    ) -> None:
        """Print the traceback of this rank and end the job on all ranks; an excepthook."""
        lines = "".join(traceback.format_exception(kind, error, trace))
        _complain(f"rank {self.comm.rank} of {self.comm.size} failed:\n{lines}")
        self.comm.Abort(1)

    def agree(self, action: Callable[[], T]) -> T:
        """Return the action's value; raise the first rank's InputError on all ranks when it fails
        on any.
        """
        message = None
        try:
            value = action()
        except InputError as error:
            message = str(error)
        messages = [text for text in self.comm.allgather(message) if text]
        if messages:
            raise InputError(messages[0])
        return value

    def fail(self, error: PorofsiError) -> NoReturn:
        """End with the error's exit code; rank 0 speaks for all, a rank alone speaks for itself and
        ends the job.
        """
        together = self.comm.size == 1 or self._agreement.everyone_fails()
        if self.comm.rank == 0 or not together:
            _complain(f"error: {error}")
        if not together:
            self.comm.Abort(error.exit_code)
        sys.exit(error.exit_code)


class Commands(click.Group):
    """A group whose commands end with the exit code of the PorofsiError they raise."""

    def invoke(self, ctx: click.Context) -> Any:
        """Run the chosen command."""
        try:
            return super().invoke(ctx)
        except PorofsiError as error:
            if ctx.obj is not None:
                ctx.obj.fail(error)
            _complain(f"error: {error}")
            sys.exit(error.exit_code)


def _complain(text: str) -> None:
    """Print to standard error, where there is one."""
    with suppress(OSError):
        click.echo(text, err=True)


def _show(text: str) -> None:
    """Print what a command was asked for; a reader that has gone (| head) ends it quietly, by
    click.
    """
    try:
        click.echo(text)
    except BrokenPipeError:
        raise
    except OSError as failure:
        raise PorofsiError(
            f"standard output: could not be written ({failure.strerror})"
        ) from failure


def _tell(text: str) -> None:
    """Print a line of progress, which nothing depends on."""
    with suppress(OSError):
        click.echo(text)


def _join(context: click.Context) -> Job:
    """Start MPI and make the job known to the group."""
    context.find_root().obj = job = Job()
    return job


def _positive(
    context: click.Context, parameter: click.Parameter, value: float | None
) -> float | None:
    """Return a finite positive number, or None where none was given."""
    if value is not None and not 0 < value < math.inf:
        raise click.BadParameter(f"received '{value:g}', expected a positive number such as 1e-2")
    return value


overrides = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="KEY=VALUE",
    help="Change one entry, e.g. time.end=0.1.",
)
allow = click.option(
    "--allow-scene-options",
    is_flag=True,
    help="Let the scene's [petsc] options name files and code too.",
)
smoke = click.option(
    "--smoke", is_flag=True, help="Apply the scene's [smoke] changes: a short run."
)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, prog_name="porofsi")
def cli() -> None:
    """Saturated poroelastic dynamics by finite elements; run it under mpirun for more than one
    core.
    """


@cli.command()
@click.argument("scene")
@click.argument("petsc_options", nargs=-1, type=click.UNPROCESSED, metavar="[-- PETSC OPTIONS]")
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="Results, default results/SCENE.",
)
@overrides
@click.option(
    "--restart", type=click.Path(path_type=Path), metavar="FILE", help="Go on from a checkpoint."
)
@smoke
@click.option("--force", is_flag=True, help="Replace existing results.")
@click.option("--quiet", is_flag=True, help="No progress.")
@click.option(
    "--max-time",
    type=float,
    callback=_positive,
    metavar="SECONDS",
    help="Write a checkpoint and stop.",
)
@allow
@click.pass_context
def run(
    context: click.Context,
    scene: str,
    petsc_options: tuple[str, ...],
    output: Path | None,
    overrides: tuple[str, ...],
    smoke: bool,
    **choices: Any,
) -> None:
    """Solve SCENE (a file, or a name that `porofsi list` shows)."""
    from . import load_scene
    from . import run as run_scene

    if petsc_options and not petsc_options[0].startswith("-"):
        raise click.UsageError(
            f"unexpected argument '{petsc_options[0]}'; PETSc options follow after --"
        )
    job = _join(context)
    loaded = job.agree(lambda: load_scene(scene, overrides, smoke))
    run_scene(loaded, output, petsc_options=petsc_options, **choices)


@cli.command()
@click.argument("scene")
@overrides
@smoke
@click.option(
    "--figure",
    type=click.Path(path_type=Path, dir_okay=False),
    metavar="FILE",
    help="Draw the mesh with its tags and regions (PNG).",
)
@allow
@click.pass_context
def check(
    context: click.Context,
    scene: str,
    overrides: tuple[str, ...],
    smoke: bool,
    figure: Path | None,
    allow_scene_options: bool,
) -> None:
    """Validate SCENE and its mesh, and say what would be solved."""
    from . import load_scene

    job = _join(context)
    loaded = job.agree(lambda: load_scene(scene, overrides, smoke))
    from .linalg.options import start

    start(loaded.petsc.options, [], allow_scene_options)
    from .simulation import check as check_scene

    text = check_scene(loaded, figure)
    if job.comm.rank == 0:
        _show(text)


@cli.command(name="list")
def list_command() -> None:
    """Show the shipped scenes."""
    from . import list_scenes

    scenes = list_scenes()
    width = max((len(name) for name, _, _ in scenes), default=0)
    _show("\n".join(f"{name:<{width}}  {title}" for name, title, _ in scenes))


@cli.command()
@click.argument("cases", nargs=-1, metavar="[CASE]...")
@click.option("--quick", is_flag=True, help="Only the cases of a few seconds.")
@click.option(
    "--suite",
    type=click.Choice(["program", "cases"]),
    default="program",
    help="cases: the public problems of docs/cases.md.",
)
@click.option("--json", "as_text", is_flag=True, help="Print the checks as JSON.")
@click.option(
    "--output",
    type=click.Path(path_type=Path),
    default=Path("results/verify"),
    metavar="DIR",
    help="Results.",
)
@click.pass_context
def verify(
    context: click.Context,
    cases: tuple[str, ...],
    quick: bool,
    suite: str,
    as_text: bool,
    output: Path,
) -> None:
    """Compare with exact solutions.

    Runs the CASEs (default all) and prints computed, reference, error and bound.
    """
    job = _join(context)
    from .errors import ExpectationError
    from .output.check_table import checks_table
    from .simulation import verify as verify_cases
    from .simulation.verify import as_json

    checks = verify_cases(cases, output, quick, suite)
    if job.comm.rank == 0:
        _show(as_json(checks) if as_text else checks_table(checks))
    missed = [check for check in checks if not check.passed]
    if missed:
        first = f"{missed[0].case}, {missed[0].quantity}"
        raise ExpectationError(
            f"{len(missed)} of {len(checks)} checks failed, the first: {first}; results in {output}"
        )


@cli.command()
@click.argument("directory", type=click.Path(path_type=Path), metavar="DIR")
def plot(directory: Path) -> None:
    """Draw the figures of the results in DIR again."""
    from .output.figures import make_figures

    _show("\n".join(map(str, make_figures(directory))))


@cli.command()
@click.argument("file", type=click.Path(path_type=Path))
def info(file: Path) -> None:
    """Describe a checkpoint, a summary, a mesh or a result directory."""
    from .output.info import describe

    _show(describe(file))


@cli.group()
def study() -> None:
    """Many short runs and their tables.

    A study goes on where it was stopped.
    """


def study_options(name: str) -> Callable[[Callable], click.Command]:
    """Return the decorator with the options of a study: where it writes, a sample of it, all of it
    anew.
    """
    directory = click.Path(path_type=Path, file_okay=False)
    options: list[Callable] = [
        click.option(
            "--output",
            type=directory,
            default=Path("results/studies"),
            metavar="DIR",
            help="Default results/studies.",
        ),
        click.option("--quick", is_flag=True, help="A sample of it, in seconds."),
        click.option("--force", is_flag=True, help="All cases anew, also those in DIR."),
        click.pass_context,
    ]

    def decorate(command: Callable) -> click.Command:
        for option in reversed(options):
            command = option(command)
        return study.command(name=name)(command)

    return decorate


def _alone(context: click.Context) -> None:
    """Start MPI and refuse more than one rank."""
    if _join(context).comm.size > 1:
        raise InputError(
            "a study runs on one rank, which its wall times are about: start it without mpirun"
        )


@study_options("coupling")
def study_coupling(context: click.Context, output: Path, quick: bool, force: bool) -> None:
    """Iterations over permeability, step and mesh.

    Also over order, strain and accelerator: 40 minutes on one core.
    """
    _alone(context)
    from .studies.coupling import study as make

    make(output, quick, force, _tell)


@study_options("stability")
def study_stability(context: click.Context, output: Path, quick: bool, force: bool) -> None:
    """Hard cases and what must be refused.

    The ends of the parameter range, bad meshes, 20 000 steps: 25 minutes on one core.
    """
    _alone(context)
    from .studies.stability import study as make

    make(output, quick, force, _tell)


def _factors(context: click.Context, parameter: click.Parameter, text: str) -> tuple[float, ...]:
    """Return the positive numbers of a comma-separated list."""
    try:
        found = tuple(float(word) for word in text.split(","))
    except ValueError:
        found = (0.0,)
    if not all(0 < factor < math.inf for factor in found):
        raise click.BadParameter(f"received '{text}', expected positive numbers such as 0.5,1,2")
    return found


@study_options("work-precision")
@click.argument("scene")
@overrides
@click.option(
    "--error", type=float, default=1e-2, callback=_positive, help="The wanted one, default 1e-2."
)
@click.option(
    "--cells",
    default="0.5,1,2",
    callback=_factors,
    metavar="LIST",
    help="Factors on the cells, default 0.5,1,2.",
)
@click.option(
    "--steps",
    default="2,1,0.5",
    callback=_factors,
    metavar="LIST",
    help="Factors on the step, default 2,1,0.5.",
)
def study_work_precision(
    context: click.Context,
    scene: str,
    overrides: tuple[str, ...],
    error: float,
    cells: tuple[float, ...],
    steps: tuple[float, ...],
    output: Path,
    quick: bool,
    force: bool,
) -> None:
    """Error of SCENE against wall time.

    Over order, mesh, step, tolerance, scheme and accelerator: 40 runs of it.
    """
    _alone(context)
    from .studies.work_precision import study as make

    make(
        scene,
        output,
        overrides,
        error,
        *((cells[:1], steps[:1]) if quick else (cells, steps)),
        force,
        _tell,
    )

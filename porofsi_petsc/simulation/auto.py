"""Terms of the model that are "auto": left out until the size of what is left out passes its bound,
then solved to the end.

A step in which a bound is passed is not accepted but done again with the term, from the state
before it.  Up to there the term was below its bound, so that state is as good for the larger model
as for the smaller: positions, velocities and pressure go over, accelerations of a phase that had no
inertia are zero.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any

from ..config import Scene
from ..config.sections import Model
from ..coupling.medium import Medium
from ..log import logger

if TYPE_CHECKING:
    from .loop import Clock
    from .measures import Omission

OFF, ON = {"porosity": "constant"}, {"porosity": "variable"}  # of the other terms: false and true


def auto_terms(model: Model) -> list[str]:
    """Return the names of the terms that are "auto" in a [model]."""
    return [name for name in type(model).model_fields if getattr(model, name) == "auto"]


def with_model(scene: Scene, **terms: bool | str) -> Scene:
    """Return the scene with other terms in its [model]."""
    return scene.model_copy(update={"model": scene.model.model_copy(update=terms)})


def at_start(scene: Scene) -> Scene:
    """Return the scene in which every "auto" term is left out."""
    return with_model(scene, **{name: OFF.get(name, False) for name in auto_terms(scene.model)})


class AutoMedium:
    """The medium of a scene with "auto" terms; what it does not do itself the medium of the terms
    modelled so far does.

    scene : with the present model; switched : one record per term that was switched on, as in
    `summary.json`
    """

    def __init__(
        self, scene: Scene, build: Callable[[Scene], Medium], start: Callable[[Medium, Scene], None]
    ) -> None:
        """Start without the auto terms (collective).

        build : scene without "auto" -> medium at rest; start : (medium, scene) gives it the initial
        state, or refuses it
        """
        self._build = build
        self._start = start
        self._waiting = auto_terms(scene.model)
        self.switched: list[dict[str, Any]] = []
        self.scene = at_start(scene)
        self._medium = build(self.scene)
        start(self._medium, self.scene)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._medium, name)

    def switch(self, omissions: Iterable[Omission], sizes: dict[str, float], clock: Clock) -> bool:
        """Switch on every auto term whose size in the present trial step passes its bound; return
        whether one did (collective).

        omissions : of `Measures`; sizes : name -> size.  The trial step is forgotten, the accepted
        state stays.
        """
        passed = {
            o.term: o
            for o in omissions
            if o.term in self._waiting and o.bound is not None and sizes[o.name] > o.bound
        }
        if not passed:
            return False
        state = self._medium.state()
        memory = self._medium.memory()
        self._switch_on(
            [_record(term, passed, sizes, clock) for term in self._with_what_they_need(passed)]
        )
        if clock.step == 0:
            self._start(self._medium, self.scene)  # with inertia not every start will do
        schemes, rates = clock.schemes(self.scene.model, clock.nominal)
        self._medium.load_state(state, without_tangents(memory), schemes, rates)
        return True

    def _with_what_they_need(self, passed):
        """Return the terms to switch on, with the moving mesh, which alone lets n_s = n_s0/J follow
        the volume ratio.
        """
        needed = {"moving_mesh"} if "porosity" in passed else set()
        return [name for name in self._waiting if name in needed | passed.keys()]

    def _switch_on(self, records):
        """Make a new medium with the terms of the records."""
        terms = [record["term"] for record in records]
        self.scene = with_model(self.scene, **{name: ON.get(name, True) for name in terms})
        self._waiting = [name for name in self._waiting if name not in terms]
        self.switched += records
        for block in self._medium.blocks.values():
            if block.solver:
                block.solver.destroy()
        self._medium = self._build(self.scene)

    def memory(self) -> dict[str, Any]:
        """Return the numbers a restart needs beside the arrays."""
        return self._medium.memory() | {"switched": self.switched}

    def resume(self, memory: dict[str, Any]) -> None:
        """Switch on what had been switched on when a checkpoint was written; its state is still to
        be loaded (collective).
        """
        records = [record for record in memory["switched"] if record["term"] in self._waiting]
        if records:
            self._switch_on(records)


AnyMedium = Medium | AutoMedium


def _record(term, passed, sizes, clock):
    """Return the record of a term that passed its bound, or that another one needs, and log it."""
    cause = passed.get(term) or passed["porosity"]
    size = sizes[cause.name]
    where = f"t = {clock.t:g} s (step {clock.step + 1})"
    logger.info(
        "model.%s switched on at %s: %s %.3g > %g", term, where, cause.name, size, cause.bound
    )
    return {
        "term": term,
        "step": clock.step + 1,
        "t": clock.t,
        "measure": cause.name,
        "size": size,
        "bound": cause.bound,
    }


def without_tangents(memory: dict[str, Any]) -> dict[str, Any]:
    """Return the memory of a medium without lagged tangents and accelerator, which belong to the
    model before.
    """
    names = [name for name in ("solid", "fluid", "mesh") if name in memory]
    phases = {name: memory[name] | {"rates": None} for name in names}
    return memory | phases | {"columns": []}

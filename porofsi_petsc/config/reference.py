"""Section [reference]: the exact solution that a scene is compared with."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from ..errors import digits, shown
from .types import ListOf, Number, Positive, Table, wrong

FLOWS = (
    "kovasznay",
    "taylor_green",
    "ethier_steinman",
    "womersley_channel",
    "womersley_pipe",
)  # of a free fluid; the others are of a porous medium
Solution = Literal[
    "column_step",
    "column_harmonic",
    "terzaghi",
    "mandel",
    "unconfined",
    "strip_footing",
    "cryer",
    "seabed",
    "xie_leo",
    "selfweight",
    "drained",
    "kovasznay",
    "taylor_green",
    "ethier_steinman",
    "womersley_channel",
    "womersley_pipe",
]
HARMONIC = ("column_harmonic", "seabed", "womersley_channel", "womersley_pipe")
UNLOADED = ("selfweight", "unconfined", *FLOWS)


class Reference(Table):
    """The solution, its load [Pa] and length [m]; all else comes from the scene's one material.

    frequency : ω [rad/s] of HARMONIC solutions; strain : ε of unconfined; speed : U [m/s] of FLOWS;
    surface : height of the drained surface [m] (absent: length);
    times : when the errors are taken [s], beside the end.
    """

    solution: Solution
    load: Positive | None = None
    length: Positive
    frequency: Positive | None = None
    strain: Positive | None = None
    speed: Positive | None = None
    surface: Number | None = None
    times: Annotated[tuple[Annotated[Number, Field(gt=0)], ...], ListOf()] = ()

    @model_validator(mode="after")
    def _complete(self) -> "Reference":
        self._check("load", self.solution not in UNLOADED)
        self._check("frequency", self.solution in HARMONIC)
        self._check("strain", self.solution == "unconfined")
        self._check("speed", self.solution in FLOWS)
        if list(self.times) != sorted(set(self.times)):
            raise wrong(f"received {shown(list(self.times))}, expected increasing numbers", "times")
        return self

    def _check(self, key: str, needed: bool) -> None:
        value = getattr(self, key)
        if needed and value is None:
            raise wrong(
                f"received nothing, expected a positive number, which '{self.solution}' needs", key
            )
        if value is not None and not needed:
            raise wrong(
                f"received {digits(value)}, expected nothing: '{self.solution}' has none", key
            )

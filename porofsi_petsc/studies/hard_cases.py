"""The hard cases of the stability study: scenes at the ends of the parameter range, and what is
wanted of each.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import pi
from pathlib import Path
from typing import Any

import numpy as np

from ..config import Scene, load_scene
from ..mesh.write import write_mesh
from ..simulation.auto import AnyMedium
from ..simulation.build import serial_mesh
from ..simulation.energy import Energy
from ..simulation.loop import Clock
from . import soil
from .distortion import distort
from .soil import Tables
from .trial import Watch

CELLS, STEP, STEPS, K = 16, 1e-3, 50, 1e-2  # of a block, [s], number of steps, k_f [m/s]
LIMIT_K = 1e-5  # [m/s], permeability of the cases about the smallest step
SMALLEST_ANGLE = 5.0  # [degrees]
LONG = 20_000  # steps
OWN = {"accelerator": "aitken", "on_failure": "stop"}  # [coupling]: nothing helps a case but itself
# of energy and displacement: the tolerance 1e-6 of a step, 1000 times over 20 000 steps
GROWTH_BOUND = 1e-3
DRIFT_BOUND = 1e-3

Maker = Callable[[Path], Scene]  # of a scene, whose files go into a folder


@dataclass(frozen=True)
class HardCase:
    """A scene, made in a scratch folder, and what is wanted: "finished", "cut" (finished, with
    cuts) or "refused" (a message).

    watch : makes an object with `begin` (a watcher of `trial.attempt`), `note` and `fine`
    """

    group: str
    name: str
    scene: Maker
    wanted: str = "finished"
    watch: Callable | None = None

    @property
    def keys(self) -> dict[str, str]:
        """Return what names the case in a table."""
        return {"group": self.group, "case": self.name}

    @property
    def label(self) -> str:
        """Return a few words for the progress."""
        return f"{self.group}: {self.name}"


class Endurance:
    """Growth of the stored energy and drift of the displacement: the last quarter of a run against
    its second one.
    """

    def begin(self, coupling: AnyMedium) -> Watch:
        """Return the function that looks at a step."""
        self._energy: list[float] = []
        self._u: list[float] = []
        return self._look

    def _look(self, clock: Clock, coupling: AnyMedium, energy: Energy) -> None:
        self._energy.append(energy.kinetic + energy.elastic)
        self._u.append(float(coupling.solid.u[: coupling.solid.mesh.n_owned, -1].mean()))

    @property
    def growth(self) -> float:
        """Return the largest energy of the last quarter over that of the second, minus 1."""
        second, last = self._quarters(self._energy)
        return float(last.max() / second.max() - 1)

    @property
    def drift(self) -> float:
        """Return the change of the mean vertical displacement over its largest magnitude.

        Hann's window makes the mean in time blind to vibrations, whose periods do not fill a
        quarter.
        """
        second, last = (
            np.average(quarter, weights=np.hanning(len(quarter)))
            for quarter in self._quarters(self._u)
        )
        return float(abs(last - second) / np.abs(self._u).max())

    @staticmethod
    def _quarters(values: list[float]) -> tuple[np.ndarray, np.ndarray]:
        quarters = np.array_split(np.array(values), 4)
        return quarters[1], quarters[3]

    @property
    def fine(self) -> bool:
        """Return whether nothing grew and nothing drifted."""
        return self.growth < GROWTH_BOUND and self.drift < DRIFT_BOUND

    @property
    def note(self) -> str:
        """Return both as text."""
        return f"energy {self.growth:+.1e}, drift {self.drift:.1e}"


def block(
    *,
    k: float = K,
    dt: float = STEP,
    steps: int = STEPS,
    load: str | None = None,
    dynamic: bool = True,
    finite: bool = False,
    materials: list[Tables] | None = None,
    mesh: Tables | None = None,
    boundary: Callable[[str], list[Tables]] | None = None,
    **more: Any,
) -> Maker:
    """Return the function that makes the scene of a block under a load on half of its top.

    The load is sudden at small strain; at finite strain it grows linearly to 20 % drained confined
    compression.
    more : rho_inf and sections of the scene
    """
    end = steps * dt
    law = "neo_hookean" if finite else "linear_elastic"
    load = load or (
        f"{soil.confined_load(law, 1 - soil.COMPRESSION)!r}*t/{end!r}"
        if finite
        else f"{soil.SMALL_LOAD!r}"
    )
    time = {"end": end, "step": dt} | (
        {"rho_inf": more.pop("rho_inf", 0.3)} if dynamic else {"scheme": "backward_euler"}
    )
    materials = materials or [soil.material(k, law)]
    mesh = mesh or soil.mesh(CELLS)
    conditions = (boundary or soil.boundary)(load)
    more["coupling"] = OWN | more.get("coupling", {})
    return lambda folder: soil.scene(
        "hard case", mesh, soil.model(dynamic, finite), time, materials, conditions, **more
    )


def compressed(law: str, load: float, n_s0: float, **more: Any) -> Maker:
    """Return the maker of a column that is slowly compressed by a pressure [Pa] on its drained top,
    which rises for 20 s.
    """
    materials = [soil.material(K, law, porosity=1 - n_s0)]
    ramp = f"{load!r}*minimum(t/20, 1)"
    common: dict[str, Any] = {
        "dt": 1.0,
        "steps": 40,
        "dynamic": False,
        "finite": True,
        "boundary": soil.covered,
        "mesh": soil.column(CELLS),
    }
    return block(load=ramp, materials=materials, **common, **more)


def distorted(**more: Any) -> Maker:
    """Return the maker of a block on a mesh file with angles of 5 degrees."""

    def make(folder):
        path = folder / "distorted.msh"
        write_mesh(path, distort(serial_mesh(block()(folder)), SMALLEST_ANGLE))
        return block(mesh={"kind": "file", "path": str(path), "dim": 2}, **more)(folder)

    return make


def stretched(**more: Any) -> Maker:
    """Return the maker of a block with cells of aspect 100 at its drained top."""
    height = {"points": [0.0, soil.SIZE], "cells": [40], "ratios": [0.0145]}
    mesh = soil.mesh(4) | {"y": height}
    return block(mesh=mesh, **more)


def layered(*permeabilities: float, **more: Any) -> Maker:
    """Return the maker of a block of layers, their permeabilities from below."""
    regions = soil.layers(len(permeabilities))
    materials = [
        soil.material(k, region=region["name"])
        for k, region in zip(permeabilities, regions, strict=True)
    ]
    return block(mesh=soil.mesh(CELLS, regions=regions), materials=materials, **more)


def limit_step(cells: int = CELLS) -> float:
    """Return h²/(4 c_v) [s], under which a drained boundary oscillates on equal order without
    stabilization (θ = 1).
    """
    diffusivity = LIMIT_K * (soil.LAME["lambda"] + 2 * soil.LAME["mu"]) / 1e4
    return (soil.SIZE / cells) ** 2 / (4 * diffusivity)


def footing(load: str) -> list[Tables]:
    """Return an impermeable footing on half of the top, the other half drained."""
    return [
        *soil.walls(),
        {"on": "top", "pressure": 0.0},
        {"on": "load", "traction": {"y": f"-({load})"}},
    ]


def free_sides(load: str) -> list[Tables]:
    """Return free impermeable sides, a fixed impermeable base, and a drained top that is loaded on
    one half.
    """
    base = {"on": "bottom", "displacement": {"x": 0.0, "y": 0.0}, "velocity": {"y": 0.0}}
    return [base, {"on": ["left", "right"]}, *soil.boundary(load)[-2:]]


def nearly_incompressible(nu: float = 0.4999) -> dict[str, float]:
    """Return Lamé parameters with the soil's shear modulus and this Poisson's ratio."""
    mu = soil.LAME["mu"]
    return {"lambda": 2 * mu * nu / (1 - 2 * nu), "mu": mu}


def shipped(name: str, *overrides: str) -> Maker:
    """Return the maker of a shipped scene with changes; it is not judged by its own
    expectations.
    """
    own = [f"coupling.{key}={value}" for key, value in OWN.items()]
    return lambda folder: load_scene(name, ("expect=[]", *own, *overrides))


def free_vibration(steps: int) -> Maker:
    """Return the maker of a column that swings after a half sine, nearly without dissipation: k_f =
    1e3 m/s, ρ∞ = 1.
    """
    load = f"{soil.SMALL_LOAD!r}*where(t < 0.05, sin({20 * pi!r}*t), 0)"
    return block(
        k=1e3, steps=steps, load=load, rho_inf=1.0, mesh=soil.column(8), boundary=soil.covered
    )


def forced_vibration(steps: int) -> Maker:
    """Return the maker of a column at finite strain under a harmonic load, 20 steps to the
    period.
    """
    load = f"5e5*(1 - cos({20 * pi!r}*t))"
    return block(
        dt=5e-3, steps=steps, load=load, finite=True, mesh=soil.column(8), boundary=soil.covered
    )


SHORT = ("time.end=0.1", "reference.times=[0.1]")
CUT: dict[str, Any] = {"coupling": {"on_failure": "cut_step", "max_iterations": 15}}
# The law of Saint Venant and Kirchhoff carries most at J = 3^(-1/2).
MOST = soil.confined_load("saint_venant_kirchhoff", 3**-0.5)  # [Pa]
HALF = soil.confined_load("neo_hookean", 0.5, 0.3)  # [Pa]
TOO_MUCH = soil.confined_load("neo_hookean", 0.6)  # [Pa], J = 0.6 at n_s0 = 0.67
COMPACTED, COMPACTED_CUT = (compressed("neo_hookean", TOO_MUCH, 0.67, **more) for more in ({}, CUT))
NEARLY_COMPACTED = compressed("ehlers_eipper", soil.confined_load("ehlers_eipper", 0.68), 0.67)
TOO_MUCH_FOR_LAW = compressed("saint_venant_kirchhoff", 1.2 * MOST, 0.3, **CUT)
SOFT = [soil.material(K, "neo_hookean", porosity=0.7)]
STIFF_IN_VOLUME = nearly_incompressible()

CASES = (
    HardCase("permeability", "k_f = 1e-12", block(k=1e-12)),
    HardCase("permeability", "k_f = 1e-12, P2", block(k=1e-12, mesh=soil.mesh(CELLS, 2))),
    HardCase("permeability", "k_f = 1e-12, quasi-static", block(k=1e-12, dt=1.0, dynamic=False)),
    HardCase("permeability", "k_f = 1e-12, large strain", block(k=1e-12, finite=True)),
    HardCase(
        "permeability",
        "pulse2d at k_f = 1e-12",
        shipped("pulse2d_low_permeability", "material.0.permeability.k=1e-12", "time.end=0.03"),
    ),
    HardCase(
        "step", "Δt = 1e-3 h²/(4 c_v)", block(k=LIMIT_K, dt=1e-3 * limit_step(), dynamic=False)
    ),
    HardCase(
        "step",
        "Δt = 1e-3 h²/(4 c_v), P2",
        block(k=LIMIT_K, dt=1e-3 * limit_step(), dynamic=False, mesh=soil.mesh(CELLS, 2)),
    ),
    HardCase("step", "Δt = 1e3 h²/(4 c_v)", block(k=LIMIT_K, dt=1e3 * limit_step(), dynamic=False)),
    *(HardCase("time scheme", f"ρ∞ = {rho:g}", block(rho_inf=rho)) for rho in (0.0, 0.5, 1.0)),
    *(
        HardCase("time scheme", f"ρ∞ = {rho:g}, large strain", block(rho_inf=rho, finite=True))
        for rho in (0.0, 1.0)
    ),
    HardCase(
        "skeleton",
        "ν = 0.4999, undrained start",
        block(k=LIMIT_K, dynamic=False, materials=[soil.material(LIMIT_K, lame=STIFF_IN_VOLUME)]),
    ),
    HardCase(
        "skeleton", "ν = 0.4999, dynamic", block(materials=[soil.material(K, lame=STIFF_IN_VOLUME)])
    ),
    HardCase("layers", "k_f = 1e-2 | 1e-8", layered(1e-2, 1e-8, 1e-2, 1e-8)),
    HardCase("layers", "k_f = 1e-8 | 1e-2", layered(1e-8, 1e-2, 1e-8, 1e-2)),
    HardCase(
        "layers",
        "k_f = 1e-2 | 1e-8, quasi-static",
        layered(1e-2, 1e-8, 1e-2, 1e-8, dt=1.0, dynamic=False),
    ),
    *(
        HardCase("porosity", f"n_f = {n:g}", block(materials=[soil.material(K, porosity=n)]))
        for n in (0.01, 0.99)
    ),
    HardCase(
        "porosity",
        "n_f = 0.99, large strain",
        block(finite=True, materials=[soil.material(K, "neo_hookean", porosity=0.99)]),
    ),
    HardCase("compression", "to J = 0.5 at n_s0 = 0.3", compressed("neo_hookean", HALF, 0.3)),
    HardCase("compression", "beyond the compaction point", COMPACTED, "refused"),
    HardCase("compression", "beyond the compaction point, steps cut", COMPACTED_CUT, "refused"),
    HardCase(
        "compression", "towards the compaction point, J = 0.68 at n_s0 = 0.67", NEARLY_COMPACTED
    ),
    HardCase("compression", "1.2 times what the law carries", TOO_MUCH_FOR_LAW, "refused"),
    HardCase("boundaries", "impermeable footing", block(boundary=footing)),
    HardCase("boundaries", "impermeable footing, k_f = 1e-9", block(k=1e-9, boundary=footing)),
    HardCase(
        "boundaries",
        "impermeable footing, quasi-static",
        block(dt=0.1, dynamic=False, boundary=footing),
    ),
    HardCase("boundaries", "free impermeable sides", block(boundary=free_sides)),
    HardCase(
        "boundaries", "free impermeable sides, k_f = 1e-9", block(k=1e-9, boundary=free_sides)
    ),
    HardCase(
        "boundaries",
        "free impermeable sides, quasi-static",
        block(dt=0.1, dynamic=False, boundary=free_sides),
    ),
    HardCase("mesh", "angles of 5°", distorted()),
    HardCase("mesh", "angles of 5°, k_f = 1e-9", distorted(k=1e-9)),
    HardCase("mesh", "angles of 5°, large strain", distorted(finite=True)),
    HardCase("mesh", "aspect 100", stretched()),
    HardCase("mesh", "aspect 100, k_f = 1e-9", stretched(k=1e-9)),
    HardCase("mesh", "aspect 100, large strain", stretched(finite=True)),
    HardCase("mesh", "aspect 100, quasi-static", stretched(k=LIMIT_K, dt=1e-2, dynamic=False)),
    HardCase(
        "mesh", "aspect 100, k_f = 1e-12, quasi-static", stretched(k=1e-12, dt=1e-2, dynamic=False)
    ),
    HardCase(
        "mesh",
        "terzaghi, 6 cells P1",
        shipped("terzaghi", "mesh.order=1", "mesh.y.cells=[6]", *SHORT),
    ),
    HardCase(
        "Newton",
        "a sudden load in one step",
        block(dt=1e-2, steps=1, load=f"{HALF!r}", finite=True, materials=SOFT, **CUT),
        "cut",
    ),
    *(
        HardCase(
            "density",
            f"ρ_sR/ρ_fR = {ratio:g}, {text}",
            block(k=k, materials=[soil.material(k, grains=1000.0 * ratio)]),
        )
        for ratio in (0.1, 10.0)
        for k, text in ((K, "k_f = 1e-2"), (1e-9, "k_f = 1e-9"))
    ),
    HardCase("long", "20 000 steps, free vibration, ρ∞ = 1", free_vibration(LONG), watch=Endurance),
    HardCase(
        "long",
        "20 000 steps, forced vibration, large strain",
        forced_vibration(LONG),
        watch=Endurance,
    ),
)
QUICK = tuple(
    case for case in CASES if case.name in ("Δt = 1e3 h²/(4 c_v)", "beyond the compaction point")
)

"""Microseconds for stress and tangent of a point: compiled, and from the energy."""

import time
from dataclasses import dataclass

import command_line
import numpy as np

from porofsi_petsc.materials import ELASTIC, FromEnergy

POINTS = 4000
REPEATS = 5  # the least of them counts


@dataclass(frozen=True)
class OfEnergy(FromEnergy):
    """The energy of `mooney_rivlin`, share 0.3, alone."""

    def energy(self, H: np.ndarray) -> np.ndarray:
        """Return it, (...)."""
        return ELASTIC["mooney_rivlin"](self.lam, self.mu, share=0.3).energy(H)


LAWS = {
    "neo_hookean, compiled": ELASTIC["neo_hookean"](1.7, 0.8),
    "mooney_rivlin, compiled": ELASTIC["mooney_rivlin"](1.7, 0.8, share=0.3),
    "holmes_mow, compiled": ELASTIC["holmes_mow"](1.5, 0.8, stiffening=0.5),
    "ogden, compiled": ELASTIC["ogden"](1.7, 0.8, exponents=(3.0, -2.0), shares=(0.7, 0.3)),
    "the same from its energy": OfEnergy(1.7, 0.8),
}


def microseconds(function, H):
    """Return the least time of a point [us]."""
    function(H)
    taken = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        function(H)
        taken.append(time.perf_counter() - start)
    return min(taken) / len(H) * 1e6


if __name__ == "__main__":
    command_line.parser("bench laws", __doc__).parse_args()
    for d in (2, 3):
        H = 0.05 * np.random.default_rng(0).standard_normal((POINTS, 1, d, d))
        for name, law in LAWS.items():
            times = microseconds(law.stress, H), microseconds(law.tangent, H)
            print(f"{d}-D {name:26} stress {times[0]:8.3f}  tangent {times[1]:8.3f}")

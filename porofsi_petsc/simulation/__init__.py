"""Composition root: scene -> phases -> coupling -> time loop; the one place that knows
everybody.
"""

from .run import check, run
from .verify import verify

__all__ = ["check", "run", "verify"]

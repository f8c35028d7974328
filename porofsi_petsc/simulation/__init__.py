"""Composition root: scene -> phases -> coupling -> time loop; the one place that knows everybody."""

from .run import check, run

__all__ = ["check", "run"]

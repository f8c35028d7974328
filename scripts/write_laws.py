#!/usr/bin/env python3
"""Write docs/laws.md from the registered laws."""

from pathlib import Path

from porofsi_petsc.materials import ELASTIC, PERMEABILITY
from porofsi_petsc.materials.document import laws_document

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "laws.md"

if __name__ == "__main__":
    DOCUMENT.write_text(laws_document(ELASTIC, PERMEABILITY), encoding="utf-8")

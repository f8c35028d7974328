"""Write docs/laws.md and docs/surface_conditions.md from what is registered."""

from pathlib import Path

import command_line

from porofsi_petsc.conditions import CONDITIONS
from porofsi_petsc.document import conditions_document, laws_document
from porofsi_petsc.materials import ELASTIC, PERMEABILITY

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGES = {
    "laws.md": laws_document(ELASTIC, PERMEABILITY),
    "surface_conditions.md": conditions_document(CONDITIONS),
}

if __name__ == "__main__":
    command_line.parser("docs registered", __doc__).parse_args()
    for name, text in PAGES.items():
        (DOCS / name).write_text(text, encoding="utf-8")

"""docs/scene.md lists every key of a scene with its type and default, and no other."""

import re
import types
import typing
from pathlib import Path

import pytest
from pydantic import BaseModel

from porofsi_petsc.conditions import CONDITIONS
from porofsi_petsc.config import (
    conditions,
    geometry,
    load_scene,
    material,
    orientation,
    precice,
    reference,
    schema,
    sections,
    stages,
)
from porofsi_petsc.config.fields import OR_FORMULA
from porofsi_petsc.config.types import (
    Coefficient,
    Formula,
    Limit,
    OneOf,
    Scaling,
    Switch,
    Tags,
    Vector,
)
from porofsi_petsc.document import conditions_document, laws_document
from porofsi_petsc.materials import ELASTIC, PERMEABILITY

DOCUMENT = Path(__file__).resolve().parents[1] / "docs" / "scene.md"
TABLES = {
    "Top level": schema.Scene,
    '[mesh] kind = "rectangle"': geometry.Rectangle,
    '[mesh] kind = "box"': geometry.Box,
    '[mesh] kind = "file"': geometry.MeshFile,
    "mesh.x, mesh.y, mesh.z": geometry.Axis,
    "mesh.patches": geometry.Patch,
    "mesh.regions": geometry.Region,
    "mesh.tag": geometry.TagOf,
    "[precice]": precice.Precice,
    "[model]": sections.Model,
    "[limits]": sections.Limits,
    "[time]": sections.Time,
    "[[material]]": material.Material,
    "material.solid": material.Solid,
    "material.solid.prony": material.MaxwellBranch,
    "material.solid.orientation": orientation.Orientation,
    "material.fluid": material.Fluid,
    "material.permeability": material.Permeability,
    "[[boundary]]": conditions.Boundary,
    "boundary.inflow": conditions.Inflow,
    "[body_force]": conditions.BodyForce,
    "[[body_force]]": conditions.RegionalForce,
    "[[load]]": sections.Load,
    "[initial]": conditions.Initial,
    "initial.stress": conditions.InitialStress,
    "Vectors": Vector,
    "[stabilization]": sections.Stabilization,
    "[coupling]": sections.Coupling,
    "[mesh_motion]": sections.MeshMotion,
    "[petsc]": sections.Petsc,
    "[[probe]]": sections.Probe,
    "[[line]]": sections.Line,
    "[[force]]": sections.Force,
    "[[surface]]": sections.Surface,
    "[[interface]]": sections.Interface,
    "[[tie]]": conditions.Tie,
    "[output]": sections.Output,
    "[figures]": sections.Figures,
    "[reference]": reference.Reference,
    "[[stage]]": stages.Stage,
    "[[expect]]": sections.Expect,
}
SPECIAL = {
    Formula: "formula",
    Limit: 'positive number or "report"',
    Coefficient: 'positive number or "auto"',
    Scaling: 'positive number or "optimal"',
    Switch: 'true, false or "auto"',
    Tags: "text or list",
    conditions.VerticalStress: 'formula or "weight"',
}
TEXTS = {"title", "community", "source", "description"}
PLAIN = {float: "number", int: "integer", str: "text", bool: "true or false"}


def kind_of(annotation):
    """Return the words for a type annotation."""
    if annotation in SPECIAL:
        return SPECIAL[annotation]
    if annotation in PLAIN:
        return PLAIN[annotation]
    origin = typing.get_origin(annotation)
    arguments = typing.get_args(annotation)
    if origin is typing.Annotated:
        chosen = [entry for entry in annotation.__metadata__ if isinstance(entry, OneOf)]
        if chosen:
            return ", ".join(f'"{name}"' for name in chosen[0].names)
        if OR_FORMULA in annotation.__metadata__:
            return "number or field"
        return kind_of(arguments[0])
    if origin is typing.Literal:
        return ", ".join(f'"{a}"' if isinstance(a, str) else str(a) for a in arguments)
    if origin in (typing.Union, types.UnionType):
        return kind_of(next(a for a in arguments if a is not type(None)))
    if origin is tuple:
        return (
            "[from, to]"
            if len(arguments) == 2 and arguments[1] is not Ellipsis
            else _list_of(arguments[0])
        )
    return "table"


def _list_of(annotation):
    word = kind_of(annotation)
    if word.startswith("list"):
        return "list of lists" + word[len("list") :]
    return "list of " + ("names" if word.startswith('"') else word + "s")


def default_of(field):
    """Return the words for a default."""
    if field.is_required():
        return "required"
    value = field.default
    if value is None or isinstance(value, BaseModel):
        return "—"
    if isinstance(value, bool):
        return str(value).lower()
    return f'"{value}"' if isinstance(value, str) else "[]" if value == () else f"{value:g}"


def keys_of(model):
    """Return key -> (type, default) of a table; of a scene only what is no section."""
    hints = typing.get_type_hints(model, include_extras=True)
    fields = {
        name: field
        for name, field in model.model_fields.items()
        if model is not schema.Scene or name in TEXTS
    }
    keys = {
        field.alias or name: (kind_of(hints[name]), default_of(field))
        for name, field in fields.items()
    }
    return keys


def documented():
    """Return heading -> key -> (type, default) of the document."""
    text = DOCUMENT.read_text(encoding="utf-8")
    found = {}
    for part in text.split("\n## ")[1:]:
        heading, _, body = part.partition("\n")
        rows = re.findall(r"^\| `(\w+)` \| ([^`]*?) \| (.*?) \| (.+) \|$", body, re.MULTILINE)
        found[heading] = {key: (kind, default) for key, kind, default, _ in rows}
    return found


@pytest.mark.parametrize("heading", TABLES)
def test_every_key_is_documented_with_its_type_and_default(heading):
    assert documented()[heading] == keys_of(TABLES[heading])


def test_the_document_of_the_laws_is_that_of_the_registries():
    """Written by scripts/run docs registered."""
    expected = {
        "laws.md": laws_document(ELASTIC, PERMEABILITY),
        "surface_conditions.md": conditions_document(CONDITIONS),
    }
    for name, text in expected.items():
        assert (DOCUMENT.parent / name).read_text(encoding="utf-8") == text


def test_every_section_has_a_heading():
    headings = {re.sub(r"[\[\]]", "", heading).split()[0] for heading in documented()}
    assert set(schema.Scene.model_fields) - TEXTS - {"smoke"} <= headings
    assert set(documented()) == set(TABLES)


def test_the_scene_of_the_readme_is_valid(tmp_path):
    text = (DOCUMENT.parents[1] / "README.md").read_text(encoding="utf-8")
    path = tmp_path / "readme.toml"
    path.write_text(re.search(r"```toml\n(.*?)```", text, re.DOTALL).group(1), encoding="utf-8")
    assert load_scene(path).dim == 2

"""Settings of Sphinx for the site of these documents, which `scripts/site` builds."""

from importlib.metadata import version as installed

project = "porofsi_petsc"
author = "porofsi_petsc developers"
project_copyright = author
release = version = installed(project)

extensions = ["myst_parser"]
myst_heading_anchors = 4  # the anchors of headings that GitHub makes: scene.md#stage
highlight_language = "none"  # of indented blocks, which are commands, formulas and drawings

html_theme = "furo"
html_title = f"{project} {version}"
html_copy_source = False
html_theme_options = {"navigation_with_keys": True}

"""Coupling schemes over the phases; an accelerator sees vectors only."""

"""Training: recipes, loss, loop, checkpoints and export."""

from flightdepth.training.recipe import Recipe, Stage
from flightdepth.training.recipe_files import load_recipe, recipe_names

__all__ = ["Recipe", "Stage", "load_recipe", "recipe_names"]

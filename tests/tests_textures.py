"""Few textures for the rooms of tests: the hundred of a fixed test set take eight seconds to make."""

from flightdepth.scenes import Textures


def few_textures(seed: int = 7) -> Textures:
    """Three of each kind."""
    return Textures.procedural(12, seed)

"""What a Still Box scene is, how one is drawn from a seed, and the textures it wears."""

from flightdepth.scenes.config import StillBoxConfig
from flightdepth.scenes.draw import draw_scene
from flightdepth.scenes.scene import Scene, Shape
from flightdepth.scenes.textures import Textures, textures_from_folder

__all__ = ["Scene", "Shape", "StillBoxConfig", "Textures", "draw_scene", "textures_from_folder"]

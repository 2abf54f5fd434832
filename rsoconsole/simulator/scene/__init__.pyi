from .scene import NS as NS
from .scene import Scene as Scene
from .world_scene import binned as binned

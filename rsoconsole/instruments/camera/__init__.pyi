from .camera import ARRIVED_KEY as ARRIVED_KEY
from .camera import IndiCamera as IndiCamera

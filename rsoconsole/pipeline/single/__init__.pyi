from .detecting import FrameDetector as FrameDetector
from .solving import MOST_MASKED as MOST_MASKED
from .solving import FrameSolver as FrameSolver

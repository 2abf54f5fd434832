from .summary import read_truth as read_truth
from .summary import summarise as summarise

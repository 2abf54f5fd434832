from .interruptions import TimeTrouble as TimeTrouble
from .loop import Engine as Engine

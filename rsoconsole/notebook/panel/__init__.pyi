from .panel import LivePanel as LivePanel

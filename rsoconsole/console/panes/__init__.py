"""The seat's widgets: they show what others have made and decide nothing."""

"""The console's widgets: they draw lines and pictures made elsewhere and decide nothing."""

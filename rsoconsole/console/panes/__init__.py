"""The console's widgets: they show lines and pictures made elsewhere and decide nothing."""

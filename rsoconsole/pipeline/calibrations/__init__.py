"""What recorded nights say of the shutter's timing and of published elements."""

"""From what is in the field to what the camera stores."""

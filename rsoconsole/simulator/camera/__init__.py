"""From the sources in a field to the pixels that the camera stores."""

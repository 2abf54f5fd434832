"""Camera: from the sources in a field to the pixels that it stores."""

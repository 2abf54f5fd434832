"""What the loop and its watch do to the world, and what they put on record."""

"""Navigation satellites' published orbits, and the shutter's timing by them."""

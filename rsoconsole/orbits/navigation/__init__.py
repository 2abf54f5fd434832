"""Published orbits of navigation satellites, and the shutter's timing by them."""

"""Motion about the Earth, closed or by forces, and the places of an object on the sky."""

"""Motion about the Earth: closed or by forces, and where it puts an object on the sky."""

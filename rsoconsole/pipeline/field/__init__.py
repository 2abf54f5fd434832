"""Every line and mover of the frames against every catalogued object that crossed."""

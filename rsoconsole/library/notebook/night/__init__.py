"""One session gathered for figures and tables."""

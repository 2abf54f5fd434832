"""A session gathered for figures, and marks over its previews."""

"""Which catalogued object was seen, and how far objects may be from their elements."""

"""A streak measured on the raw frame, and the class of object that drew it."""

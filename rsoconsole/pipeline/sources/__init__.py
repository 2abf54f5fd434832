"""Elements from their publishers, fetched on request, with their age, in order of precedence.

``update`` is not among these: it loads the client for web servers, which readers never need.
"""

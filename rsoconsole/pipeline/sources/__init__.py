"""Elements from their publishers, fetched on request, with their age, in order of precedence.

Module ``update`` is imported separately: it loads the client for web servers, which readers do not
need.
"""

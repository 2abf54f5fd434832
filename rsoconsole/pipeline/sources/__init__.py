"""Elements from those who publish them: fetched when asked, kept with their age, in an order.

``update`` is not among these: it loads what speaks to web servers, which readers never need.
"""

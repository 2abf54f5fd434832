"""Elements from those who publish them: fetched when asked, kept with their age, in an order.

``update`` is not among these: it loads what speaks to web servers, which readers never need.
"""

from rsoconsole.element_sources.names import Source, parse_source
from rsoconsole.element_sources.store import ElementStore, Kept, default_folder, is_store

__all__ = ["ElementStore", "Kept", "Source", "default_folder", "is_store", "parse_source"]

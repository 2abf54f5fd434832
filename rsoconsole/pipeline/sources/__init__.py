"""Orbital elements fetched from their publishers on request, in order of precedence.

Import the module ``update`` directly: it loads the web client, which readers do not need.
"""

"""Training of the streak detector's network: draws fields, trains, exports and evaluates.

May import rsoconsole.simulator and rsoconsole.vision; the product imports nothing from ``models``.
"""

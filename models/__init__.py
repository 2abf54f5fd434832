"""Training of the streak detector's network: fields drawn, network trained, exported, judged.

May import rsoconsole.simulator and rsoconsole.vision; the product imports nothing from here.
"""

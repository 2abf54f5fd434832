"""Sessions in the formats of others, and reading of others' observations.

Tables, CCSDS tracking messages, IOD lines, solved frames, DS9 regions: sessions and branches are
read, files are written beside them. May import session, pipeline and all below;
``notebook.report``, a layer above, draws the report.
"""

"""Export of sessions in other formats, and reading of observations in other formats.

CCSDS tracking messages, IOD lines, tables, solved frames, DS9 regions: sessions and branches are
read, files are written beside them. May import session, pipeline and all layers below;
``notebook.report``, a layer above, draws the report.
"""

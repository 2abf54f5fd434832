"""The night for others: tables, CCSDS tracking messages, IOD lines, solved frames, DS9 regions.

Reads sessions and branches, writes files beside them, and reads what others wrote. May touch
session, pipeline and all below; the report is drawn by ``notebook.report``, a floor above.
"""

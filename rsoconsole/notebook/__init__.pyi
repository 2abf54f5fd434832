from .figures.figures import write_figures as write_figures
from .live import LivePanel as LivePanel
from .live import live_panel as live_panel
from .report.report import render_report as render_report
from .session import Session as Session
from .session import open_session as open_session
from .tables import as_table as as_table

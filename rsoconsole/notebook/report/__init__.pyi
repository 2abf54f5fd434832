from .report import render_report as render_report

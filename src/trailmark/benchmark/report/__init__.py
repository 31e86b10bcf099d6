"""The report on a results database: one HTML page that works offline, and tables in Markdown.

It reads the database alone, so that it can be written on any machine, also while a benchmark is running.
"""

from trailmark.benchmark.report.data import Problem, Results, Runs, load_results
from trailmark.benchmark.report.markdown import markdown_report
from trailmark.benchmark.report.page import html_report

__all__ = ["Problem", "Results", "Runs", "html_report", "load_results", "markdown_report"]

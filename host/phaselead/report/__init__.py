"""Figures and pages."""

from __future__ import annotations

from phaselead.report import figures
from phaselead.report.campaign import write_campaign_report
from phaselead.report.demo import DemoResults, HeldOut, tracked, write_demo_report
from phaselead.report.gap import gap_page, next_command
from phaselead.report.page import made_by, save_figure, save_png
from phaselead.report.results import result_page
from phaselead.report.run_figures import SHOWN, Shown, runs_figure

__all__ = [
    "SHOWN",
    "DemoResults",
    "HeldOut",
    "Shown",
    "figures",
    "gap_page",
    "made_by",
    "next_command",
    "result_page",
    "runs_figure",
    "save_figure",
    "save_png",
    "tracked",
    "write_campaign_report",
    "write_demo_report",
]

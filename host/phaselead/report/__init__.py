"""Figures and pages."""

from __future__ import annotations

from phaselead.report import figures
from phaselead.report.campaign import write_campaign_report
from phaselead.report.demo import DemoResults, HeldOut, tracked, write_demo_report
from phaselead.report.gap import gap_page
from phaselead.report.learning import write_learning_report
from phaselead.report.page import save_png

__all__ = [
    "DemoResults",
    "HeldOut",
    "figures",
    "gap_page",
    "save_png",
    "tracked",
    "write_campaign_report",
    "write_demo_report",
    "write_learning_report",
]

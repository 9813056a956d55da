"""Tables of report templates: a cell that spans the row spans as many columns as the table's head has."""

from __future__ import annotations

import re
from importlib.resources import files

import pytest

TEMPLATES = sorted(
    (one for one in (files("phaselead") / "report" / "templates").iterdir() if one.name.endswith(".html")),
    key=lambda one: one.name,
)
SPANNED = [one for one in TEMPLATES if "colspan" in one.read_text()]


@pytest.mark.parametrize("template", SPANNED, ids=lambda one: one.name)
def test_a_cell_across_the_whole_row_spans_the_columns_of_the_head(template):
    tables = re.findall(r"<table.*?</table>", template.read_text(), re.DOTALL)
    spans = [
        (int(span), len(re.findall(r"<th[ >]", table.split("</tr>")[0])))
        for table in tables
        for span in re.findall(r'<tr><td colspan="(\d+)">', table)
    ]
    assert spans
    assert all(span == columns for span, columns in spans)


def test_the_candidates_of_a_gap_are_among_these_tables():
    assert "gap.html" in [one.name for one in SPANNED]

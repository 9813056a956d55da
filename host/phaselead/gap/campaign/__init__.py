"""Blind trials of the gap workflow: something is hidden in stages of a foreign make, and the answers are scored.

The generator of the cases is not part of the package: it is loaded from a folder (``truth.load_truth``), so that nobody
can be tempted to share code between the truth and the catalogue, and users can bring their own.
"""

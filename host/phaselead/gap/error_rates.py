"""How often an answer may be wrong: the rates that every test of the workflow shares."""

from __future__ import annotations

ERROR_RATE = 0.01
"""Of a test, over all that it looks at together: false alarms, savings by chance, names and ties that are wrong."""
SURE = 1 - ERROR_RATE
"""Probability from which an effect is named, and from which a tie holds the truth."""
INSIDE = 0.95
"""Probability of an interval, of a bound, of any region of the posterior, and of what is as good as one: that something
is there where nothing is named, that an experiment breaks its tie."""
TWO_SIDED_95, ONE_SIDED_95 = 1.96, 1.645
"""Standard deviations of a normal distribution: within the first of its mean lie 95 %, below the second 95 %."""
FOUND, FOUND_AGAIN = 1e-6, 1e-3
"""Probability by chance below which something is found among very many that are looked at, and below which it is there
again in other records."""

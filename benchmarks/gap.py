"""Processor time of `phaselead gap` on one axis: seconds for each second of 5 kHz data, 5000 rows.

One row a case of the first generator's tuning set, of different kinds, and their median; a slow session counts by its
rows. Only the workflow is timed, in one thread: not the making of the records, nor the fit of the base. Processor time
grows by a third and more where other work shares the core. Names of cases may be given instead of those below.

    python benchmarks/gap.py
    python benchmarks/gap.py tuning/single/delay/1/fast/0
"""

from __future__ import annotations

import os
import statistics
import sys
import time
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from phaselead.freed_memory import keep_freed_memory
from phaselead.gap import run_gap
from phaselead.validation.trial import base_model
from phaselead.validation.truth import load_truth

TRUTH = Path(__file__).parent.parent / "tests" / "gap" / "truth"
CASES = (
    "tuning/none/nothing/0/fast/18",
    "tuning/single/load_change/1/fast/0",
    "tuning/single/asymmetric_hysteresis/1/fast/0",
    "tuning/single/creep/1/slow/0",
    "tuning/pair/slew_limit+sensor_nonlinearity/1/fast/9",
    "tuning/pair/charge_leakage+backlash/1/slow/7",
)
ROWS_A_SECOND = 5000


def ratio(name: str) -> float:
    """Processor seconds for each second of data of one case; prints its row."""
    case = load_truth(TRUTH).case(name)
    reference, train, holdout = case.records()
    stage = base_model(case, reference)
    rows = sum(len(record.t_s) for record in (*reference, *train, *holdout))
    begin = time.process_time()
    result = run_gap(stage, train, holdout, reference, without=case.without)
    spent_s = time.process_time() - begin
    found = spent_s / (rows / ROWS_A_SECOND)
    print(f"| {name} | {', '.join(result.verdicts)} | {spent_s:.1f} s | {found:.2f} |", flush=True)
    return found


def main() -> None:
    keep_freed_memory()
    print("| case | verdict | processor time | for each second of 5 kHz data |\n|---|---|---|---|")
    found = [ratio(name) for name in sys.argv[1:] or CASES]
    median = statistics.median(found)
    print(f"| median | | | {median:.2f}: {60 * median:.0f} s for 60 s |")


if __name__ == "__main__":
    main()

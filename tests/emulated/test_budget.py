"""What the firmware needs is within what the manual says it needs."""

import itertools
import runpy
from pathlib import Path

from phaselead.sim.emulated import find_firmware
from phaselead.sim.stack_use import CallGraph, worst_stack

ROOT = Path(__file__).parents[2]


def test_nothing_is_above_its_ceiling_or_far_above_the_last_figure(capsys):
    budget = runpy.run_path(str(ROOT / "benchmarks" / "budget.py"))
    status = budget["main"]()
    printed = capsys.readouterr().out
    assert status == 0, printed
    assert len(budget["committed"]()) >= len(budget["CEILINGS"])


def test_a_figure_is_judged_by_its_ceiling_and_by_the_last_one():
    verdict = runpy.run_path(str(ROOT / "benchmarks" / "budget.py"))["verdict"]
    assert verdict(90, 100, 85) == "ok"
    assert verdict(101, 100, 95) == "ABOVE ITS CEILING"
    assert verdict(101, 100, None) == "ABOVE ITS CEILING"
    assert verdict(95, 100, 80) == "MORE THAN 10 % ABOVE THE LAST"
    assert verdict(150, 100, 150) == "ABOVE ITS CEILING"


def test_the_stack_is_the_deepest_chain_with_both_interrupts_on_top():
    build = find_firmware("nucleo_f446re").parent
    total, chains = worst_stack(build)
    graph = CallGraph(build)
    assert total == sum(size for size, _ in chains) + 72
    for size, chain in chains:
        assert size == sum(graph.frames.get(name, 64) for name in chain)
        for caller, callee in itertools.pairwise(chain):
            assert callee in graph.calls[caller]

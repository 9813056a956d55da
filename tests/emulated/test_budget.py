"""What the firmware needs is within what the manual says it needs."""

import itertools
import re
import runpy
from pathlib import Path

import pytest

from phaselead.sim.emulated import find_firmware
from phaselead.sim.stack_use import CallGraph, worst_stack

ROOT = Path(__file__).parents[2]


def test_nothing_is_above_its_ceiling(capsys):
    budget = runpy.run_path(str(ROOT / "benchmarks" / "budget.py"))
    status = budget["main"]()
    printed = capsys.readouterr().out
    assert status == 0, printed
    assert len(budget["committed"]()) >= len(budget["CEILINGS"])


def test_memory_meets_its_ceiling_before_the_linker_ends_the_build():
    ceilings = runpy.run_path(str(ROOT / "benchmarks" / "budget.py"))["CEILINGS"]
    linked = (ROOT / "firmware" / "port" / "stm32f4" / "sections.ld").read_text()
    for name, region in (("RAM, bytes", "RAM"), ("flash, bytes", "FLASH")):
        assert ceilings[name] < 1024 * int(re.search(rf"^ *{region} \(.*LENGTH = (\d+)K", linked, re.M)[1])


def test_a_figure_is_judged_by_its_ceiling_and_by_the_last_one():
    verdict = runpy.run_path(str(ROOT / "benchmarks" / "budget.py"))["verdict"]
    assert verdict(90, 100, 85) == "ok"
    assert verdict(101, 100, 95) == "ABOVE ITS CEILING"
    assert verdict(101, 100, None) == "ABOVE ITS CEILING"
    assert verdict(95, 100, 80) == "more than 10 % above the last"
    assert verdict(150, 100, 150) == "ABOVE ITS CEILING"


@pytest.mark.parametrize(
    ("figure", "last", "status", "warnings"), [(80, 80, 0, 0), (95, 80, 0, 1), (95, None, 0, 0), (2049, 2000, 1, 0)]
)
def test_growth_is_a_warning_and_only_a_ceiling_fails(capsys, figure, last, status, warnings):
    judge = runpy.run_path(str(ROOT / "benchmarks" / "budget.py"))["judge"]
    name = "stack, bytes"
    assert judge({name: figure}, {} if last is None else {name: last}) == status
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("warning: ")]
    assert len(lines) == warnings
    assert all(f"{name}: {figure} " in line and f"({last} in emulation.md)" in line for line in lines)


def test_the_stack_is_the_deepest_chain_with_both_interrupts_on_top():
    build = find_firmware("nucleo_f446re").parent
    total, chains = worst_stack(build)
    graph = CallGraph(build)
    assert total == sum(size for size, _ in chains) + 72
    for size, chain in chains:
        assert size == sum(graph.frames.get(name, 64) for name in chain)
        for caller, callee in itertools.pairwise(chain):
            assert callee in graph.calls[caller]

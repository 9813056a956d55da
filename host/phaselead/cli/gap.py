"""gap: where model and measurement disagree, what is missing, and the next stage file."""

from __future__ import annotations

import os
from typing import Any

import click

from phaselead.cli.common import json_option, map_option, named_port, rate_option, report_option, yes_option
from phaselead.cli.gap_campaign import campaign
from phaselead.cli.listing import top_level
from phaselead.cli.outputs import INPUT, RECORD, OutputFile
from phaselead.errors import BadInput
from phaselead.serial_ports import DEFAULT_PORT, PORT_VARIABLE

LISTS = ("--train", "--holdout", "--reference")


class GapGroup(click.Group):
    """A group that runs the comparison itself without a subcommand, and whose list options take several words."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        if args and args[0] in self.commands:
            return super().parse_args(ctx, args)
        if {"--frozen", "--refit"} <= set(args):
            raise BadInput("--frozen keeps the base, --refit fits it anew: give one of them")
        return super().parse_args(ctx, spread(args))

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """The subcommand that is meant; a file in its place is a record without its option."""
        if args and args[0] not in self.commands and os.path.exists(args[0]):
            raise BadInput(f"{args[0]}: what is it for? Give records with {', '.join(LISTS)}, the model with --model")
        return super().resolve_command(ctx, args)


def spread(args: list[str]) -> list[str]:
    """``--train a b`` as ``--train a --train b``, which is what click understands."""
    found: list[str] = []
    current = None
    for arg in args:
        if arg.startswith("-") and arg != "-":
            current = arg if arg in LISTS else None
            if current is None:
                found.append(arg)
        elif current is not None:
            found += [current, arg]
        else:
            found.append(arg)
    return found


@top_level(order=160, group="gap")
@click.group(cls=GapGroup, invoke_without_command=True, subcommand_metavar="[next ...]")
@click.option("--model", "model_path", metavar="M", type=INPUT, help="Stage file.")
@click.option("--train", multiple=True, metavar="REC...", type=RECORD, help="Records to learn from.")
@click.option(
    "--holdout", multiple=True, metavar="REC...", type=RECORD, help="Records to judge on; nothing is fitted to them."
)
@click.option(
    "--reference", multiple=True, metavar="REC...", type=RECORD, help="Records known to be without the missing effect."
)
@click.option("--frozen/--refit", default=None, help="Keep the base, or refit it. Default: keep it with --reference.")
@click.option("-o", "--output", metavar="next.toml", type=OutputFile(".toml"), help="Where the next stage file goes.")
@report_option
@map_option
@rate_option
@click.option(
    "--verify-on",
    metavar="P",
    help="Track the same paths on this device with the old and the new model; the report shows both.",
)
@json_option
@click.pass_context
def gap(ctx: click.Context, /, **options: Any) -> None:
    """Find where model and measurement disagree, name the missing effect, and add it to the model.

    \b
    phaselead gap --model M --train REC... --holdout REC... [--reference REC...] [--frozen|--refit]
                  -o next.toml --report gap.html --json gap.json [--verify-on P]
    phaselead gap next gap.json --port P -o more.h5
    """
    if ctx.invoked_subcommand is None:
        from phaselead.cli.gap_run import compare

        compare(**options)


@gap.command("next")
@click.argument("gap_json", metavar="gap.json", type=INPUT)
@click.option(
    "--port", default=DEFAULT_PORT, envvar=PORT_VARIABLE, callback=named_port, show_default=True, help="The device."
)
@click.option(
    "--axis", type=click.Choice(["x", "y", "z"]), help="Default: that of the tie; x where gap.json does not say."
)
@click.option(
    "--model", "model_path", metavar="M", type=INPUT, help="Stage file with limits and calibration; uploaded first."
)
@click.option("-o", "--output", metavar="more.h5", type=OutputFile(".h5", ".hdf5"), required=True)
@yes_option
@json_option
def next_experiment(
    gap_json: str,
    port: str,
    axis: str | None,
    model_path: str | None,
    output: str,
    yes: bool,
    json_to: str | None,
) -> None:
    """Run the experiment that would decide a tie, in open loop, and keep the record.

    It asks first where --model shows a mode that the experiment drives.
    """
    from phaselead.cli.gap_run import run_next

    run_next(gap_json, port, axis, output, model_path, yes, json_to)


gap.add_command(campaign)

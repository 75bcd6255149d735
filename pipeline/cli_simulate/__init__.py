"""``gyrostand simulate``: its commands; the options of each in a module of its own."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli_simulate.coning_command import coning
from pipeline.cli_simulate.drift_command import drift
from pipeline.cli_simulate.navigation_command import navigation
from pipeline.cli_simulate.rate_table_command import rate_table
from pipeline.cli_simulate.static_command import static

app = typer.Typer(help="Recordings with known truth.", no_args_is_help=True, rich_markup_mode=None)
app.command()(coning)
app.command()(drift)
app.command()(navigation)
app.command()(static)
app.command("rate_table")(rate_table)


@app.command()
def samples(out: Annotated[Path, typer.Option("--out", help="Folder for the samples.")]) -> None:
    """Write the project's own sample recordings with their test plans and truth."""
    from pipeline.simulate.samples import write_samples

    for path in write_samples(out):
        typer.echo(path)
